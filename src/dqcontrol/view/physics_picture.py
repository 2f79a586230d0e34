"""A picture of a run: the arm, ghosts of it along the way, and the hand's path over the desired one."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dqcontrol.errors import FileFormatError, ShapeError, ValueRangeError, as_array
from dqcontrol.plants.mujoco_model import compiled, import_mujoco, skeleton
from dqcontrol.view.offscreen import offscreen, render
from dqcontrol.view.picture_file import check_picture_file
from dqcontrol.view.stage import add_stage

if TYPE_CHECKING:
    from dqcontrol.robots.robot import Robot

Array = NDArray[np.float64]

_DESIRED = (0.05, 0.45, 0.90, 1.0)
_ACTUAL = (0.98, 0.25, 0.12, 1.0)
_DASH = 0.045  # of the arm's length
_GHOST = 0.16  # opacity
_SUPERSAMPLING = 2
_PIECES = 400  # of a path, at most


def render_run(
    robot: Robot,
    q: ArrayLike,
    pose: ArrayLike,
    desired_pose: ArrayLike,
    path: str | Path,
    *,
    ghosts: int = 4,
    width: int = 1280,
    height: int = 960,
    azimuth: float = 130.0,
    elevation: float = -18.0,
    overwrite: bool = False,
) -> None:
    """Draw a run and save it as a PNG file.

    Parameters
    ----------
    robot
        The arm; it needs no inertias.
    q
        Configurations over time, shape (N, n), rad or m. The last is drawn in full.
    pose, desired_pose
        Hand poses over time, shapes (N, 8) and (M, 8), or positions, shapes (N, 3) and (M, 3), in m; red and
        blue.
    path
        Where to save the picture.
    ghosts
        How many earlier configurations show through, equally spaced in time.
    width, height
        Pixels.
    azimuth, elevation
        Direction of view, degrees; negative elevations look down.
    overwrite
        True to replace an existing file.

    Raises
    ------
    MissingExtraError
        If mujoco is not installed, or this machine has no OpenGL.
    ExistsError, FileFormatError
        If the file exists, its folder does not, or its ending is not .png.
    ShapeError, ValueRangeError
        If an array does not fit.

    Examples
    --------
    >>> import numpy as np, dqcontrol as dqc
    >>> arm = dqc.load_robot("iiwa7")
    >>> q = np.linspace(0.2, 0.8, 50)[:, None] * np.ones(7)
    >>> render_run(arm, q, arm.fkm(q), arm.fkm(q), "run.png")  # doctest: +SKIP
    """
    target = Path(path)
    if target.suffix.lower() != ".png":
        raise FileFormatError(f"{target}: pictures are PNG files, got the ending '{target.suffix}'")
    check_picture_file(target, overwrite=overwrite)
    for field, value, least in (("ghosts", ghosts, 0), ("width", width, 1), ("height", height, 1)):
        if not isinstance(value, int) or value < least:
            raise ValueRangeError(f"{field}: must be an integer ≥ {least}, got {value}")
    rows = as_array("q", q, (robot.configuration_size,))
    if rows.ndim != 2 or not len(rows):
        raise ShapeError(f"q: expected shape (N, {robot.configuration_size}), got {rows.shape}")
    actual, desired = _positions("pose", pose), _positions("desired_pose", desired_pose)

    pixels = _picture(
        robot,
        rows,
        actual,
        desired,
        ghosts,
        _SUPERSAMPLING * width,
        _SUPERSAMPLING * height,
        azimuth,
        elevation,
    )
    blocks = pixels.reshape(height, _SUPERSAMPLING, width, _SUPERSAMPLING, 3)
    importlib.import_module("matplotlib.image").imsave(
        target, blocks.mean(axis=(1, 3)).round().astype(np.uint8)
    )


def _positions(field: str, value: ArrayLike) -> Array:
    """Return positions (N, 3) from poses (N, 8) or positions."""
    rows = as_array(field, value)
    if rows.ndim != 2 or rows.shape[1] not in (3, 8) or not len(rows):
        raise ShapeError(f"{field}: expected shape (N, 8) or (N, 3), got {rows.shape}")
    if rows.shape[1] == 3:
        return rows
    w, v, dw, dv = rows[:, :1], rows[:, 1:4], rows[:, 4:5], rows[:, 5:]
    return 2 * (w * dv - dw * v - np.cross(dv, v))


def _picture(
    robot: Robot,
    rows: Array,
    actual: Array,
    desired: Array,
    ghosts: int,
    width: int,
    height: int,
    azimuth: float,
    elevation: float,
) -> NDArray[np.uint8]:
    """Return the picture's pixels."""
    mujoco = import_mujoco()
    spec = skeleton(robot)
    reach = float(np.linalg.norm(robot.chain[:, 4:7], axis=1).sum()) or 1.0
    frames = robot.frames(rows[[k * (len(rows) - 1) // ghosts for k in range(ghosts)] + [-1]])
    points = np.vstack([actual, desired, _positions("frames", frames.reshape(-1, 8)), [np.zeros(3)]])
    lower, upper = points.min(axis=0), points.max(axis=0)
    floor = min(0.0, lower[2] - 0.06 * reach) if lower[2] < -0.01 * reach else 0.0
    add_stage(mujoco, spec, reach, floor, azimuth, (width, height))
    model = compiled(spec)
    data = mujoco.MjData(model)
    scene = mujoco.MjvScene(model, maxgeom=2 * _PIECES + (ghosts + 2) * (model.ngeom + 4))
    options, nobody, camera = mujoco.MjvOption(), mujoco.MjvPerturb(), mujoco.MjvCamera()

    def pose_arm(q: Array) -> None:
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        mujoco.mj_camlight(model, data)

    moving = mujoco.mjtCatBit.mjCAT_DYNAMIC.value
    pose_arm(rows[-1])
    camera.lookat[:] = 0.5 * (lower + upper)
    camera.distance = 1.45 * np.linalg.norm(upper - lower) + 0.2 * reach
    camera.azimuth, camera.elevation = azimuth, elevation
    mujoco.mjv_updateScene(model, data, options, nobody, camera, mujoco.mjtCatBit.mjCAT_ALL.value, scene)
    for k in range(ghosts):
        pose_arm(rows[k * (len(rows) - 1) // ghosts])
        first = scene.ngeom
        mujoco.mjv_addGeoms(model, data, options, nobody, moving, scene)
        for geom in scene.geoms[first : scene.ngeom]:
            geom.rgba[3] = _GHOST
    _trace(mujoco, scene, desired, 0.005 * reach, _DESIRED, _DASH * reach)
    _trace(mujoco, scene, actual, 0.004 * reach, _ACTUAL, 0.0)
    with offscreen(width, height):
        return render(model, scene, width, height)


def _trace(
    mujoco: Any, scene: Any, points: Array, radius: float, colour: tuple[float, ...], dash: float
) -> None:
    """Add a path as a string of capsules; with a dash length, m, the second half of each is left out."""
    points = points[np.linspace(0, len(points) - 1, min(len(points), _PIECES)).astype(int)]
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    middle = np.cumsum(steps) - 0.5 * steps
    drawn = steps > 0 if not dash else middle % dash < 0.45 * dash
    kind, rgba, zero = mujoco.mjtGeom.mjGEOM_CAPSULE, np.array(colour, dtype=np.float32), np.zeros(9)
    for i in np.flatnonzero(drawn):
        geom = scene.geoms[scene.ngeom]
        mujoco.mjv_initGeom(geom, kind, zero[:3], zero[:3], zero, rgba)
        mujoco.mjv_connector(geom, kind, radius, points[i], points[i + 1])
        scene.ngeom += 1

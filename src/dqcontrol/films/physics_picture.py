"""A picture of a run: the arm, ghosts of it along the way, and the end effector's path over the desired one."""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dqcontrol.algebra import translation
from dqcontrol.arrays import Array
from dqcontrol.errors import FileFormatError, ShapeError, ValueRangeError, as_array
from dqcontrol.films import drawn_scene, film
from dqcontrol.plants.mujoco.mujoco_model import compiled, skeleton, skeleton_positions
from dqcontrol.robots.files.mjcf import import_mujoco

if TYPE_CHECKING:
    from dqcontrol.robots.robot import Robot


_GHOST = 0.16  # opacity
_SUPERSAMPLING = 2  # four samples a pixel, as the usual antialiasing
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
    further: Sequence[ArrayLike] = (),
) -> None:
    """Draw a run and save it as a PNG file.

    Parameters
    ----------
    robot
        The arm; it needs no inertias.
    q
        Configurations over time, shape (N, n), rad or m. The last is drawn in full.
    pose, desired_pose
        End effector poses over time, shapes (N, 8) and (M, 8), or positions, shapes (N, 3) and (M, 3), in m; red and
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
    further
        Poses or positions of other hands over time, red too.

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
    drawn_scene.check_picture_file(target, overwrite=overwrite)
    for field, value, least in (("ghosts", ghosts, 0), ("width", width, 1), ("height", height, 1)):
        if not isinstance(value, int) or value < least:
            raise ValueRangeError(f"{field}: must be an integer ≥ {least}, got {value}")
    rows = as_array("q", q, (robot.configuration_size,))
    if rows.ndim != 2 or not len(rows):
        raise ShapeError(f"q: expected shape (N, {robot.configuration_size}), got {rows.shape}")
    actual, desired = [_positions("pose", pose)], _positions("desired_pose", desired_pose)
    actual += [_positions(f"further[{i}]", each) for i, each in enumerate(further)]

    size = _SUPERSAMPLING * width, _SUPERSAMPLING * height
    pixels = _picture(robot, rows, actual, desired, ghosts, size, (azimuth, elevation))
    blocks = pixels.reshape(height, _SUPERSAMPLING, width, _SUPERSAMPLING, 3)
    shades = blocks.mean(axis=(1, 3)).round().astype(np.uint8)
    importlib.import_module("matplotlib.image").imsave(target, shades)


def _positions(field: str, value: ArrayLike) -> Array:
    """Return positions (N, 3) from poses (N, 8) or positions."""
    rows = as_array(field, value)
    if rows.ndim != 2 or rows.shape[1] not in (3, 8) or not len(rows):
        raise ShapeError(f"{field}: expected shape (N, 8) or (N, 3), got {rows.shape}")
    return rows if rows.shape[1] == 3 else translation(rows)


def _picture(
    robot: Robot,
    rows: Array,
    actual: list[Array],
    desired: Array,
    ghosts: int,
    size: tuple[int, int],
    view: tuple[float, float],
) -> NDArray[np.uint8]:
    """Return the picture's pixels, for its width and height and the azimuth and elevation of its view."""
    mujoco = import_mujoco()
    spec, meshes = skeleton(robot), film.link_meshes(robot)
    film.add_meshes(spec, robot, meshes)
    shown = rows[[k * (len(rows) - 1) // ghosts for k in range(ghosts)] + [-1]]
    framing = film.framing_of_arm(robot, shown, np.vstack([*actual, desired]), meshes)
    reach = framing.reach
    film.add_scene_background(mujoco, spec, framing, view[0], size)
    model = compiled(spec)
    data = mujoco.MjData(model)
    scene = mujoco.MjvScene(model, maxgeom=(1 + len(actual)) * _PIECES + (ghosts + 2) * (model.ngeom + 4))
    options, nobody, camera = mujoco.MjvOption(), mujoco.MjvPerturb(), film.camera_at(framing, *view)

    def pose_arm(q: Array) -> None:
        data.qpos[:] = skeleton_positions(robot, q)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_camlight(model, data)

    pose_arm(rows[-1])
    mujoco.mjv_updateScene(model, data, options, nobody, camera, mujoco.mjtCatBit.mjCAT_ALL.value, scene)
    for k in range(ghosts):
        pose_arm(rows[k * (len(rows) - 1) // ghosts])
        drawn_scene.add_ghost(model, data, scene, _GHOST)
    drawn_scene.add_desired(scene, desired, reach, _PIECES)
    for each in actual:
        drawn_scene.add_actual(scene, each, reach, _PIECES)
    with drawn_scene.offscreen(*size), drawn_scene.renderer(model, *size) as draw:
        return draw(scene)

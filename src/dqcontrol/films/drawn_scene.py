"""What MuJoCo draws without a window: paths, ghosts, and constraints around a robot with the nearest pair."""

from __future__ import annotations

import contextlib
import importlib
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dqcontrol.constraints.constraint_view import NEAR, ConstraintView
from dqcontrol.errors import ExistsError, FileFormatError, MissingExtraError, ValueRangeError, unknown_name
from dqcontrol.geometry import Box, Capsule, Cylinder, Hull, InfiniteCylinder, Plane, Shape, Sphere
from dqcontrol.robots.files.mjcf import import_mujoco
from dqcontrol.world.body import poses_of

if TYPE_CHECKING:
    from dqcontrol.arrays import Array
    from dqcontrol.loop.record import Record


DESIRED = (0.05, 0.45, 0.90, 1.0)
ACTUAL = (0.98, 0.25, 0.12, 1.0)
_DASH = 0.045  # of the arm's length


def add_desired(scene: Any, points: NDArray[np.float64], reach: float, pieces: int) -> None:
    """Add the desired path, shape (N, 3), m: dashed and blue, for an arm of length ``reach``, m."""
    _add_path(scene, _thinned(points, pieces), 0.005 * reach, DESIRED, _DASH * reach)


def add_actual(scene: Any, points: NDArray[np.float64], reach: float, pieces: int) -> None:
    """Add the end effector's path, shape (N, 3), m: red, for an arm of length ``reach``, m."""
    _add_path(scene, _thinned(points, pieces), 0.004 * reach, ACTUAL, 0.0)


def add_mark(scene: Any, place: NDArray[np.float64], reach: float, words: str) -> None:
    """Add a ball at a place of a path, shape (3,), m, with words beside it."""
    _add_geom(scene, "SPHERE", np.full(3, 0.015 * reach), place, np.eye(3), DESIRED).label = words


def _add_geom(
    scene: Any, kind: str, size: ArrayLike, middle: ArrayLike, turn: ArrayLike, rgba: tuple[float, ...]
) -> Any:
    """Add a geom of a kind of MuJoCo's, its half sizes in m and its axes the columns of ``turn``; return it."""
    mujoco, geom = import_mujoco(), scene.geoms[scene.ngeom]
    parts = (np.array(each, dtype=np.float64).ravel() for each in (size, middle, turn))
    mujoco.mjv_initGeom(geom, getattr(mujoco.mjtGeom, f"mjGEOM_{kind}"), *parts, np.array(rgba, np.float32))
    scene.ngeom += 1
    return geom


def _connect(
    scene: Any, start: Array, end: Array, radius: float, rgba: tuple[float, ...], kind: str = "CAPSULE"
) -> None:
    """Add a capsule, or another long geom, from one point to another, m."""
    geom = _add_geom(scene, kind, np.zeros(3), np.zeros(3), np.eye(3), rgba)
    import_mujoco().mjv_connector(geom, geom.type, radius, np.array(start), np.array(end))


def _thinned(points: NDArray[np.float64], most: int) -> NDArray[np.float64]:
    """Return at most so many of the points, the first and the last among them."""
    return points[np.linspace(0, len(points) - 1, min(len(points), most)).astype(int)]


def _add_path(scene: Any, points: Array, radius: float, colour: tuple[float, ...], dash: float) -> None:
    """Add a path as a string of capsules; with a dash length, m, the second half of each is left out."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    middle = np.cumsum(steps) - 0.5 * steps
    drawn = steps > 0 if not dash else middle % dash < 0.45 * dash
    for i in np.flatnonzero(drawn):
        _connect(scene, points[i], points[i + 1], radius, colour)


# of further runs, in turn
COLOURS = (0.13, 0.42, 0.85), (0.93, 0.53, 0.10), (0.20, 0.60, 0.30), (0.60, 0.30, 0.70)


def add_ghost(
    model: Any,
    data: Any,
    scene: Any,
    opacity: float,
    colour: tuple[float, float, float] | None = None,
    moved: ArrayLike = (0.0, 0.0, 0.0),
) -> None:
    """Add to MuJoCo's scene what moves, as it stands in ``data``, for the scene behind to show through.

    Parameters
    ----------
    model, data
        Of what is added; kinematics are computed already.
    scene
        Has room for as many shapes as the model.
    opacity
        1 hides what is behind.
    colour
        In place of the shapes' own.
    moved
        How far all shapes are moved, m: a little away from the viewer, so that they stay behind others in their place.
    """
    mujoco, first = import_mujoco(), scene.ngeom
    moving = mujoco.mjtCatBit.mjCAT_DYNAMIC.value
    options = mujoco.MjvOption()
    options.geomgroup[4] = 0
    mujoco.mjv_addGeoms(model, data, options, mujoco.MjvPerturb(), moving, scene)
    for geom in scene.geoms[first : scene.ngeom]:
        if colour is not None:
            geom.rgba[:3] = np.array(colour, dtype=np.float32)
        geom.rgba[3] = opacity
        geom.pos[:] += np.asarray(moved)


_SOLID, _CLOSE, _ZONE = (0.55, 0.35, 0.65, 0.6), (0.90, 0.25, 0.10, 0.75), (0.25, 0.55, 0.35, 0.12)
_WOOD = (0.76, 0.60, 0.42, 1.0)  # of what physics moves
_LINE = 0.004  # of the arm's length: radius of the line between the nearest points
_THIN = 0.002  # m: of a plane


class DrawnScene:
    """Adds what is around a robot to MuJoCo's scene, sample by sample; the pair that is near is red."""

    def __init__(self, kept: ConstraintView, record: Record, reach: float, floor: float) -> None:
        self._kept, self._record, self._reach, self._floor = kept, record, reach, floor
        self._shifts = kept.shifts(record.time)
        readings = {name: signal.values for name, signal in record.readings.items()}
        for i, thing in enumerate(kept.things):
            if f"{thing.name}_displacement" in readings:
                self._shifts[i] += readings[f"{thing.name}_displacement"]
        bodies = kept.free.items()
        self._free = [(body.own_shapes, poses_of(name, body, record.time, readings)) for name, body in bodies]
        self.moves: bool = bool(self._free) or bool(np.ptp(self._shifts, axis=1).any())
        drawn = [thing.shape for thing in kept.things] + [each for shapes, _ in self._free for each in shapes]
        self.most: int = 2 + sum(len(each.faces) if isinstance(each, Hull) else 1 for each in drawn)

    def add(self, scene: Any, k: int) -> None:
        """Add what belongs to sample k."""
        nearest = self._kept.nearest(self._record.q[k], float(self._record.time[k]))
        near = nearest is not None and nearest.room < NEAR
        for i, thing in enumerate(self._kept.things):
            close = near and nearest is not None and nearest.thing == i
            colour = _CLOSE if close else _ZONE if thing.is_zone else _SOLID
            self._add_shape(scene, thing.shape, self._shifts[i, k], colour)
        for shapes, poses in self._free:
            for shape in shapes:
                self._add_shape(scene, shape.moved(poses[k]), np.zeros(3), _WOOD)
        if near and nearest is not None and len(nearest.on_a):
            if nearest.link is not None:
                self._add_shape(scene, nearest.link, np.zeros(3), (*_CLOSE[:3], 0.35))
            _connect(scene, nearest.on_a, nearest.on_b, _LINE * self._reach, (*_CLOSE[:3], 1.0))

    def _add_shape(self, scene: Any, shape: Shape, shift: Array, rgba: tuple[float, ...]) -> None:
        if isinstance(shape, Capsule | Cylinder):
            kind = "CAPSULE" if isinstance(shape, Capsule) else "CYLINDER"
            _connect(scene, shape.start + shift, shape.end + shift, shape.radius, rgba, kind)
        elif isinstance(shape, InfiniteCylinder):
            along, point = 2 * self._reach * shape.direction, shape.point + shift
            _connect(scene, point - along, point + along, shape.radius, rgba)
        elif isinstance(shape, Hull):
            for corners in shape.corners[shape.faces] + shift:
                _add_triangle(scene, corners, rgba)
        elif isinstance(shape, Sphere):
            _add_geom(scene, "SPHERE", np.full(3, shape.radius), shape.center + shift, np.eye(3), rgba)
        elif isinstance(shape, Box):
            _add_geom(scene, "BOX", shape.row[1:4], shape.row[4:7] + shift, shape.row[7:], rgba)
        elif isinstance(shape, Plane) and not self._is_floor(shape):
            middle = (shape.offset - _THIN) * shape.normal + shift
            _add_geom(scene, "BOX", [self._reach, self._reach, _THIN], middle, shape.axes, rgba)

    def _is_floor(self, plane: Plane) -> bool:
        """Return whether a plane is as good as the floor that is drawn anyway."""
        return plane.normal[2] > 1 - 1e-6 and abs(plane.offset - self._floor) < 0.01


def _add_triangle(scene: Any, corners: Array, rgba: tuple[float, ...]) -> None:
    sides = np.diff(corners[[0, 1, 0, 2]], axis=0)[::2]
    axes = np.vstack([sides, np.cross(*sides)])
    size = np.linalg.norm(axes, axis=1)
    _add_geom(scene, "TRIANGLE", size, corners[0], (axes / size[:, None]).T, rgba)


def check_picture_file(target: Path, *, overwrite: bool) -> None:
    """Say why a picture cannot be saved there, if it cannot.

    Raises
    ------
    FileFormatError
        If its folder does not exist.
    ExistsError
        If the file exists and may not be replaced.
    """
    if not target.parent.is_dir():
        raise FileFormatError(f"{target.parent}: there is no such folder for {target.name}")
    if target.exists() and not overwrite:
        raise ExistsError(
            f"{target}: exists already; choose another name, or replace it with --force (overwrite=True)"
        )


BACKENDS = ("egl", "osmesa", "glfw")


@contextlib.contextmanager
def offscreen(width: int, height: int) -> Iterator[str]:
    """Make an OpenGL context current and give its backend: what MUJOCO_GL names, or else the first that works.

    Parameters
    ----------
    width, height
        Pixels.

    Raises
    ------
    MissingExtraError
        If this machine has no OpenGL.
    UnknownNameError
        If MUJOCO_GL names no backend.
    """
    import_mujoco()
    chosen = os.environ.get("MUJOCO_GL", "").lower()
    if chosen and chosen not in BACKENDS:
        raise unknown_name("MUJOCO_GL", chosen, BACKENDS)
    failures, context, backend = [], None, ""
    for backend in [chosen] if chosen else BACKENDS:
        platform = os.environ.get("PYOPENGL_PLATFORM")
        try:
            context = importlib.import_module(f"mujoco.{backend}").GLContext(width, height)
            break
        except Exception as error:  # each backend fails in its own ways
            failures.append(f"{backend}: {error!s:.80}")
            if platform is None:
                os.environ.pop("PYOPENGL_PLATFORM", None)
    if context is None:
        raise MissingExtraError(
            f"picture: no OpenGL here ({'; '.join(failures)}); on Debian or Ubuntu: apt install libegl1, "
            "or libosmesa6 and MUJOCO_GL=osmesa"
        )
    context.make_current()
    try:
        yield backend
    finally:
        context.free()


@contextlib.contextmanager
def renderer(model: Any, width: int, height: int) -> Iterator[Callable[[Any], NDArray[np.uint8]]]:
    """Give a function that draws scenes of a model one after the other, (height, width, 3), inside of `offscreen`."""
    mujoco = import_mujoco()
    try:
        context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
    except mujoco.FatalError as error:
        raise ValueRangeError(
            f"picture: OpenGL cannot draw {width} × {height} pixels here ({error})"
        ) from None
    mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, context)
    rectangle = mujoco.MjrRect(0, 0, width, height)

    def draw(scene: Any) -> NDArray[np.uint8]:
        mujoco.mjr_render(rectangle, scene, context)
        pixels = np.empty((height, width, 3), dtype=np.uint8)
        mujoco.mjr_readPixels(pixels, None, rectangle, context)
        return pixels[::-1]

    try:
        yield draw
    finally:
        context.free()

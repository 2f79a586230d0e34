"""What constraints have around a robot, in pictures of physics: obstacles, zones, and the nearest pair."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from dqcontrol.constraints.constraint_view import NEAR, ConstraintView
from dqcontrol.geometry import Box, Capsule, Cylinder, Hull, InfiniteCylinder, Plane, Shape, Sphere
from dqcontrol.world.whereabouts import poses_of

if TYPE_CHECKING:
    from dqcontrol.arrays import Array
    from dqcontrol.loop.record import Record

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
        self._free = [
            (solid.shapes, poses_of(name, body, record.time, readings))
            for name, body in kept.free.items()
            for solid in body.solids
        ]
        self.moves: bool = bool(self._free) or bool(np.ptp(self._shifts, axis=1).any())
        drawn = [thing.shape for thing in kept.things] + [each for shapes, _ in self._free for each in shapes]
        self.most: int = 2 + sum(len(each.faces) if isinstance(each, Hull) else 1 for each in drawn)

    def add(self, mujoco: Any, scene: Any, k: int) -> None:
        """Add what belongs to sample k."""
        nearest = self._kept.nearest(self._record.q[k], float(self._record.time[k]))
        near = nearest is not None and nearest.room < NEAR
        for i, thing in enumerate(self._kept.things):
            close = near and nearest is not None and nearest.thing == i
            self._add_shape(
                mujoco,
                scene,
                thing.shape,
                self._shifts[i, k],
                _CLOSE if close else _ZONE if thing.is_zone else _SOLID,
            )
        for shapes, poses in self._free:
            for shape in shapes:
                self._add_shape(mujoco, scene, shape.moved(poses[k]), np.zeros(3), _WOOD)
        if near and nearest is not None and len(nearest.on_a):
            if nearest.link is not None:
                self._add_shape(mujoco, scene, nearest.link, np.zeros(3), (*_CLOSE[:3], 0.35))
            self._connect(mujoco, scene, nearest.on_a, nearest.on_b, _LINE * self._reach, (*_CLOSE[:3], 1.0))

    def _add_shape(
        self, mujoco: Any, scene: Any, shape: Shape, shift: Array, rgba: tuple[float, ...]
    ) -> None:
        if isinstance(shape, Capsule):
            self._connect(mujoco, scene, shape.start + shift, shape.end + shift, shape.radius, rgba)
            return
        if isinstance(shape, InfiniteCylinder):
            along = 2 * self._reach * shape.direction
            self._connect(
                mujoco, scene, shape.point - along + shift, shape.point + along + shift, shape.radius, rgba
            )
            return
        if isinstance(shape, Cylinder):
            kind = mujoco.mjtGeom.mjGEOM_CYLINDER
            self._connect(mujoco, scene, shape.start + shift, shape.end + shift, shape.radius, rgba, kind)
            return
        if isinstance(shape, Hull):
            for corners in shape.corners[shape.faces] + shift:
                self._triangle(mujoco, scene, corners, rgba)
            return
        turn, middle = np.eye(3), np.zeros(3)
        if isinstance(shape, Sphere):
            kind, size, middle = mujoco.mjtGeom.mjGEOM_SPHERE, np.full(3, shape.radius), shape.center
        elif isinstance(shape, Box):
            kind, size = mujoco.mjtGeom.mjGEOM_BOX, shape.row[1:4]
            middle, turn = shape.row[4:7], shape.row[7:].reshape(3, 3)
        elif isinstance(shape, Plane) and not self._is_floor(shape):
            kind, size = mujoco.mjtGeom.mjGEOM_BOX, np.array([self._reach, self._reach, _THIN])
            middle, turn = (shape.offset - _THIN) * shape.normal, shape.axes
        else:
            return
        colour = np.array(rgba, dtype=np.float32)
        geom = scene.geoms[scene.ngeom]
        mujoco.mjv_initGeom(
            geom, kind, np.array(size), np.array(middle) + shift, np.ravel(turn).copy(), colour
        )
        scene.ngeom += 1

    @staticmethod
    def _triangle(mujoco: Any, scene: Any, corners: Array, rgba: tuple[float, ...]) -> None:
        """Add a triangle, whose sides are the first two axes of its geom, of their lengths."""
        sides = np.diff(corners[[0, 1, 0, 2]], axis=0)[::2]
        axes = np.vstack([sides, np.cross(*sides)])
        size = np.linalg.norm(axes, axis=1)
        turn, colour = (axes / size[:, None]).T, np.array(rgba, dtype=np.float32)
        kind = mujoco.mjtGeom.mjGEOM_TRIANGLE
        mujoco.mjv_initGeom(scene.geoms[scene.ngeom], kind, size, corners[0], turn.ravel(), colour)
        scene.ngeom += 1

    def _is_floor(self, plane: Plane) -> bool:
        """Return whether a plane is as good as the floor that is drawn anyway."""
        return plane.normal[2] > 1 - 1e-6 and abs(plane.offset - self._floor) < 0.01

    def _connect(
        self,
        mujoco: Any,
        scene: Any,
        start: Array,
        end: Array,
        radius: float,
        rgba: tuple[float, ...],
        kind: Any = None,
    ) -> None:
        geom, kind = scene.geoms[scene.ngeom], mujoco.mjtGeom.mjGEOM_CAPSULE if kind is None else kind
        colour = np.array(rgba, dtype=np.float32)
        mujoco.mjv_initGeom(geom, kind, np.zeros(3), np.zeros(3), np.eye(3).ravel(), colour)
        mujoco.mjv_connector(geom, kind, radius, np.array(start), np.array(end))
        scene.ngeom += 1

"""Things around a robot in physics: tables, cubes that it may carry, and baskets to drop them into."""

from __future__ import annotations

import math
from typing import Annotated, Any, ClassVar

import numpy as np
from msgspec import Meta
from numpy.typing import ArrayLike, NDArray

from dqcontrol.errors import as_array, as_positive
from dqcontrol.named_fields import NamedFields
from dqcontrol.plants.mobile.wheeled_base import THINGS
from dqcontrol.plants.mujoco.mujoco_model import import_mujoco

Place = tuple[float, float]

_COLOURS = ((0.90, 0.20, 0.15, 1.0), (0.15, 0.45, 0.85, 1.0), (0.20, 0.65, 0.25, 1.0))
_WICKER = (0.78, 0.62, 0.38, 1.0)
_WOOD = (0.62, 0.47, 0.33, 1.0)


class Cube(NamedFields, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A cube that lies on the floor or on a table, or where it fell or was put.

    Parameters
    ----------
    position
        x and y of its centre at the start, m.
    yaw
        rad.
    side
        m.
    mass
        kg.
    friction
        Coulomb's coefficient, against everything.
    raised
        Height of what it lies on at the start, m.
    """

    spec_key: ClassVar[str] = "plant.scene.cubes"
    position: Annotated[Place, Meta(description="m")]
    yaw: Annotated[float, Meta(ge=-10, le=10, description="rad")] = 0.0
    side: Annotated[float, Meta(gt=0, le=10, description="m")] = 0.03
    mass: Annotated[float, Meta(gt=0, le=1e3, description="kg")] = 0.02
    friction: Annotated[float, Meta(ge=0, le=10)] = 0.8
    raised: Annotated[float, Meta(ge=0, le=10, description="m")] = 0.0


class Basket(NamedFields, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """An open square box that stands on the floor or on a table and does not move.

    Parameters
    ----------
    position
        x and y of its middle, m.
    side, height
        Inside, m.
    raised
        Height of what it stands on, m.
    """

    spec_key: ClassVar[str] = "plant.scene.baskets"
    position: Annotated[Place, Meta(description="m")]
    side: Annotated[float, Meta(gt=0, le=10, description="m")] = 0.16
    height: Annotated[float, Meta(gt=0, le=10, description="m")] = 0.08
    raised: Annotated[float, Meta(ge=0, le=10, description="m")] = 0.0

    def holds(self, position: ArrayLike) -> NDArray[np.bool_]:
        """Return which points, shape (…, 3), m, lie inside."""
        points = as_array("position", position, (3,))
        beside = np.abs(points[..., :2] - self.position).max(axis=-1)
        above = points[..., 2] - self.raised
        return (beside < self.side / 2) & (above > 0) & (above < self.height)


class TableBlock(NamedFields, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A table: a block on the floor that does not move.

    Parameters
    ----------
    position
        x and y of its middle, m.
    size
        Along x and y, m.
    height
        m.
    """

    spec_key: ClassVar[str] = "plant.scene.tables"
    position: Annotated[Place, Meta(description="m")]
    size: Annotated[Place, Meta(description="m")]
    height: Annotated[float, Meta(gt=0, le=10, description="m")]

    def __post_init__(self) -> None:
        for size in as_array("plant.scene.tables.size", self.size, (2,)):
            as_positive("plant.scene.tables.size", size)

    @property
    def corners(self) -> NDArray[np.float64]:
        """Its corners on the floor in order, shape (4, 2), m: a polygon of `dqcontrol.geometry.FloorMap`."""
        signs = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
        return np.array(self.position) + 0.5 * signs * np.array(self.size)


class Scene(NamedFields, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What lies and stands on the floor.

    Parameters
    ----------
    cubes, baskets
        Poses of cubes are recorded as ``cube_1_position``, ``cube_1_quaternion`` and so on.
    tables
        What they may stand on.
    """

    spec_key: ClassVar[str] = "plant.scene"
    cubes: Annotated[list[Cube], Meta(max_length=100)] = []
    baskets: Annotated[list[Basket], Meta(max_length=100)] = []
    tables: Annotated[list[TableBlock], Meta(max_length=100)] = []


def add_scene(spec: Any, scene: Scene) -> None:
    """Add the things of a scene to an ``mjSpec``."""
    mujoco = import_mujoco()
    box = mujoco.mjtGeom.mjGEOM_BOX
    for i, cube in enumerate(scene.cubes):
        half, turn = cube.side / 2, cube.yaw / 2
        body = spec.worldbody.add_body(
            name=f"cube_{i + 1}",
            pos=[*cube.position, cube.raised + half],
            quat=[math.cos(turn), 0, 0, math.sin(turn)],
        )
        body.add_freejoint(name=f"cube_{i + 1}")
        geom = body.add_geom(
            name=f"cube_{i + 1}", type=box, size=[half] * 3, mass=cube.mass, rgba=_COLOURS[i % len(_COLOURS)]
        )
        geom.contype, geom.conaffinity, geom.condim = THINGS, THINGS, 4
        geom.friction = [cube.friction, 0.1 * cube.side * cube.friction, 0]
    for table in scene.tables:
        block = spec.worldbody.add_geom(
            type=box,
            size=[*(0.5 * np.array(table.size)), table.height / 2],
            pos=[*table.position, table.height / 2],
            rgba=_WOOD,
        )
        block.contype, block.conaffinity, block.friction = THINGS, THINGS, [0, 0, 0]
    for basket in scene.baskets:
        _add_basket(spec.worldbody.add_body(pos=[*basket.position, basket.raised]), basket, box)


def _add_basket(body: Any, basket: Basket, box: Any) -> None:
    inside, wall, up = basket.side / 2, 0.003, basket.height / 2
    walls = [
        ([side * (inside + wall) * (axis == 0), side * (inside + wall) * (axis == 1), up], axis)
        for axis in (0, 1)
        for side in (-1, 1)
    ]
    for place, axis in walls:
        size = [inside + 2 * wall, inside + 2 * wall, up]
        size[axis] = wall
        geom = body.add_geom(type=box, size=size, pos=place, rgba=_WICKER)
        geom.contype, geom.conaffinity, geom.friction = THINGS, THINGS, [0, 0, 0]
    plate = body.add_geom(type=box, size=[inside, inside, wall / 2], pos=[0, 0, wall / 2], rgba=_WICKER)
    plate.contype, plate.conaffinity, plate.friction = THINGS, THINGS, [0, 0, 0]

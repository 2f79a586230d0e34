"""Zones on the floor that bodies of the world take, and that a mobile base keeps out of."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

import numpy as np
from msgspec import Meta

from dqcontrol.arrays import Array
from dqcontrol.errors import ShapeError, ValueRangeError, unknown_name
from dqcontrol.geometry import FloorMap
from dqcontrol.named_fields import NamedFields
from dqcontrol.references.ways_around import body_points
from dqcontrol.robots import Robot, WholeBody
from dqcontrol.robots.whole_body import Base
from dqcontrol.supervisor.supervisor_layout import ZONE_COLUMNS
from dqcontrol.world import Footprint, World, footprint


class KeepOutZones(NamedFields, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What bodies of the world take of the floor, which the footprint of a mobile base keeps out of.

    Parameters
    ----------
    clear_of
        ``all`` bodies that stand still, but planes, or some by name.
    world
        Whose bodies these are; a spec gives its own.
    footprint
        Radius of a disc about the base's (x, y) that holds the base, m; that of its shapes if omitted.
    margin
        Kept beside, m, for what is not known: the base drives on at its speed while its measurement is late and its
        motors lag, so at least its speed times both delays.

    Examples
    --------
    A base that is told to drive on stops 5 cm and its radius before a column:

    >>> import numpy as np, dqcontrol as dqc
    >>> column = dqc.world.Body(cylinder=(0.2, 1.0), position=(1, 0, 0.5))
    >>> zones = KeepOutZones(world=dqc.World(bodies={"column": column}), footprint=0.3)
    >>> cart = dqc.WholeBody([dqc.DifferentialDrive(0.05, 0.15, rim_speed=0.5)])
    >>> given = dqc.supervisor.Supervisor(keep_out=zones, slow_below=0.0, hold_below=0.0)
    >>> supervisor, q = given.prepare(cart, period=0.02), np.zeros(3)
    >>> state = supervisor.start(q)
    >>> for _ in range(200):
    ...     q = cart.integrate(q, supervisor.command(q, np.array([0.5, 0.0]), state), 0.02)
    >>> float(q[0].round(2)), "keep-out zone" in supervisor.reasons(state)
    (0.45, True)
    """

    spec_key: ClassVar[str] = "supervisor.keep_out"
    clear_of: Literal["all"] | Annotated[list[str], Meta(min_length=1)] = "all"
    world: World | None = None
    footprint: Annotated[float, Meta(gt=0, description="m")] | None = None
    margin: Annotated[float, Meta(ge=0, description="m")] = 0.05

    @property
    def footprints(self) -> dict[str, Footprint]:
        """What each body takes of the floor, by name.

        Raises
        ------
        Error
            If there is no world, it has no such body, or that does not stand still.
        """
        field = "supervisor.keep_out.clear_of"
        if self.world is None:
            raise ShapeError(f"{field}: names bodies of the world, and there is none; give 'world'")
        bodies = self.world.bodies
        stand = [name for name, body in bodies.items() if body.role == "fixed" and body.plane is None]
        for name in () if self.clear_of == "all" else self.clear_of:
            if name not in bodies:
                raise unknown_name(field, name, tuple(bodies))
            if name not in stand:
                raise ValueRangeError(
                    f"{field}: '{name}' takes no place on the floor that is always the same"
                )
        chosen = stand if self.clear_of == "all" else self.clear_of
        return {name: footprint(bodies[name]) for name in chosen}

    def rows(self) -> Array:
        """Return all as ``keep_out_step.clearance`` takes it, shape (N, 6)."""
        found = [np.zeros((0, ZONE_COLUMNS))]
        for each in self.footprints.values():
            x, y, radius = each.discs.T
            found.append(np.column_stack([x, y, x, y, radius, np.ones(len(x))]))
            found.append(_edges(each.floor))
        return np.vstack(found)

    def footprint_of(self, robot: Robot) -> float:
        """Return the radius of the footprint of a robot's base, m.

        Raises
        ------
        ShapeError
            If the robot does not stand on one mobile base.
        ValueRangeError
            If its base has no shapes, and no radius is given.
        """
        if not isinstance(robot, WholeBody) or not isinstance(robot.parts[0], Base) or len(robot.bases) > 1:
            raise ShapeError(
                f"supervisor.keep_out: is for robots whose first part is their only mobile base; {robot.name} is not"
            )
        if self.footprint is not None:
            return self.footprint
        body = body_points(robot, np.zeros(robot.configuration_size))
        own = ~body.carried
        if not own.any():
            raise ValueRangeError(
                f"supervisor.keep_out.footprint: the base of {robot.name} has no shapes; give the radius of a disc "
                "about its x, y that holds it, m"
            )
        return float((np.linalg.norm(body.points[own, :2], axis=1) + body.radius[own]).max())


def _edges(floor: FloorMap) -> Array:
    """Return the edges of all polygons as rows of zones."""
    found = []
    for corners in floor.polygons:
        rows = np.zeros((len(corners), ZONE_COLUMNS))
        rows[:, :2], rows[:, 2:4] = corners, np.roll(corners, -1, axis=0)
        rows[-1, -1] = 1.0
        found.append(rows)
    return np.vstack(found) if found else np.zeros((0, ZONE_COLUMNS))

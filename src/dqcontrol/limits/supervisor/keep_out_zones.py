"""Zones on the floor that a mobile base keeps out of, as a supervisor is given them."""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np
from msgspec import Meta

from dqcontrol.arrays import Array
from dqcontrol.errors import ShapeError, ValueRangeError, as_array, error_prefix
from dqcontrol.geometry import FloorMap, load_map
from dqcontrol.limits.supervisor.supervisor_layout import ZONE_COLUMNS
from dqcontrol.named_fields import NamedFields
from dqcontrol.references.ways_around import body_points
from dqcontrol.robots import Robot, WholeBody
from dqcontrol.robots.whole_body import Base

Point = tuple[float, float]


class KeepOutZone(NamedFields, frozen=True, kw_only=True, tag_field="kind", forbid_unknown_fields=True):
    """A zone on the floor, inertial frame; subclasses say which."""

    def rows(self) -> Array:
        """Return it as ``keep_out_step.clearance`` takes it, shape (N, 6)."""
        raise NotImplementedError


class CircularZone(KeepOutZone, frozen=True, kw_only=True, tag="circle"):
    """A disc about its centre (x, y), m."""

    center: Annotated[Point, Meta(description="m")]
    radius: Annotated[float, Meta(gt=0, description="m")]

    def rows(self) -> Array:
        """Return the disc."""
        x, y = as_array("center", self.center, (2,))
        return np.array([[x, y, x, y, self.radius, 1.0]])


class PolygonalZone(KeepOutZone, frozen=True, kw_only=True, tag="polygon"):
    """All that is inside of corners (x, y) in order, m."""

    corners: Annotated[list[Point], Meta(min_length=3, description="m")]

    def rows(self) -> Array:
        """Return its edges."""
        return _edges(FloorMap((np.array(self.corners),)))


class MapZone(KeepOutZone, frozen=True, kw_only=True, tag="map"):
    """What stands on a floor, from a file of polygons or a grid; see `dqcontrol.geometry.load_map`."""

    file: Annotated[str, Meta(min_length=1, description="path, relative to the spec")]

    def rows(self) -> Array:
        """Return the edges of its polygons."""
        return _edges(load_map(self.file))


class KeepOutZones(NamedFields, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Zones on the floor that the footprint of a mobile base keeps out of.

    Parameters
    ----------
    zones
        By name.
    footprint
        Radius of a disc about the base's (x, y) that holds the base, m; that of its shapes if omitted.
    margin
        Kept beside, m, for what is not known: the base drives on at its speed while its measurement is late and its
        motors lag, so at least its speed times both delays.

    Examples
    --------
    A base that is told to drive on stops 5 cm and its radius before a column:

    >>> import numpy as np, dqcontrol as dqc
    >>> zones = KeepOutZones(zones={"column": CircularZone(center=(1, 0), radius=0.2)}, footprint=0.3)
    >>> cart = dqc.WholeBody([dqc.DifferentialDrive(0.05, 0.15, rim_speed=0.5)])
    >>> given = dqc.limits.Supervisor(keep_out=zones, slow_below=0.0, hold_below=0.0)
    >>> supervisor, q = given.prepare(cart, dt=0.02), np.zeros(3)
    >>> state = supervisor.start(q)
    >>> for _ in range(200):
    ...     q = cart.integrate(q, supervisor.command(q, np.array([0.5, 0.0]), state), 0.02)
    >>> float(q[0].round(2)), "keep-out zone" in supervisor.reasons(state)
    (0.45, True)
    """

    spec_key: ClassVar[str] = "supervisor.keep_out"
    zones: Annotated[
        dict[
            Annotated[str, Meta(min_length=1, max_length=60)],
            CircularZone | PolygonalZone | MapZone,
        ],
        Meta(min_length=1),
    ]
    footprint: Annotated[float, Meta(gt=0, description="m")] | None = None
    margin: Annotated[float, Meta(ge=0, description="m")] = 0.05

    def rows(self) -> Array:
        """Return all zones as ``keep_out_step.clearance`` takes them, shape (N, 6)."""
        found = []
        for name, each in self.zones.items():
            with error_prefix(f"supervisor.keep_out.zones.{name}"):
                found.append(each.rows())
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

"""Expectations of a run, as its spec's ``outcome`` says them, and whether they were met."""

from __future__ import annotations

import math
from typing import Annotated, Literal, NamedTuple

import numpy as np
from msgspec import Meta, field

from dqcontrol import algebra
from dqcontrol.constraints.constraints import Constraints
from dqcontrol.constraints.prepared_constraints import PreparedConstraints
from dqcontrol.errors import ShapeError, ValueRangeError, unknown_name
from dqcontrol.experiments.spec.reference_spec import Part
from dqcontrol.loop.record import Record
from dqcontrol.measures.metrics import contact_force
from dqcontrol.plants.mujoco.world_model import DEPTH, FORCE, ITSELF, LINK
from dqcontrol.robots import Robot
from dqcontrol.tables.number_texts import angle_text, force_text, length_text
from dqcontrol.world import World

Name = Annotated[str, Meta(min_length=1, max_length=60)]
Length = Annotated[float, Meta(ge=0, description="m")]
_FORMS = {
    "body": (("inside",), ("opened",)),
    "clear_of": (("by",), ()),
    "hand": (("within",),),
    "deep": (("inside",),),
    "contact": ((),),
    "force": ((),),
}


class ForceBound(Part, frozen=True, kw_only=True):
    """The largest force that may be felt, N."""

    at_most: Annotated[float, Meta(ge=0, description="N")]


class Expectation(Part, frozen=True, kw_only=True):
    """One thing that is to be true: of a body or the end effector at the end, of distances and forces all the time.

    Parameters
    ----------
    body, inside, opened
        A body is in a container (key ``in``) at the end, or its hinge or slide so far open, rad or m.
    clear_of, by
        All bodies that stand still or move as they say, or some by name, are never nearer than that, m.
    hand, within
        ``at``: the end effector is at its reference at the end, within a length, m, and an angle, rad.
    deep, inside
        The end effector is so deep in a container (key ``in``) at the end, m below its rim.
    contact
        ``none``: no link touches a body or another link.
    force
        Neither does any body feel more than that.
    """

    body: Name | None = None
    inside: Name | None = field(default=None, name="in")
    opened: Annotated[float, Meta(description="rad or m")] | None = None
    clear_of: Literal["all"] | list[Name] | None = None
    by: Length | None = None
    hand: Literal["at"] | None = None
    within: tuple[Length, Annotated[float, Meta(ge=0, description="rad")]] | None = None
    deep: Annotated[float, Meta(gt=0, description="m")] | None = None
    contact: Literal["none"] | None = None
    force: ForceBound | None = None

    def check(self, world: World | None) -> None:
        """Raise unless it says one thing, of bodies that there are.

        Raises
        ------
        ShapeError, ValueRangeError, UnknownNameError
            With what is wrong.
        """
        given = {key for key in self.__struct_fields__ if getattr(self, key) is not None}
        leads = [key for key in _FORMS if key in given]
        if len(leads) != 1 or not any(given == {leads[0], *rest} for rest in _FORMS[leads[0]]):
            said = ", ".join("in" if key == "inside" else key for key in sorted(given))
            raise ShapeError(
                "expected one of {body, in}, {body, opened}, {clear_of, by}, {hand, within}, {deep, in}, {contact}, "
                f"{{force}}, got {{{said}}}"
            )
        bodies = {} if world is None else world.bodies
        named = [self.body, self.inside, *(self.clear_of if isinstance(self.clear_of, list) else ())]
        for name in named:
            if name is not None and name not in bodies:
                raise unknown_name("body", name, tuple(bodies))
        if self.inside is not None and bodies[self.inside].container is None:
            raise ValueRangeError(f"in: '{self.inside}' is no container")
        if self.opened is not None and self.body and bodies[self.body].role not in ("hinge", "slide"):
            raise ValueRangeError(f"opened: '{self.body}' is on no hinge or slide")


class Judged(NamedTuple):
    """Whether something was true, and what is said of it."""

    holds: bool
    words: str


def judge(
    given: Expectation,
    record: Record,
    robot: Robot,
    world: World | None,
    period: float,
    through: list[str],
) -> Judged:
    """Return whether a run met an expectation.

    Parameters
    ----------
    given, world
        As of the spec.
    record, robot, period
        Of the run; s.
    through
        What it went through, as nothing stopped it there.
    """
    felt_at = contact_force(record) if given.contact is not None or given.force is not None else None
    force = 0.0 if felt_at is None else float(felt_at.max(initial=0.0))
    if given.contact is not None:
        if felt_at is not None and force:
            when = record.time[int((felt_at > 0).argmax())]
            return Judged(False, f"contact: {force_text(force)} at {when:.3g} s")
        return Judged(not through, through[0] if through else "no contact")
    if given.force is not None:
        if felt_at is None:
            return Judged(False, "no force is felt: this plant has no physics of contact")
        most = given.force.at_most
        return Judged(force <= most, f"{force_text(force)} at most felt, {most:g} N allowed")
    if given.within is not None:
        near, turned = float(record.position_error[-1]), float(record.orientation_error[-1])
        holds = near <= given.within[0] and turned <= given.within[1]
        return Judged(holds, f"hand {length_text(near)} and {angle_text(turned)} off at the end")
    assert world is not None
    if given.deep is not None:
        return _deep(given.deep, str(given.inside), record, world)
    if given.clear_of is not None:
        return _clear(given, record, robot, world, period)
    body = world.bodies[str(given.body)]
    if given.inside is not None:
        return _inside(str(given.body), given.inside, record, world)
    turns = body.hinge is not None
    reading = record.readings.get(f"{given.body}_{'angle' if turns else 'way'}")
    if reading is None:
        return Judged(False, f"{given.body} does not move: this plant has no physics of the world")
    value, asked = float(reading.values[-1, 0]), float(given.opened or 0.0)
    said = [f"{math.degrees(x):.3g}°" if turns else length_text(x) for x in (value, asked)]
    opened = value >= asked if asked >= 0 else value <= asked
    return Judged(opened, f"{given.body} opened {said[0]}, {said[1]} asked")


def _inside(name: str, container: str, record: Record, world: World) -> Judged:
    reading = record.readings.get(f"{name}_position")
    at = np.array(world.bodies[name].position) if reading is None else reading.values[-1]
    away = float(world.bodies[container].away(at))
    words = "in" if away == 0.0 else f"{length_text(away)} from"
    return Judged(away == 0.0, f"{name} {words} {container}")


def _deep(asked: float, container: str, record: Record, world: World) -> Judged:
    body = world.bodies[container]
    assert body.container is not None
    seen = algebra.translation(algebra.multiply(algebra.conjugate(body.pose), record.pose[-1]))
    depth = body.container[-1] - float(seen[2])
    holds = bool(body.holds(record.position[-1]))
    words = f"hand {length_text(depth)} deep in {container}, {length_text(asked)} asked"
    return Judged(holds and depth >= asked, words if holds else f"hand not in {container}")


def _clear(given: Expectation, record: Record, robot: Robot, world: World, period: float) -> Judged:
    kept = Constraints(world=world, clear_of=given.clear_of, margin=given.by or 0.0, self_collision=False)
    prepared = PreparedConstraints(kept.unwatched, robot, period, "measured")
    values = prepared.values(record.q, record.time)
    if not values.size:
        return Judged(True, "nothing to keep clear of")
    at, row = np.unravel_index(int(values.argmin()), values.shape)
    near, asked = float(values[at, row]), given.by or 0.0
    thing, _, link = prepared.labels[row].partition(": ")
    where = "clear of" if near > 0 else "in"
    least = f"{link} {length_text(abs(near))} {where} {thing}"
    return Judged(near >= asked, f"{least} at {record.time[at]:.3g} s, {1e3 * asked:g} mm asked")


def hits(record: Record, robot: Robot) -> list[str]:
    """Return what links touched in physics, as ``"hit table: panda_link6 85 N, 1.2 mm deep at 2.1 s"``."""
    if FORCE not in record.readings:
        return []
    links = () if robot.shapes is None else robot.shapes.links
    force, depth = record.readings[FORCE], record.readings[DEPTH].values
    link, found = record.readings[LINK].values, []
    for i, name in enumerate(force.parts):
        if not (force.values[:, i] > 0).any():
            continue
        k = int(force.values[:, i].argmax())
        by = _link(links, link[k, i])
        if name == ITSELF:
            by = f"{by} and {_link(links, link[k, -1])}"
        deep = 1e3 * float(depth[:, i].max())
        found.append(
            f"hit {name}: {by} {force_text(float(force.values[k, i]))}, {deep:.2g} mm deep at {record.time[k]:.3g} s"
        )
    return found


def _link(links: tuple[str, ...], number: float) -> str:
    return links[int(number)] if 0 <= number < len(links) else "chassis"

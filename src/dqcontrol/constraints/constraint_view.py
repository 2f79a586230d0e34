"""Constraints for the eye: what stands around a robot at a time, and which pair is nearest to what was asked."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.constraints.constraints import ClearOf, Constraints, KeptBody
from dqcontrol.constraints.prepared_constraints import PreparedConstraints
from dqcontrol.geometry import Shape, distance
from dqcontrol.robots.robot import Robot
from dqcontrol.world import Body, Motion

_NOTHING = KeptBody([], [], Motion(), ClearOf())
NEAR = 0.02  # m beyond what is asked: a pair that has less room is near


class Thing(NamedTuple):
    """Something around a robot.

    Attributes
    ----------
    name
        Of the constraint.
    shape
        At time 0.
    is_zone
        Whether it is to stay inside, or at the free side.
    """

    name: str
    shape: Shape
    is_zone: bool


class NearestPair(NamedTuple):
    """The pair of shapes that has least room beyond what is asked.

    Attributes
    ----------
    label
        As ``table: panda_link5``.
    room
        What is left beyond what was asked for, m.
    on_a, on_b
        Points of the robot and of the other shape, shape (3,), m; empty where there is no such pair.
    link
        The robot's shape; None of the hand's point.
    thing
        Number of the other shape among `ConstraintView.things`; −1 where it is the robot's own.
    """

    label: str
    room: float
    on_a: Array
    on_b: Array
    link: Shape | None
    thing: int


class Surroundings:
    """What stands around a robot and moves by itself.

    Parameters
    ----------
    given
        The constraints.

    Attributes
    ----------
    things
        What is kept clear of, in its order, then zones, then what else stands around.
    free
        The bodies of the world, by name, of which only a recording says where they are: those that physics moves, and
        what hands hold; they are no things.
    """

    def __init__(self, given: Constraints) -> None:
        given = given.unwatched
        walls = [Thing(name, wall, True) for name, zone in given.zones.items() for wall in zone.shapes]
        named = [each for each in given.obstacles.items() if each[0] not in given.held]
        self._obstacles = [each.moves for _, each in named for _ in each.shapes]
        others = [
            (name, body)
            for name, body in (given.world.bodies.items() if given.world else ())
            if name not in given.obstacles and not body.is_recorded
        ]
        self._others = [body.moves or Motion() for _, body in others for _ in body.shapes]
        bodies = given.world.bodies if given.world else {}
        self.free: dict[str, Body] = {name: body for name, body in bodies.items() if body.is_recorded}
        further = [Thing(name, shape, False) for name, body in others for shape in body.shapes]
        solids = [Thing(name, shape, False) for name, each in named for shape in each.shapes]
        self.things: list[Thing] = [*solids, *walls, *further]

    def shifts(self, times: Array) -> Array:
        """Return how far each thing has moved at times (N,), s: shape (things, N, 3), m."""
        found = np.zeros((len(self.things), len(times), 3))
        for k, each in enumerate(self._obstacles):
            found[k] = each.shifts(times)
        for k, each in enumerate(self._others, len(self.things) - len(self._others)):
            found[k] = each.shifts(times)
        return found


class ConstraintView(Surroundings):
    """What constraints have around a robot, and which pair is nearest.

    Parameters
    ----------
    given
        The constraints.
    robot
        Of the run.
    period
        Of the run, s.
    """

    def __init__(self, given: Constraints, robot: Robot, period: float) -> None:
        super().__init__(given)
        # what hands hold where it stands: obstacles after the others, and no things
        self._held = [shape for name in given.held for shape in given.obstacles.get(name, _NOTHING).shapes]
        self._robot = robot
        self._prepared = PreparedConstraints(given.unwatched, robot, period, "measured")

    def nearest(self, q: Array, time: float) -> NearestPair | None:
        """Return the nearest pair at a configuration (n,), rad or m; None if only angles are kept."""
        kept = self._prepared
        if kept.is_angle.all() or not np.isfinite(q).all():
            return None
        room = np.where(kept.is_angle, np.inf, kept.values(q[None], [time])[0] - kept.asked)
        i = int(np.argmin(room))
        pair = kept.pair(i)
        frames = self._robot.frames(q)
        shown: list[Shape] = [
            each.shape if each.frame == 0 else each.shape.moved(frames[each.frame - 1]) for each in pair.links
        ]
        number, others = -1 if pair.obstacle is None else pair.obstacle, len(self._obstacles)
        if others <= number < others + len(self._held):
            shown.append(self._held[number - others])
            number = -1
        elif number >= others:
            number -= len(self._held)
        elif number >= 0:
            at = [*self.shifts(np.array([time]))[number, 0]]
            shown.append(self.things[number].shape.moved([1, 0, 0, 0, 0, *(0.5 * np.array(at))]))
        if len(shown) < 2:  # in a zone
            return NearestPair(kept.labels[i], float(room[i]), np.empty(0), np.empty(0), None, -1)
        found = distance(shown[0], shown[1])
        return NearestPair(kept.labels[i], float(room[i]), found.on_a, found.on_b, shown[0], number)

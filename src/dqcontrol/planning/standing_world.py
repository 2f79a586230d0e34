"""Constraints as a plan sees them: what moves as announced stands as the shape that it sweeps."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import NamedTuple

import msgspec
import numpy as np

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.constraints import Constraints
from dqcontrol.constraints.constraints import ClearOf, KeptBody
from dqcontrol.constraints.prepared_constraints import ball_around
from dqcontrol.errors import ValueRangeError
from dqcontrol.geometry import Plane
from dqcontrol.world import Body, Motion, Solid, World

_FAR = 20.0  # m: what moves on without end sweeps a line of this length, beyond any robot's reach
_MOST_PARTS = 100  # of a body
_SAME = 1e-9  # m between places that are one


def standing(constraints: Constraints, time: float = 0.0) -> Constraints:
    """Return constraints in which nothing moves, as a plan at a time (s) sees them.

    Of a shape that moves as announced, the ball around it is swept along what is left of its path: exact for balls,
    more than enough for others. What moves unannounced stands where it is. What a hand holds at the time stays in
    it, and what it does not hold stands where it is.

    Raises
    ------
    ValueRangeError
        If a plane moves, or a line of sight has a target that does.
    """
    bodies_now = constraints.world.bodies if constraints.world else {}
    moves = {name: bodies_now[name].moves for name in constraints.cleared}
    moving = {
        name for name, each in moves.items() if each and (each.velocity is not None or each.path is not None)
    }
    passing = {
        name for name, each in constraints.held.items() if each.held.since > 0 or each.held.until is not None
    }
    if not moving and not passing:
        return constraints
    for name, sight in constraints.sights.items():
        if sight.target in moving:
            raise ValueRangeError(
                f"constraints.sights.{name}.target: '{sight.target}' moves; a plan needs one that stands"
            )
    assert constraints.world is not None
    bodies = {name: bodies_now[name] for name in constraints.held}
    clear_of = {}
    for name in passing:
        if (body := _as_held(bodies.pop(name), time)) is not None:
            bodies[name] = body
    for name, kept in constraints.obstacles.items():
        if name in moving:
            body = bodies_now[name]
            bodies[name] = (
                _swept(name, kept, time) if kept.moves.announced else _stopped(body, kept.moves, time)
            )
        elif name not in passing:
            bodies[name] = bodies_now[name]
        elif name not in bodies:
            continue
        clear_of[name] = kept.clear if isinstance(constraints.clear_of, dict) else ClearOf()
    return msgspec.structs.replace(constraints, world=World(bodies=bodies), clear_of=clear_of)


def _as_held(body: Body, time: float) -> Body | None:
    """Return a body in the hand, or out of it, for good, as it is at a time (s); None if nobody knows where it is."""
    held = body.held
    assert held is not None
    if held.since <= time < held.ends:
        return msgspec.structs.replace(
            body, held=msgspec.structs.replace(held, since=0.0, until=None, put=None)
        )
    at = body.put_down if time >= held.ends else body
    never = msgspec.structs.replace(held, since=math.inf, until=None, put=None)
    return None if at is None else msgspec.structs.replace(at, held=never)


class _SweptPiece(NamedTuple):
    """What a ball sweeps from one place to another, (3,), m."""

    begin: Array
    end: Array
    radius: float

    def seen_from(self, place: Array, turn: Array) -> _SweptPiece:
        """Return the same in a frame at a place, turned by a rotation matrix."""
        return _SweptPiece((self.begin - place) @ turn, (self.end - place) @ turn, self.radius)

    def solid(self) -> Solid:
        """Return it as a shape."""
        way = self.end - self.begin
        length = float(np.linalg.norm(way))
        middle = tuple((0.5 * (self.begin + self.end)).tolist())
        if length < _SAME:
            return Solid(sphere=self.radius, position=middle)
        x, y, z = way / length
        rpy = (0.0, math.acos(min(max(float(z), -1.0), 1.0)), math.atan2(y, x))
        return Solid(capsule=(self.radius, length), position=middle, rpy=rpy)


def _stopped(body: Body, moves: Motion, time: float) -> Body:
    x, y, z = (np.asarray(body.position) + moves.shifts(np.array([time]))[0]).tolist()
    return msgspec.structs.replace(body, position=(x, y, z), moves=None)


def _swept(name: str, kept: KeptBody, time: float) -> Body:
    points, most = _points(kept.moves, time), max(_MOST_PARTS // len(kept.shapes), 1)
    pieces: list[_SweptPiece] = []
    for shape in kept.shapes:
        if isinstance(shape, Plane):
            raise ValueRangeError(f"world.{name}.moves: a plane that moves leaves nothing to plan in")
        ball = ball_around(shape)
        pieces += _pieces(ball[:3] + points, float(ball[3]), most)
    first = pieces[0].solid()
    matrix = algebra.matrix_from_pose(first.pose)
    parts = [each.seen_from(matrix[:3, 3], matrix[:3, :3]).solid() for each in pieces[1:]]
    return Body(**msgspec.structs.asdict(first), parts=parts)


def _points(moves: Motion, time: float) -> Array:
    """Return where the pieces of a motion begin and end from a time on, as shifts, shape (N, 3), m."""
    now = moves.shifts(np.array([time]))
    if moves.path is not None:
        rows = np.asarray(moves.path, np.float64)
        later = rows[rows[:, 0] > time, 1:]
        return np.vstack([now, later if len(later) else now])
    velocity = np.asarray(moves.velocity, np.float64)
    speed = float(np.linalg.norm(velocity))
    return np.vstack([now, now + velocity * (_FAR / speed if speed > 0 else 0.0)])


def _pieces(points: Array, radius: float, most: int) -> list[_SweptPiece]:
    """Return what a ball sweeps from point to point; of more than ``most`` pieces several in one that is wider."""
    stride = max(1, math.ceil((len(points) - 1) / most))
    corners = [*range(0, len(points) - 1, stride), len(points) - 1]
    found = []
    for begin, end in pairwise(corners):
        a, way = points[begin], points[end] - points[begin]
        passed = points[begin : end + 1] - a
        along = np.clip(passed @ way / max(float(way @ way), _SAME**2), 0.0, 1.0)
        beside = float(np.linalg.norm(passed - np.outer(along, way), axis=1).max())
        found.append(_SweptPiece(a, points[end], radius + beside))
    return found

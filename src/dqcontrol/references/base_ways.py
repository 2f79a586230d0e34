"""The ways of mobile bases from one place and heading to another: turns and lines, arcs for those that steer."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import product
from typing import NamedTuple

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.robots.kinematics import driving

_ARRIVED = 1e-6  # of a radius and rad: a word of arcs that ends nearer than that to its goal is a way
_NONE = 1e-12  # of a radius or rad: a shorter piece is left out
_LEFT, _STRAIGHT, _RIGHT = 1.0, 0.0, -1.0


class Piece(NamedTuple):
    """A turn, a straight line or an arc: the integrals of v and ω, m and rad, which keep their ratio on it.

    Attributes
    ----------
    shift
        What a straight line changes of x and y, m.
    """

    length: float
    angle: float
    shift: tuple[float, float] = (0.0, 0.0)


def turns_and_lines(start: Array, goal: Array, via: Sequence[Array] = ()) -> list[Piece]:
    """Return turn, drive, turn from one (x, y, φ) to another, straight from point to point of those (x, y) between.

    Each line is driven forwards or backwards, whichever turns less.
    """
    pieces, here = [], np.array(start, dtype=np.float64)
    for point in via:
        turn, length, _ = _turn_drive_turn(here, np.array([*point, here[2]]), both_turns=False)
        pieces += [Piece(0.0, turn), Piece(length, 0.0, _shift(here, point))]
        here = np.array([*point, here[2] + turn])
    turn, length, again = _turn_drive_turn(here, goal)
    return [*pieces, Piece(0.0, turn), Piece(length, 0.0, _shift(here, goal)), Piece(0.0, again)]


def _shift(start: Array, goal: Array) -> tuple[float, float]:
    return float(goal[0] - start[0]), float(goal[1] - start[1])


def _turn_drive_turn(start: Array, goal: Array, *, both_turns: bool = True) -> tuple[float, float, float]:
    """Return the angles and the signed length between two (x, y, φ)."""
    away = goal[:2] - start[:2]
    length = math.hypot(*away)
    bearing = math.atan2(away[1], away[0]) if length > 0 else start[2]
    ways = []
    for direction, sign in ((bearing, 1.0), (bearing + math.pi, -1.0)):
        turns = (math.remainder(angle, math.tau) for angle in (direction - start[2], goal[2] - direction))
        turn, again = turns
        ways.append((turn, sign * length, again))
    return min(ways, key=lambda way: abs(way[0]) + both_turns * abs(way[2]))


def arcs_and_lines(start: Array, goal: Array, radius: float) -> list[Piece]:
    """Return the shortest way of a base that steers between two (x, y, φ), of three arcs of a radius (m) and lines.

    It is the shortest of all words arc, line, arc and arc, arc, arc, each piece forwards or backwards: those that
    Dubins [1957] needs, and of Reeds and Shepp [1990] the ones of three pieces. One of them always leads there.
    """
    c, s = math.cos(start[2]), math.sin(start[2])
    dx, dy = (goal[:2] - start[:2]) / radius
    place = np.array([c * dx + s * dy, c * dy - s * dx, math.remainder(goal[2] - start[2], math.tau)])
    words = sorted(_words(place), key=lambda word: sum(abs(length) for _, length in word))
    best = next(word for word in words if _arrives(word, place))
    pieces = [
        Piece(radius * length, steer * length) if steer else Piece(radius * length, 0.0)
        for steer, length in best
        if abs(length) > _NONE
    ]
    return pieces or [Piece(0.0, 0.0)]


_Word = list[tuple[float, float]]  # steer to the left, ahead or to the right, and the signed length in radii


def _words(place: Array) -> Iterator[_Word]:
    """Yield candidates: the words that begin to the left, and what mirrors, reversal and time make of them."""
    for mirrored, backwards in product((1.0, -1.0), repeat=2):
        x, y, angle = backwards * place[0], mirrored * place[1], mirrored * backwards * place[2]
        found = _from_the_left(x, y, angle)
        # the same way driven from the goal to the start
        c, s = math.cos(angle), math.sin(angle)
        found += [word[::-1] for word in _from_the_left(x * c + y * s, x * s - y * c, angle)]
        for word in found:
            yield [(mirrored * steer, backwards * length) for steer, length in word]


def _from_the_left(x: float, y: float, angle: float) -> list[_Word]:
    """Return ways that begin with an arc to the left, in radii: LSL, LSR and LRL [Reeds and Shepp 1990, 8.1–8.3]."""
    a, b = x - math.sin(angle), y - 1.0 + math.cos(angle)
    far, first = math.hypot(a, b), math.atan2(b, a)
    found = [[(_LEFT, first), (_STRAIGHT, far), (_LEFT, math.remainder(angle - first, math.tau))]]
    if far <= 4.0:
        half = math.asin(0.25 * far)
        for turn, back in product((first + math.pi - half, first + half), (2.0 * half, -2.0 * half)):
            for middle in (back, back - math.copysign(math.tau, back)):
                last = math.remainder(angle - turn + middle, math.tau)
                found.append([(_LEFT, math.remainder(turn, math.tau)), (_RIGHT, middle), (_LEFT, last)])
    a, b = x + math.sin(angle), y - 1.0 - math.cos(angle)
    far, first = math.hypot(a, b), math.atan2(b, a)
    if far >= 2.0:
        line = math.sqrt(far * far - 4.0)
        turn = math.remainder(first + math.atan2(2.0, line), math.tau)
        found.append([(_LEFT, turn), (_STRAIGHT, line), (_RIGHT, math.remainder(turn - angle, math.tau))])
    return found


def _arrives(word: _Word, place: Array) -> bool:
    """Return whether a word leads from (0, 0, 0) to a place, lengths in radii."""
    here = np.zeros((1, 3))
    for steer, length in word:
        here = rolled(here, np.array([length]), np.array([steer * length]))
    away = here[0] - place
    away[2] = math.remainder(away[2], math.tau)
    return bool(np.abs(away).max() < _ARRIVED)


def rolled(poses: Array, lengths: Array, angles: Array) -> Array:
    """Return where bases at (x, y, φ), shape (N, 3), are after arcs of lengths (N,), m, and angles (N,), rad."""
    unicycle = np.zeros((1, driving.DRIVE_COLUMNS))
    out = np.empty_like(poses)
    driving.integrate(unicycle, np.ascontiguousarray(poses), np.column_stack([lengths, angles]), 1.0, out)
    return out

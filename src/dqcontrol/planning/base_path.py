"""Paths of bases that cannot move sideways: turns, lines and arcs one after the other, the arm held still.

Around what stands there RRT-Connect finds them, over the shortest words of arcs and lines.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dqcontrol.arrays import Array
from dqcontrol.constraints.prepared_constraints import PreparedConstraints
from dqcontrol.errors import from_extra
from dqcontrol.geometry import Box, FloorMap
from dqcontrol.planning.certified_edges import CertifiedEdges
from dqcontrol.planning.ways_between import WHAT, bounded, connected
from dqcontrol.references.base_ways import arcs_and_lines, rolled
from dqcontrol.references.ways_around import WaysAround, across, body_points, folded_posture
from dqcontrol.robots import Robot
from dqcontrol.world import floor_around, stands


class BasePath(NamedTuple):
    """What a base drives, over the length of its path; between pieces it has to rest.

    Lengths are √(l² + α²) of pieces that go l and turn by α, m and rad alike. Inputs v and ω stand in the columns of x
    and φ.

    Attributes
    ----------
    start
        Configuration at its begin, shape (n,).
    first
        Column of x; y and φ follow.
    pieces
        The integrals of v and ω on each, shape (K, 2), m and rad.
    """

    start: Array
    first: int
    pieces: Array

    @property
    def begins(self) -> Array:
        """Length of the path where each piece begins, and its end, shape (K + 1,)."""
        return np.concatenate([[0.0], np.cumsum(np.hypot(*self.pieces.T))])

    @property
    def places(self) -> Array:
        """Where each piece begins, and the end, (x, y, φ), shape (K + 1, 3)."""
        found = [self.start[self.first : self.first + 3]]
        for piece in self.pieces:
            found.append(rolled(found[-1][None], piece[:1], piece[1:])[0])
        return np.array(found)

    def at(self, lengths: Array) -> tuple[Array, Array, Array]:
        """Return configurations at lengths (N,), and first and second derivatives of the inputs' integrals, (N, n)."""
        piece, share = self._piece(lengths)
        done = self.pieces[piece] * share[:, None]
        q, along = np.tile(self.start, (len(lengths), 1)), np.zeros((len(lengths), len(self.start)))
        q[:, self.first : self.first + 3] = rolled(self.places[piece], done[:, 0], done[:, 1])
        sizes = np.hypot(*self.pieces.T)
        along[:, [self.first, self.first + 2]] = (self.pieces / sizes[:, None])[piece]
        return q, along, np.zeros_like(along)

    def driven(self, lengths: Array) -> Array:
        """Return the integrals of the inputs up to lengths (N,), shape (N, n)."""
        return self._summed(self.pieces, lengths)

    def travelled(self, lengths: Array) -> Array:
        """Return the same with what is driven back and forth counted alike."""
        return self._summed(np.abs(self.pieces), lengths)

    def parts(self) -> list[BasePath]:
        """Return it taken apart where the base rests."""
        return [
            self._replace(
                start=self.at(self.begins[k : k + 1])[0][0] if k else self.start,
                pieces=self.pieces[k : k + 1],
            )
            for k in range(len(self.pieces))
        ]

    def _summed(self, pieces: Array, lengths: Array) -> Array:
        piece, share = self._piece(lengths)
        before = np.vstack([np.zeros(2), np.cumsum(pieces, axis=0)])
        found = np.zeros((len(lengths), len(self.start)))
        found[:, [self.first, self.first + 2]] = before[piece] + pieces[piece] * share[:, None]
        return found

    def _piece(self, lengths: Array) -> tuple[NDArray[np.intp], Array]:
        begins = self.begins
        piece = np.clip(np.searchsorted(begins, lengths, side="right") - 1, 0, len(self.pieces) - 1)
        return piece, np.clip((lengths - begins[piece]) / np.diff(begins)[piece], 0.0, 1.0)


_AROUND = 4.0  # radii beyond both ends: room to turn round on either side
MARK = 0.1  # m, rad: of a motion, from where it is halved until it is proved


class SteeredPaths:
    """Paths of a base that steers, its arm as a configuration, (n,), has it; proved to keep what edges keep.

    Parameters
    ----------
    edges
        What is kept.
    arm
        A configuration, shape (n,), of whose base only the place changes.
    radius
        Of its arcs, m.
    """

    def __init__(self, edges: CertifiedEdges, arm: Array, radius: float) -> None:
        self._looked = 0
        self._edges, self._arm, self._radius = edges, arm, radius
        self._first = int(edges.robot.drives[0, 0])

    def pieces(self, a: Array, b: Array) -> Array | None:
        """Return lengths and angles of the pieces, (K, 2), of the shortest word from one (x, y, φ) to another.

        None if it does not keep what is asked.
        """
        self._looked += 1
        pieces = np.array([[each.length, each.angle] for each in arcs_and_lines(a, b, self._radius)])
        if not pieces.any():
            return np.empty((0, 2))
        q = self._arm.copy()
        q[self._first : self._first + 3] = a
        path = BasePath(q, self._first, pieces)
        return pieces if proved(self._edges, path) else None

    def to(self, poses: Sequence[Array], seed: int, effort: int) -> BasePath | None:
        """Return a path through (x, y, φ) one after the other, or None; a search looks at ``effort`` words at most.

        Every second motion is a narrow pass, of which the shortest word alone is tried.
        """
        found: list[Array] = []
        for k, (a, b) in enumerate(pairwise(poses)):
            pieces = self.pieces(a, b)
            if pieces is None and k % 2 == 0:
                pieces = self._searched(a, b, seed, effort)
            if pieces is None:
                return None
            found.append(pieces)
        q = self._arm.copy()
        q[self._first : self._first + 3] = poses[0]
        return BasePath(q, self._first, np.vstack(found))

    def _searched(self, a: Array, b: Array, seed: int, effort: int) -> Array | None:
        ob = from_extra("ompl.base", "plan", WHAT)
        most = self._looked + effort
        around = _AROUND * self._radius
        lower, upper = np.minimum(a, b)[:2] - around, np.maximum(a, b)[:2] + around
        space = bounded(ob.ReedsSheppStateSpace(self._radius), lower, upper)
        problem = connected(
            space,
            lambda first, second: self.pieces(_pose(first), _pose(second)) is not None,
            _state(space, a),
            [_state(space, b)],
            seed,
            lambda: self._looked >= most,
        )
        if not problem.hasExactSolution():
            return None
        return self._shortened([_pose(state) for state in problem.getSolutionPath().getStates()])

    def _shortened(self, poses: list[Array]) -> Array | None:
        """Return the pieces through some of these poses, as few as lead on from each."""
        found, k = [], 0
        while k + 1 < len(poses):
            for j in range(len(poses) - 1, k, -1):
                pieces = self.pieces(poses[k], poses[j])
                if pieces is not None:
                    break
            else:
                return None
            found.append(pieces)
            k = j
        return np.vstack(found)


def proved(edges: CertifiedEdges, path: BasePath) -> bool:
    """Return whether a path is proved to keep what edges keep."""
    inputs = edges.robot.input_coordinates
    marks = np.linspace(0.0, path.begins[-1], max(2, int(path.begins[-1] / MARK) + 1))

    def motion(lengths: Array) -> tuple[Array, Array]:
        return path.at(lengths)[0], path.travelled(lengths)[:, inputs]

    return edges.least_room_on(motion, marks).least >= 0


def _pose(state: Any) -> Array:
    return np.array([state.getX(), state.getY(), state.getYaw()])


def _state(space: Any, pose: Array) -> Any:
    state = space.allocState()
    state.setX(float(pose[0]))
    state.setY(float(pose[1]))
    state.setYaw(math.remainder(float(pose[2]), math.tau))
    return state


_STEP = 0.02  # m: between points of a way that are asked for room to turn
# m and rad: how far beside the line of a pass, and how far turned, others are tried: ways on grids bend in doors
_LOOKED = 16  # configurations of a pass of a base that drives, which is proved with the rest of its way
_ASIDE, _TURNED = np.linspace(-0.2, 0.2, 81), np.radians(np.linspace(-24.0, 24.0, 25))


def floor_kept(kept: PreparedConstraints) -> FloorMap | None:
    """Return what bodies that stand, and are kept clear of, take of the floor; None without any."""
    given = kept.given
    bodies = given.world.bodies if given.world else {}
    names = [name for name in given.cleared if stands(bodies[name]) and bodies[name].plane is None]
    return floor_around(given.world, names, "constraints.clear_of") if given.world and names else None


def narrow_passes(
    edges: CertifiedEdges, floor: FloorMap | None, start: Array, goal: Array
) -> list[tuple[Array, Array]]:
    """Return edges through narrow places of a floor on the way from a configuration (n,) to another, in their order.

    A disc as wide as the base's narrower side goes first; where its way leaves no room to turn, the base passes
    straight on, its longer side ahead, with the arm as it is or else folded; these are certified. Where a base drives,
    it passes with the arm as it is, and samples alone say that it is clear.
    """
    robot, margin = edges.robot, edges.kept.given.margin
    if floor is None or (half := _half_sizes(robot)) is None:
        return []
    first = robot.bases[0][0]
    here, there = start[first : first + 2], goal[first : first + 2]
    radius = float(half[1] if len(robot.drives) else half.min()) + margin
    corners = np.vstack([here, there, *floor.polygons])
    within = np.array([corners.min(axis=0) - 1.0, corners.max(axis=0) + 1.0])
    via = WaysAround(floor, here, radius, within).to(there)
    if via is None:
        return []
    corners = [here, *via, there]
    ways = [a + np.arange(0.0, 1.0, _STEP / math.dist(a, b))[:, None] * (b - a) for a, b in pairwise(corners)]
    points = np.vstack([*ways, there])
    clear = floor.clearance(points)
    for arm in (start,) if len(robot.drives) else (start, folded_posture(robot, start)):
        tight = np.diff(np.r_[False, clear < across(robot, arm) + margin, False].astype(int))
        places = zip(np.flatnonzero(tight > 0) - 1, np.flatnonzero(tight < 0), strict=True)
        ends = [points[[max(int(i), 0), min(int(j), len(points) - 1)]] for i, j in places]
        found = [
            _pass_between(edges, arm, *each, sideways=half[1] > half[0] and not len(robot.drives))
            for each in ends
        ]
        passes = [each for each in found if each is not None]
        if passes and len(passes) == len(found):
            return passes
    return []


def _half_sizes(robot: Robot) -> Array | None:
    """Return half of the length and width of a robot's only base: a box that moves sideways, or any that drives."""
    if len(robot.bases) != 1 or robot.shapes is None:
        return None
    if len(robot.drives):
        body = body_points(robot, np.zeros(robot.configuration_size))
        own = ~body.carried
        return (np.abs(body.points[own, :2]) + body.radius[own, None]).max(axis=0) if own.any() else None
    frame = robot.bases[0][0] + 3
    boxes = [
        each.shape for each in robot.shapes.shapes if each.frame == frame and isinstance(each.shape, Box)
    ]
    return 0.5 * np.asarray(boxes[0].size)[:2] if boxes else None


def _pass_between(
    edges: CertifiedEdges, arm: Array, begin: Array, end: Array, *, sideways: bool
) -> tuple[Array, Array] | None:
    """Return the edge with the most room near the line from one place, (2,), to another."""
    first = edges.robot.bases[0][0]
    half = 0.5 * math.dist(begin, end)
    along = (end - begin) / max(2.0 * half, 1e-9)
    heading = math.atan2(along[1], along[0]) + (0.5 * math.pi if sideways else 0.0)
    # ahead or backwards, whichever turns less
    heading += math.pi * round((arm[first + 2] - heading) / math.pi)
    aside, turn = (each.ravel() for each in np.meshgrid(_ASIDE, _TURNED))
    c, s = np.cos(turn), np.sin(turn)
    way = half * np.column_stack([c * along[0] - s * along[1], s * along[0] + c * along[1]])
    middles = 0.5 * (begin + end) + aside[:, None] * np.array([-along[1], along[0]])
    ends = np.tile(arm, (2, len(turn), 1))
    ends[:, :, first : first + 2] = middles - way, middles + way
    ends[:, :, first + 2] = heading + turn
    if len(edges.robot.drives):
        looked = ends[0][:, None] + np.linspace(0, 1, _LOOKED)[:, None] * (ends[1] - ends[0])[:, None]
        rooms = edges.room_at(looked.reshape(-1, len(arm)))[0].reshape(-1, _LOOKED).min(axis=1)
    else:
        found = edges.clear(ends[0], ends[1])
        rooms = np.where(found.certified, found.room, -np.inf)
    best = int(rooms.argmax())
    return (ends[0, best], ends[1, best]) if rooms[best] >= 0 else None

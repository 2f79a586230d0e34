"""Paths of a base that steers around what stands there: RRT-Connect over the shortest words of arcs and lines."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.planning.base_path import BasePath
from dqcontrol.planning.certified_edges import CertifiedEdges
from dqcontrol.planning.extra import from_extra
from dqcontrol.planning.ways_between import WHAT, connected
from dqcontrol.references.base_ways import arcs_and_lines

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
        ob = from_extra("ompl.base", WHAT)
        most = self._looked + effort
        space, bounds = ob.ReedsSheppStateSpace(self._radius), ob.RealVectorBounds(2)
        for i in range(2):
            bounds.setLow(i, float(min(a[i], b[i]) - _AROUND * self._radius))
            bounds.setHigh(i, float(max(a[i], b[i]) + _AROUND * self._radius))
        space.setBounds(bounds)
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

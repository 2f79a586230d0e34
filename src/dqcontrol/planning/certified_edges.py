"""Edges between configurations, proved to keep constraints on all of their length, not at samples.

A distance or angle of the constraints changes along a way by at most Σ lever |Δq|, with the levers that the prepared
constraints have for each of their rows. So a row that has more room in the middle of an interval than it can change by
on half of it is clear on all of the interval; only the rows that are left are asked again on both halves. What is
proved is a quadratic curve (1 − t)² a + 2 t (1 − t) c + t² b, of which an edge is the one with c in its middle: blended
corners are proved by the same function.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from copy import copy
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import OK, READ, READ2, STATUS, WRITE, WRITE2, inline, kernel, shared, types
from dqcontrol.compiled.memory_layout import MemoryLayout
from dqcontrol.constraints import Constraints, constraint_layout as layout, constraint_rows
from dqcontrol.constraints.prepared_constraints import PreparedConstraints
from dqcontrol.errors import ShapeError, ValueRangeError, as_array
from dqcontrol.planning.standing_world import standing
from dqcontrol.robots import Limits, Robot

# m or rad: how far a base that stands may be off its place, a tenth of what counts as rounding
_STANDS = 1e-10


def driven_coordinates(robot: Robot) -> NDArray[np.bool_]:
    """Return which coordinates are x, y and φ of bases that cannot move sideways, shape (n,)."""
    found = np.zeros(robot.configuration_size, dtype=bool)
    for first in robot.drives[:, 0].astype(int):
        found[first : first + 3] = True
    return found


def standing_at(robot: Robot, q: Array) -> Robot:
    """Return a robot whose driven bases stay where a configuration (n,) has them; another robot as it is."""
    driven, limits = driven_coordinates(robot), robot.limits
    if not driven.any():
        return robot
    standing = copy(robot)
    lower, upper = np.where(driven, q - _STANDS, limits.lower), np.where(driven, q + _STANDS, limits.upper)
    standing.limits = Limits(lower, upper, limits.velocity, limits.effort)
    return standing


DEPTH = 40  # halvings: 10⁻¹² of an edge, more than `_FINEST` ever asks for
_FINEST = 1e-4  # m or rad: of half an interval; what is not decided there is told as not certified
_TOLERANCE = 1e-4  # m: how much less than the least room found may be the least there is
_EASED = 3e-4  # m or rad: three times what is left undecided
_ROUNDING = 1e-9  # rad or m: a joint that a law has led to its end may be that much beyond it
PERIOD = 0.01  # s, of constraints that come without one; enters rates and allowances alone

CERTIFIED, SHARE, ROW, ROOM = 0, 1, 2, 3  # of an answer
ANSWER = 4


class ProofWork(NamedTuple):
    """Work of a proof.

    Attributes
    ----------
    middle
        Configuration in the middle of an interval.
    spans
        How much each row can change on a curve.
    todo, centers, counts
        By depth: intervals that are left there, the middle of the next, rows that are not decided.
    open_rows
        By depth those rows.
    """

    middle: Annotated[Array, "n"]
    spans: Annotated[Array, "rows"]
    todo: Annotated[Array, DEPTH + 1]
    centers: Annotated[Array, DEPTH + 1]
    counts: Annotated[Array, DEPTH + 1]
    open_rows: Annotated[Array, DEPTH + 2, "rows"]


proof_work: MemoryLayout[ProofWork] = MemoryLayout(ProofWork, "n", "rows")


class Proof(NamedTuple):
    """What functions of one proof are handed together.

    Attributes
    ----------
    coordinate
        The one that each input moves.
    needs
        What is asked of each row, m or rad.
    work
        See `ProofWork`.
    """

    chain: Array
    kept: layout.KeptRows
    scene: layout.RobotScene
    placed: layout.Placed
    coordinate: Array
    needs: Array
    work: ProofWork


@inline
def _write_spans(proof, curve, n):
    """Write how much rows can change on a curve: by no more than the larger of the rates at both of its ends."""
    kept = proof.kept
    for k in range(kept.rows.shape[0]):
        span = 0.0
        for j in range(kept.levers.shape[1]):
            i = int(proof.coordinate[j])
            rate = max(abs(curve[n + i] - curve[i]), abs(curve[2 * n + i] - curve[n + i]))
            span += kept.levers[k, j] * (2.0 * rate)
        proof.work.spans[k] = span


@shared
def certify_curve(proof, curve, tolerance, answer):
    """Prove that a curve, its three points in a row, keeps what is asked, and write the answer; return a status.

    With a tolerance ≥ 0 it finds the least room there is on the curve, to this tolerance, instead.
    """
    work, middle = proof.work, proof.work.middle
    n, rows = middle.shape[0], work.spans.shape[0]
    _write_spans(proof, curve, n)
    todo, centers, counts, open_rows = work.todo, work.centers, work.counts, work.open_rows
    for k in range(rows):
        open_rows[0, k] = float(k)
    counts[0], todo[0], centers[0] = float(rows), 1.0, 0.5
    answer[CERTIFIED], answer[SHARE], answer[ROW], answer[ROOM] = 1.0, 0.5, -1.0, math.inf
    depth = 0
    while depth >= 0:
        if todo[depth] == 0.0:
            depth -= 1
            continue
        todo[depth] -= 1.0
        half = 0.5 ** (depth + 1)
        t = centers[depth]
        centers[depth] = t + 2.0 * half
        for i in range(n):
            middle[i] = (
                (1.0 - t) ** 2 * curve[i] + 2.0 * t * (1.0 - t) * curve[n + i] + t * t * curve[2 * n + i]
            )
        status = constraint_rows.place_frames(proof.chain, middle, proof.scene, proof.placed)
        if status != OK:
            return status
        constraint_rows.place_bodies(proof.scene, proof.placed, 0.0)
        left, widest = 0, 0.0
        for place in range(int(counts[depth])):
            k = int(open_rows[depth, place])
            row, need, reach = layout.row_of(proof.kept.rows[k]), proof.needs[k], half * work.spans[k]
            level = answer[ROOM] - tolerance if tolerance >= 0.0 else 0.0
            if row.kind == layout.APART and constraint_rows.farther_than(
                proof.placed, row
            ) - need >= reach + max(level, 0.0):
                continue
            room = constraint_rows.value_of(proof.scene, proof.placed, row) - need
            if room < answer[ROOM]:
                answer[ROOM], answer[ROW], answer[SHARE] = room, float(k), t
            if tolerance < 0.0 and room < 0.0:
                answer[CERTIFIED] = 0.0
                return OK
            if tolerance >= 0.0:
                level = answer[ROOM] - tolerance
            if room - reach < level:
                open_rows[depth + 1, left] = float(k)
                left += 1
                widest = max(widest, reach)
        if left > 0:
            if (tolerance < 0.0 and widest < _FINEST) or depth + 1 >= DEPTH:
                answer[CERTIFIED] = 0.0
                return OK
            depth += 1
            counts[depth], todo[depth], centers[depth] = float(left), 2.0, t - 0.5 * half
    return OK


# chain, curves (N, 3 n), needs, parameters, tolerance, own work, scratch of constraints, answers (N, 4)
CERTIFY = STATUS(READ2, READ2, READ, READ, types.float64, WRITE, WRITE, WRITE2)


@inline
def proof_of(chain, n, needs, parameters, own, scratch):
    """Return what a proof is handed, with all that stands around where it is at time 0."""
    settings = layout.head(parameters)
    m = settings.inputs
    given, memory = layout.parameters_of(parameters, n, m, settings), layout.work_of(scratch, n, m, settings)
    kept, scene = layout.kept_of(given.kept, m, settings), layout.scene_of(given.scene, settings)
    way, placed = layout.way_of(given.way, n, m, settings), layout.placed_of(memory.placed, m, settings)
    constraint_rows.place_obstacles(scene, placed, 0.0, 0, 0.0, settings.period, settings.period)
    return Proof(chain, kept, scene, placed, way.coordinate, needs, proof_work(own, n, settings.rows))


@kernel(CERTIFY)
def certify_curves(chain, curves, needs, parameters, tolerance, own, scratch, answers):
    """Write of each curve whether it is certified, where it was looked at last, and the row with the least room."""
    n = curves.shape[1] // 3
    proof = proof_of(chain, n, needs, parameters, own, scratch)
    for e in range(curves.shape[0]):
        status = certify_curve(proof, curves[e], tolerance, answers[e])
        if status != OK:
            return status
    return OK


class EdgeCheck(NamedTuple):
    """What is known of edges; of a batch each field has an entry an edge.

    Attributes
    ----------
    certified
        Whether all of an edge is proved to keep what is asked.
    room
        The least room beyond what is asked, m or rad, where the edge was looked at: negative if it is crossed. A
        certified edge has no less than 0 anywhere.
    label
        The pair with that room, as ``table: panda_link5``, or the joint that is beyond its limit.
    share
        Where on the edge that is, 0 … 1.
    row
        Number of the pair among those that are kept: ``CertifiedEdges.kept`` says its shapes; −1 if there is none.
    """

    certified: Any
    room: Any
    label: Any
    share: Any
    row: Any


class Room(NamedTuple):
    """The least room beyond what is asked, m, and which pair has it; infinite without any pair."""

    least: float
    label: str


class CertifiedEdges:
    """Whether a robot keeps constraints on straight edges between configurations, all of their length.

    Parameters
    ----------
    robot
        An arm, two arms, a tree, or one of these on a base; one that cannot move sideways stands on all of an edge.
    constraints
        What is kept. What moves as announced counts as the shape that it sweeps. Prepared ones, of a law, are kept
        with what samples keep beyond them so that they hold between samples too.
    extra
        How much more than asked is to be kept, m or rad.

    Attributes
    ----------
    kept
        The constraints made ready.
    lower, upper
        Limits of the joints that are kept, shape (n,), infinite if the constraints do not keep them.
    proof, work
        For compiled code: chain, what is asked of each row, parameters; and memory.

    Raises
    ------
    ValueRangeError
        If constraints and robot do not fit.

    Examples
    --------
    >>> import dqcontrol as dqc
    >>> arm, start, goal = dqc.load_robot("panda"), [0, -0.8, 0, -2.4, 0, 1.6, 0.8], [1.5, -0.8, 0, -2.4, 0, 1.6, 0.8]
    >>> post = dqc.world.Body(capsule=(0.05, 1.0), position=(0.3, 0.2, 0.5))
    >>> keep = dqc.constraints.Constraints(world=dqc.World(bodies={"post": post}), clear_of="all")
    >>> edges = dqc.planning.CertifiedEdges(arm, keep)
    >>> found = edges.clear(start, goal)
    >>> found.certified, found.label
    (False, 'post: panda_link6')
    >>> edges.clear(start, start).certified
    True
    """

    def __init__(
        self, robot: Robot, constraints: Constraints | PreparedConstraints, extra: float = 0.0
    ) -> None:
        self.robot = robot
        self._driven = driven_coordinates(robot)
        self.kept: PreparedConstraints = prepared(robot, constraints)
        allowed = self.kept.allowances if isinstance(constraints, PreparedConstraints) else 0.0
        self._needs: Array = np.ascontiguousarray(self.kept.asked + allowed + extra)
        n, rows = robot.configuration_size, len(self._needs)
        limited = self._driven | self.kept.given.joint_limits
        self.lower: Array = np.where(limited, robot.limits.lower, -np.inf)
        self.upper: Array = np.where(limited, robot.limits.upper, np.inf)
        self.proof: tuple[Array, Array, Array] = (robot.table, self._needs, self.kept.parameters)
        self.work: tuple[Array, Array] = (np.zeros(proof_work.size(n, rows)), np.zeros(self.kept.scratch))
        self._pair, self._answer = np.empty((1, 3 * n)), np.empty((1, ANSWER))

    def clear(self, a: ArrayLike, b: ArrayLike) -> EdgeCheck:
        """Return what is known of the edges from a to b, shapes (n,) or (N, n), rad or m.

        Raises
        ------
        ShapeError, ValueRangeError
            If a size is wrong or a value not finite.
        """
        n = self.robot.configuration_size
        starts, ends = as_array("a", a, (n,)), as_array("b", b, (n,))
        lead = np.broadcast_shapes(starts.shape[:-1], ends.shape[:-1])
        first, last = (np.broadcast_to(each, (*lead, n)).reshape(-1, n) for each in (starts, ends))
        found = self.curves(np.hstack([first, 0.5 * (first + last), last]))
        if lead:
            return EdgeCheck(*(np.reshape(each, lead) for each in found))
        return EdgeCheck(*(each.tolist()[0] for each in found))

    def curves(self, points: Array) -> EdgeCheck:
        """Return what is known of quadratic curves by their three points, shape (N, 3 n)."""
        n = self.robot.configuration_size
        answers = self._proved(points, -1.0)
        labels = self.labels_of(answers)
        beyond = self.beyond_limits(points.reshape(-1, n)).reshape(-1, 3, n).max(axis=1)
        worst = beyond.argmax(axis=1)
        outside = beyond[np.arange(len(points)), worst] > _ROUNDING
        for k in np.flatnonzero(outside):
            labels[k] = f"{self.robot.joint_names[worst[k]]}: limit"
        room = np.where(outside, -beyond[np.arange(len(points)), worst], answers[:, ROOM])
        rows = np.where(outside, -1, answers[:, ROW]).astype(np.intp)
        return EdgeCheck((answers[:, CERTIFIED] > 0) & ~outside, room, labels, answers[:, SHARE], rows)

    def is_clear(self, a: Array, b: Array) -> bool:
        """Return whether one edge within the joints' limits is certified; made to be called often."""
        pair, n = self._pair[0], len(a)
        pair[:n], pair[2 * n :] = a, b
        pair[n : 2 * n] = 0.5 * (a + b)
        chain, needs, parameters = self.proof
        certify_curves(chain, self._pair, needs, parameters, -1.0, *self.work, self._answer)
        return bool(self._answer[0, CERTIFIED] > 0)

    def least_room(self, points: Array) -> Room:
        """Return the least room, m, of all distances on quadratic curves, shape (N, 3 n): proved, to 0.1 mm below."""
        needs = np.where(self.kept.is_angle, -np.inf, self._needs)
        answers = self._proved(points, _TOLERANCE, needs)
        if not np.isfinite(answers[:, ROOM]).any():
            return Room(math.inf, "")
        k = int(answers[:, ROOM].argmin())
        return Room(float(answers[k, ROOM]) - _TOLERANCE, self.labels_of(answers[k : k + 1])[0])

    def least_room_on(self, motion: Callable[[Array], tuple[Array, Array]], marks: Array) -> Room:
        """Return the least room on a motion between marks, shape (K,), of what it is asked at: proved, to 0.1 mm below.

        ``motion`` gives configurations (N, n), and how far each input has gone back and forth, (N, m). Where less than
        nothing is left, what is looked at first.
        """
        begin, end = marks[:-1], marks[1:]
        least, row = math.inf, -1
        while len(begin) and self._needs.size and least >= 0:
            middle = 0.5 * (begin + end)
            (q, gone), before, after = motion(middle), motion(begin)[1], motion(end)[1]
            rooms = self.kept.values(q, np.zeros(len(q))) - self._needs
            if rooms.min() < least:
                least, row = float(rooms.min()), int(rooms.min(axis=0).argmin())
            reach = np.maximum(gone - before, after - gone) @ self.kept.levers.T
            left = (rooms - reach < max(least - _TOLERANCE, 0.0)).any(axis=1)
            if (left & (reach.max(axis=1) < _FINEST)).any():
                return Room(-_FINEST, self.kept.labels[row])
            begin = np.concatenate([begin[left], middle[left]])
            end = np.concatenate([middle[left], end[left]])
        return Room(max(least - _TOLERANCE, min(least, 0.0)), self.kept.labels[row] if row >= 0 else "")

    def room_at(self, q: Array) -> tuple[Array, NDArray[np.intp]]:
        """Return the least room beyond what is asked at configurations, shape (N, n), m or rad, and the row with it."""
        if not self._needs.size:
            return np.full(len(q), np.inf), np.full(len(q), -1)
        rooms = self.kept.values(q, np.zeros(len(q))) - self._needs
        rows = rooms.argmin(axis=1)
        return rooms[np.arange(len(q)), rows], rows

    def said(self, q: Array, row: int | np.intp) -> str:
        """Say what a row is at a configuration, and what of it is asked."""
        return self.kept.text(
            int(row), float(self.kept.values(q[None], [0.0])[0, row]), float(self._needs[row])
        )

    def with_more(self, extra: float) -> CertifiedEdges:
        """Return the same with more room asked for, m or rad."""
        return self._asking(self._needs + extra)

    def eased_at(self, q: Array) -> CertifiedEdges:
        """Return the same with 0.3 mm less asked of what touches at a configuration, shape (n,).

        Where a distance is just what is asked, an edge that leads away is clear, and nothing proves it.
        """
        return self._asking(np.minimum(self._needs, self.kept.values(q[None], [0.0])[0] - _EASED))

    def _asking(self, needs: Array) -> CertifiedEdges:
        other = copy(self)
        other._needs = np.ascontiguousarray(needs)
        other.proof = (self.proof[0], other._needs, self.proof[2])
        return other

    def beyond_limits(self, q: Array) -> Array:
        """Return how far each joint is beyond its limits, shape (N, n), rad or m; negative inside."""
        return np.maximum(self.lower - q, q - self.upper)

    def labels_of(self, answers: Array) -> NDArray[np.object_]:
        """Return the labels of the rows that answers name."""
        return np.array([self.kept.labels[int(k)] if k >= 0 else "" for k in answers[:, ROW]], dtype=object)

    def _proved(self, points: Array, tolerance: float, needs: Array | None = None) -> Array:
        if not np.isfinite(points).all():
            raise ValueRangeError("edges: configurations must be finite")
        if (
            self._driven.any()
            and (np.ptp(points.reshape(len(points), 3, -1), axis=1)[:, self._driven] > _ROUNDING).any()
        ):
            raise ValueRangeError(
                f"edges: the base of {self.robot.name} drives on one, which is then not straight; drive-to plans that"
            )
        curves, answers = np.ascontiguousarray(points), np.empty((len(points), ANSWER))
        chain, own, parameters = self.proof
        asked = own if needs is None else needs
        status = certify_curves(chain, curves, asked, parameters, tolerance, *self.work, answers)
        if status != OK:
            raise ShapeError(f"edges: no poses of {self.robot.name} at these configurations")
        return answers


def prepared(robot: Robot, constraints: Constraints | PreparedConstraints) -> PreparedConstraints:
    """Return constraints made ready for a plan, in which nothing moves."""
    if not isinstance(constraints, PreparedConstraints):
        return PreparedConstraints(standing(constraints), robot, PERIOD, "measured")
    still = standing(constraints.given)
    return constraints if still is constraints.given else constraints.of(still)

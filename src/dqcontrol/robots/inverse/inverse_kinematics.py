"""Inverse kinematics: configurations that give the end effector a pose, and why there is none."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dqcontrol.arrays import Array
from dqcontrol.errors import ShapeError, ValueRangeError, as_array
from dqcontrol.robots.chain_robot import ChainRobot
from dqcontrol.robots.inverse import inverse_kernels
from dqcontrol.robots.limits import Limits, as_limit
from dqcontrol.robots.poses import unit_poses

_SHOWN = 20  # rows in notebooks
_ITERATIONS = 60  # a start; most need fewer than 15
_TRIALS = 64  # starts without limits, of which the solution nearest to the limits is reported
_ROUNDING = 1e-9  # m: no distance
_NEARLY = 1e-3  # m and rad: a failure so near the pose is a matter of convergence
_NEARLY_SINGULAR = 1e-2  # smallest singular value of the end effector's Jacobian


@dataclass(frozen=True, eq=False)
class Solution:
    """What `Robot.solve` found; for a batch of poses every field is an array with the batch's axes.

    Attributes
    ----------
    q
        Configuration, shape (…, n), rad or m, within the limits: the solution, or the nearest found.
    success
        Whether both errors are within their tolerances.
    position_error, orientation_error
        Distance (m) and angle (rad) between the end effector and the desired pose.
    iterations
        Damped Newton steps, over all starts.
    starts
        Configurations that were started from.
    reason
        Empty if it succeeded; else ``limits: …``, ``unreachable: …``, ``singular: …`` or ``tolerance: …``, and how
        much is missing.
    """

    q: Array
    success: Any
    position_error: Any
    orientation_error: Any
    iterations: Any
    starts: Any
    reason: Any

    def __repr__(self) -> str:
        if np.ndim(self.success):
            return f"Solution({np.count_nonzero(self.success)} of {np.size(self.success)} poses reached)"
        q = ", ".join(f"{value:.4g}" for value in self.q)
        return f"Solution([{q}], {'reached' if self.success else self.reason})"

    def _repr_markdown_(self) -> str:
        """Return what notebooks show: one row a pose."""
        lines = [
            "| reached | position error [m] | orientation error [rad] | q [rad or m] |",
            "|:--|--:|--:|:--|",
        ]
        success, reason, position, orientation = (
            np.ravel(each)
            for each in (self.success, self.reason, self.position_error, self.orientation_error)
        )
        for i, q in enumerate(self.q.reshape(-1, self.q.shape[-1])[:_SHOWN]):
            numbers = ", ".join(f"{value:.4g}" for value in q)
            state = "yes" if success[i] else reason[i]
            lines.append(f"| {state} | {position[i]:.2g} | {orientation[i]:.2g} | {numbers} |")
        more = len(success) - _SHOWN
        return "\n".join(lines) + (f"\n\n… and {more} more" if more > 0 else "")


class InverseKinematics(ChainRobot):
    """The inverse of `fkm`."""

    limits: Limits
    joint_types: tuple[str, ...]
    joint_names: tuple[str, ...]

    def solve(
        self,
        pose: ArrayLike,
        start: ArrayLike | None = None,
        *,
        position_tolerance: float = 1e-6,
        orientation_tolerance: float = 1e-6,
        restarts: int = 400,
        seed: int = 0,
    ) -> Solution:
        """Find a configuration within the joint limits that gives the end effector a pose.

        Damped Newton steps start from ``start``, then from random configurations, until one reaches the pose. The
        result is the same each time; with ``start`` near a solution it is that solution.

        Parameters
        ----------
        pose
            Desired unit dual quaternions, shape (…, 8), base frame; x and −x are the same.
        start
            First start, shape (…, n), rad or m, clamped to the limits; the middle of the limits if omitted.
        position_tolerance, orientation_tolerance
            m and rad; ``inf`` where the position or the orientation does not matter.
        restarts
            The most random starts that are tried after the first; a pose that needs more than 200 is one in thousands.
        seed
            Of the random starts.

        Raises
        ------
        ShapeError, ValueRangeError
            If a size or value is wrong. A pose that cannot be reached is no error: see `Solution`.

        Examples
        --------
        >>> import dqcontrol as dqc
        >>> arm = dqc.load_robot("iiwa7")
        >>> found = arm.solve(arm.fkm([0.3, 0.6, 0.1, -1.2, 0.2, 0.5, 0]))
        >>> found.success, found.position_error < 1e-6
        (True, True)
        >>> arm.solve(dqc.DualQuaternion.from_translation([2.0, 0, 0])).reason
        'unreachable: the position is 1.1 m beyond the reach of iiwa7'
        """
        problem = self._problem(position_tolerance, orientation_tolerance, restarts, seed)
        n, poses, guess = self.configuration_size, unit_poses("pose", pose), problem.middle
        if start is not None:
            guess = np.minimum(
                np.maximum(as_array("start", start, (n,)), problem.limits[0]), problem.limits[1]
            )
        if poses.ndim == guess.ndim == 1:
            q = guess.reshape(1, n).copy()
            reports = self._newton(problem, poses.reshape(1, 8), q)
            success, reason = problem.is_reached(*reports[0, :2]), ""
            if not success:
                success, reason = _explain(self, problem, poses.reshape(1, 8), q[0], reports[0])
            position, orientation, iterations, tried = reports[0].tolist()
            return Solution(q[0], success, position, orientation, int(iterations), int(tried), reason)
        batch_shape = _common_lead(poses, guess)
        rows = np.ascontiguousarray(np.broadcast_to(poses, (*batch_shape, 8)).reshape(-1, 8))
        q = np.array(np.broadcast_to(guess, (*batch_shape, n)).reshape(-1, n), order="C")
        reports = self._newton(problem, rows, q)
        reached = np.array([problem.is_reached(*report[:2]) for report in reports], dtype=bool)
        reasons = np.full(len(rows), "", dtype=object)
        for i in np.flatnonzero(~reached):
            reached[i], reasons[i] = _explain(self, problem, rows[i : i + 1], q[i], reports[i])
        position, orientation, iterations, tried = (column.reshape(batch_shape) for column in reports.T)
        return Solution(
            q.reshape(*batch_shape, n),
            reached.reshape(batch_shape),
            position,
            orientation,
            iterations.astype(int),
            tried.astype(int),
            reasons.reshape(batch_shape),
        )

    def _problem(self, position: float, orientation: float, restarts: int, seed: int) -> Problem:
        """Return what does not depend on the pose, of checked tolerances and numbers."""
        return prepare_inverse(
            self.limits,
            self.joint_types,
            as_limit("position_tolerance", position),
            as_limit("orientation_tolerance", orientation),
            _as_whole_number("restarts", restarts),
            _as_whole_number("seed", seed),
        )

    def _newton(self, problem: Problem, poses: Array, q: Array) -> Array:
        """Call the kernel: overwrite q and return the reports."""
        reports = np.empty((len(poses), 4))
        work = np.empty(inverse_kernels.work_size(self.configuration_size))
        inverse_kernels.solve(
            self.chain, problem.limits, problem.starts, poses, problem.options, q, reports, work
        )
        return reports


def solutions(
    arm: InverseKinematics, pose: Array, starts: Array, orientation_tolerance: float, restarts: int
) -> Array:
    """Return the configurations, (K, n), that starts, (N, n), lead to and that have the hand at a pose, (8,).

    What limits hold back goes on without them, and counts if it ends whole turns away from where they allow.
    """
    problem = prepare_inverse(arm.limits, arm.joint_types, 1e-6, orientation_tolerance, restarts, 0)
    q = starts.copy()
    reached = _reach(arm, problem, pose, q)
    held = q[~reached]
    free = _into_ranges(arm, held[_reach(arm, _without_limits(problem), pose, held)])
    inside = ((arm.limits.lower <= free) & (free <= arm.limits.upper)).all(axis=1)
    return np.vstack([q[reached], free[inside]])


def _reach(arm: InverseKinematics, problem: Problem, pose: Array, q: Array) -> NDArray[np.bool_]:
    """Overwrite starts, (N, n), by what they lead to, and return which of it has the hand at a pose, (8,)."""
    reports = arm._newton(problem, np.tile(pose, (len(q), 1)), q)
    return np.all(reports[:, :2] <= problem.options[:2], axis=1)


def _without_limits(problem: Problem) -> Problem:
    n = len(problem.middle)
    return problem._replace(
        limits=np.array([np.full(n, -np.inf), np.full(n, np.inf)]), starts=problem.starts[:0]
    )


class Problem(NamedTuple):
    """What does not depend on the pose: limits (2, n), random starts (K, n), the kernel's options, the first start."""

    limits: Array
    starts: Array
    options: Array
    middle: Array

    def is_reached(self, position_error: float, orientation_error: float) -> bool:
        """Return whether both errors are within their tolerances."""
        return bool(position_error <= self.options[0] and orientation_error <= self.options[1])


@functools.lru_cache(maxsize=32)  # drawing the starts takes longer than most solutions
def prepare_inverse(
    limits: Limits,
    joint_types: tuple[str, ...],
    position_tolerance: float,
    orientation_tolerance: float,
    restarts: int,
    seed: int,
) -> Problem:
    """Return what of an inverse kinematics problem does not depend on the pose; checked."""
    if math.isinf(position_tolerance) and math.isinf(orientation_tolerance):
        raise ValueRangeError("position_tolerance: must be finite if orientation_tolerance is inf")
    lower, upper = ranges(limits, joint_types)
    return Problem(
        np.array([limits.lower, limits.upper]),
        np.random.default_rng(seed).uniform(lower, upper, (restarts, len(lower))),
        np.array([position_tolerance, orientation_tolerance, _ITERATIONS]),
        0.5 * (lower + upper),
    )


def _explain(
    arm: InverseKinematics, problem: Problem, pose: Array, q: Array, report: Array
) -> tuple[bool, str]:
    """Return why a pose was not reached; or overwrite q and its report by a solution found on the way."""
    n, tolerances = arm.configuration_size, problem.options[:2]
    starts = problem.starts[: _TRIALS - 1]
    unlimited = _without_limits(problem)
    free = np.vstack([q, starts])
    found = arm._newton(unlimited, np.repeat(pose, len(free), axis=0), free)
    reached = (found[:, :2] <= tolerances).all(axis=1)
    if reached.any():
        nearest = _into_ranges(arm, free[reached])
        excess = np.maximum(arm.limits.lower - nearest, nearest - arm.limits.upper).max(axis=1)
        best = int(excess.argmin())
        if excess[best] <= 0:  # a full turn away from a solution within the limits
            q[:] = nearest[best]
            report[:2] = found[reached][best][:2]
            return True, ""
        return False, _beyond_limits(arm, nearest[best])
    if math.isfinite(tolerances[0]):
        only = np.array([tolerances[0], np.inf, _ITERATIONS])
        place = unlimited._replace(options=only, starts=starts)
        missing = float(arm._newton(place, pose, q[None].copy())[0, 0])
        if missing > max(tolerances[0], _ROUNDING):
            return False, f"unreachable: the position is {missing:.3g} m beyond the reach of {arm.name}"
    best = int((found[:, 0] + found[:, 1]).argmin())
    position, orientation = found[best, :2]
    if position < _NEARLY and orientation < _NEARLY:
        near = f"came within {position:.2g} m and {orientation:.2g} rad of the pose"
        smallest = np.linalg.svd(arm.hand_jacobian(free[best]), compute_uv=False)[-1]
        if smallest < _NEARLY_SINGULAR:
            return (
                False,
                f"singular: {near}, where the end effector's Jacobian has a singular value of {smallest:.2g}",
            )
        return False, f"tolerance: {near}; rounding allows no less than about 1e-15"
    few = f" (an arm of {n} joints has few orientations anywhere)" if n < 6 else ""
    return False, (
        "unreachable: the position can be reached, but not with this orientation; the nearest pose found is "
        f"{round(1e3 * position, 3):g} mm and {round(math.degrees(orientation), 3):g}° off{few}"
    )


def _beyond_limits(arm: InverseKinematics, q: Array) -> str:
    parts = []
    for i, value in enumerate(q):
        for side, bound, beyond in (
            ("lower", arm.limits.lower[i], value < arm.limits.lower[i]),
            ("upper", arm.limits.upper[i], value > arm.limits.upper[i]),
        ):
            if beyond:
                unit = "rad" if arm.joint_types[i] == "revolute" else "m"
                forms = (f".{digits}g" for digits in range(3, 18))  # the first that tells one from the other
                form = next(form for form in forms if format(value, form) != format(bound, form))
                parts.append(f"{arm.joint_names[i]} at {value:{form}} {unit} ({side} limit {bound:{form}})")
    return f"limits: the nearest solution found has {', '.join(parts)}"


def _into_ranges(arm: InverseKinematics, q: Array) -> Array:
    """Return q with each revolute joint turned by full turns into its range, or as near as that gets."""
    lower, upper = ranges(arm.limits, arm.joint_types)
    revolute = np.array([kind == "revolute" for kind in arm.joint_types])
    turns = 2 * np.pi * np.round((q - 0.5 * (lower + upper)) / (2 * np.pi))
    return np.where(revolute, q - turns, q)


def ranges(limits: Limits, joint_types: tuple[str, ...]) -> tuple[Array, Array]:
    """Return the limits, ±π rad or ±1 m from zero or from the other limit where there is none."""
    lower, upper = limits.lower, limits.upper
    half = np.array([np.pi if kind == "revolute" else 1.0 for kind in joint_types])
    low = np.where(np.isfinite(lower), lower, np.where(np.isfinite(upper), upper - 2 * half, -half))
    return low, np.where(np.isfinite(upper), upper, low + 2 * half)


def _common_lead(poses: Array, guess: Array) -> tuple[int, ...]:
    try:
        return np.broadcast_shapes(poses.shape[:-1], guess.shape[:-1])
    except ValueError:
        raise ShapeError(
            f"start: leading axes {guess.shape[:-1]} do not fit those of pose, {poses.shape[:-1]}"
        ) from None


def _as_whole_number(field: str, value: int) -> int:
    """Return a whole number ≥ 0, or raise a `ValueRangeError`."""
    if not isinstance(value, int | np.integer) or isinstance(value, bool) or value < 0:
        raise ValueRangeError(f"{field}: must be a whole number ≥ 0, got {value!r}")
    return int(value)

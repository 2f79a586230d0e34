"""What a control law is, and a law made ready for one robot, reference and period."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from msgspec import Struct
from numpy.typing import ArrayLike, NDArray

from dqcontrol.compile import NOT_FINITE, RAISED, SINGULAR, InterpretedKernel, Kernel
from dqcontrol.errors import DivergedError, Error, ShapeError, ValueRangeError, as_array, as_positive
from dqcontrol.laws.inverses import work_size
from dqcontrol.laws.loop_rates import LoopRates
from dqcontrol.laws.null_space import WORK_SIZE, AnyNullSpace, no_preference
from dqcontrol.limits.command_limits import CommandLimits, unlimited
from dqcontrol.limits.position_limit import LAW as LAW
from dqcontrol.limits.position_limit import law_alone
from dqcontrol.references.sample import TIME, Sample
from dqcontrol.robots.chain_robot import Kinematics
from dqcontrol.robots.robot import Robot

if TYPE_CHECKING:
    from dqcontrol.references import Reference

Array = NDArray[np.float64]

SCRATCH = 48  # numbers of work between the preferred motion and the task matrix
_MOST_STEPS = 10_000_000


class Law(Struct, frozen=True, kw_only=True, tag_field="kind", forbid_unknown_fields=True):
    """Parameters of a control law; subclasses name a kernel of signature ``LAW``."""

    kernel: ClassVar[Kernel | InterpretedKernel]
    null_space: AnyNullSpace | None = None

    def parameter_rows(self, robot: Robot, times: Array) -> Array:
        """Return the kernel's parameters at each time, shape (N, p), or (1, p) if they are constant."""
        raise NotImplementedError

    def work_size(self, robot: Robot) -> int:
        """Return room for the preferred motion, scratch, a task matrix and the solver's own."""
        return SCRATCH + 9 * robot.input_size + work_size()

    def state_size(self, robot: Robot) -> int:
        """Return how many numbers are kept from sample to sample."""
        return 1

    def initial_state(self, robot: Robot, q: Array) -> Array:
        """Return the state before the first sample, at configuration q."""
        return np.zeros(self.state_size(robot))

    def horizon(self, reference: Reference | None) -> float:
        """Return the time after which the parameters no longer change, s."""
        return 0.0

    def loop_rates(self, parameters: Array) -> LoopRates | None:
        """Return how fast small errors decay at each of the rows of a prepared law; None if that is unknown."""
        return None

    def prepare(
        self, robot: Robot, reference: Reference | None, dt: float, limits: CommandLimits | None = None
    ) -> PreparedLaw:
        """Check the parameters and compute what depends on time.

        Parameters
        ----------
        robot
            The robot to drive.
        reference
            The motion to follow; None where a law needs no horizon.
        dt
            Control period, s.
        limits
            What is done to the command before it leaves.

        Raises
        ------
        Error
            If a parameter is not allowed; nothing is raised later for that reason.
        """
        dt = as_positive("dt", dt)
        rows = np.ascontiguousarray(self.rows(robot, reference, dt), dtype=np.float64)
        return PreparedLaw(self, robot, rows, dt, limits or CommandLimits())

    def rows(self, robot: Robot, reference: Reference | None, dt: float) -> Array:
        """Return the kernel's parameters, one row a sample as long as they change, shape (K, p)."""
        steps = math.ceil(max(self.horizon(reference), 0.0) / dt - 1e-9) + 1
        check_steps("gain schedule", steps)
        return self.parameter_rows(robot, dt * np.arange(steps, dtype=np.float64))

    def command(
        self, robot: Robot, q: ArrayLike, sample: Sample, dt: float, state: Array | None = None
    ) -> Array:
        """Return the inputs for one sample; prepare the law once instead when there are many."""
        prepared = self.prepare(robot, None, dt)
        values = as_array("q", q, (robot.configuration_size,))
        return prepared.command(values, sample, prepared.initial_state(values) if state is None else state)


class PreparedLaw:
    """A law with its parameters over time for one robot; it holds scratch memory, so use one in each thread.

    Attributes
    ----------
    kernel
        Compiled function of signature ``LAW``.
    parameters
        One row a sample, or one row for all, shape (K, p).
    dt
        Control period, s.
    """

    def __init__(self, law: Law, robot: Robot, parameters: Array, dt: float, limits: CommandLimits) -> None:
        self.kernel = law.kernel
        self.robot = robot
        self.parameters = parameters
        self.dt = dt
        self.preference = law.null_space.kernel if law.null_space else no_preference
        self.preference_parameters = law.null_space.parameters(robot) if law.null_space else np.zeros(0)
        self.limit, self.limit_parameters = limits.prepare(robot)
        position = limits.position
        self.position_limit = position.kernel if position else law_alone
        self.position_limit_parameters = position.parameters(robot, dt) if position else np.zeros(0)
        self._law = law
        self._memory = position.memory(robot) if position else 0
        self.state_size = law.state_size(robot) + self._memory
        self.position_limit_work: Array = np.zeros(robot.input_size + self.state_size)
        self._last, self._row = len(parameters) - 1, parameters[0]
        self.work: Array = np.zeros(law.work_size(robot))
        self.preferred = self.work[: robot.input_size]
        self.preference_work: Array = np.zeros(WORK_SIZE)
        self.kinematics = Kinematics(robot.input_size)

    @cached_property
    def _command(self) -> Callable[..., int]:
        return self.kernel.compiled if isinstance(self.kernel, Kernel) else self.kernel

    def initial_state(self, q: ArrayLike) -> Array:
        """Return the state before the first sample.

        Parameters
        ----------
        q
            Measured configuration, shape (n,), rad or m.

        Raises
        ------
        ShapeError, ValueRangeError
            If q has the wrong size, or is not finite.
        """
        values = as_array("q", q, (self.robot.configuration_size,))
        return np.concatenate([self._law.initial_state(self.robot, values), np.zeros(self._memory)])

    def command(self, q: Array, sample: Sample, state: Array, out: Array | None = None) -> Array:
        """Return the inputs u for one sample.

        Parameters
        ----------
        q
            Measured configuration, shape (n,), rad or m.
        sample
            Desired pose, twist and twist rate, inertial frame.
        state
            From `initial_state`; updated in place.
        out
            Written in place and returned, if given, shape (m,).

        Returns
        -------
        u : ndarray, shape (m,)
            rad/s or m/s.

        Raises
        ------
        ShapeError, ValueRangeError
            If q or ``out`` has the wrong size, or q is not finite.
        Error
            If the state does not come from `initial_state`.
        DivergedError
            If the result is not finite.
        """
        m = self.robot.input_size
        if out is None:
            out = np.empty(m)
        elif len(out) != m:
            raise ShapeError(f"out: expected shape ({m},), got {out.shape}")
        if type(state) is not np.ndarray or len(state) != self.state_size:
            self._refuse(state)
        data = sample.data
        row = 0 if self._last == 0 else max(round(data.item(TIME) / self.dt), 0)
        try:
            self.step(q, data, row, state, out)
        except TypeError:  # a list, integers
            if state.dtype != np.float64 or state.ndim != 1:
                self._refuse(state)
            values = as_array("q", q, (self.robot.configuration_size,))
            self.step(values, data, row, state, out)
        return out

    def _refuse(self, state: object) -> None:
        raise Error(
            f"state: expected the array from initial_state, {self.state_size} numbers, got {state!r:.80}"
        )

    def step(self, q: Array, sample: Array, k: int, state: Array, out: Array) -> None:
        """Write the inputs for sample number k, given as an array (21,); what `command` and the loop call."""
        found = self.robot.kinematics(q, self.kinematics)
        pose, pose_jacobian, twist_jacobian = found.pose, found.pose_jacobian, found.twist_jacobian
        if self.preference is not no_preference:
            self.preference(
                q, twist_jacobian, self.preference_parameters, self.preference_work, self.preferred
            )
        row = self._row if self._last == 0 else self.parameters[min(k, self._last)]
        if self.position_limit is law_alone:
            status = self._command(q, pose, pose_jacobian, twist_jacobian, sample, row, state, self.work, out)
        else:
            asked = q, pose, pose_jacobian, twist_jacobian, sample, row, state, self.work
            own = self.position_limit_parameters, self.position_limit_work
            if isinstance(self.kernel, Kernel):
                status = self.position_limit(self.kernel.pointer, *asked, *own, out)
            else:
                status = self.position_limit.function(self.kernel, *asked, *own, out)
        if status:
            raise DivergedError(status_text(status))
        if self.limit is not unlimited:
            self.limit(q, self.limit_parameters, out)


_STATUS = {
    NOT_FINITE: "the command is not finite",
    SINGULAR: "the damped system is singular; use more damping or the filtered inverse",
    RAISED: "your own function raised an exception",
}


def status_text(status: int) -> str:
    """Say what a law's status code means."""
    return _STATUS.get(status, f"the law failed with status {status}")


def check_steps(what: str, steps: float) -> None:
    """Raise a `ValueRangeError` if something would take more than ten million steps."""
    if not steps <= _MOST_STEPS:
        raise ValueRangeError(f"{what}: takes {steps:,.0f} steps; at most 10 million")

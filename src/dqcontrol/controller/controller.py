"""The controller: a law prepared for one robot, with its tasks, limits and constraints."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import NOT_FINITE, RAISED, SINGULAR, InterpretedKernel, Kernel
from dqcontrol.compiled.intrinsics import LAW as LAW
from dqcontrol.contact.admittance import NO_GUARDS
from dqcontrol.contact.contact_layout import (
    CONTACT_STATE,
    UNTOUCHED,
    WRENCH,
    contact_parameters,
    contact_state,
    contact_work,
)
from dqcontrol.contact.guided_step import guide_again
from dqcontrol.controller.command_kernel import (
    LAW_FAILED,
    Plan,
    Prepared,
    PreparedMemory,
    compute_command,
    note_left,
    note_sent,
    prepared_memory,
    sent,
    step,
)
from dqcontrol.controller.task_levels import PreparedTasks, task_levels
from dqcontrol.errors import DivergedError, Error, ShapeError, ValueRangeError, as_array
from dqcontrol.laws.growth import growth_for
from dqcontrol.laws.inverses import FilteredInverse, inverse_parameters
from dqcontrol.laws.null_space import WORK_SIZE
from dqcontrol.limits.command_limits import CommandLimits
from dqcontrol.limits.rates import unlimited
from dqcontrol.references.sample import TIME, Sample
from dqcontrol.robots.kinematics.kinematics_kernels import split
from dqcontrol.robots.robot import AT_ONCE, CommandMode, Lag, Robot

if TYPE_CHECKING:
    from dqcontrol.constraints.prepared_constraints import PreparedConstraints
    from dqcontrol.laws.law import Law
    from dqcontrol.references import Reference
    from dqcontrol.references.sequence import Guards

_GROWTH = inverse_parameters.place("growth")  # its share follows


class Controller:
    """A law with its parameters over time for one robot; it holds scratch memory, so use one in each thread.

    Attributes
    ----------
    kernel
        Compiled function of signature ``LAW``.
    parameters
        One row a sample, or one row for all, shape (K, p).
    period
        Control period, s.
    pose, preferred
        Pose of the end effector (8,) and motion preferred in the null space (m,) at the last command.
    constraints
        What is kept, made ready; None without.
    wrench
        Force and torque that the sensor measures, shape (6,), N and N·m, for a law with contact: who has a measurement
        writes it here before each command, and NaN where there is none. Empty without contact.
    report
        What became of that at the last command, see ``Report``; empty without constraints.
    """

    work: Array
    preferred: Array
    pose: Array

    def __init__(
        self,
        law: Law,
        robot: Robot,
        parameters: Array,
        period: float,
        limits: CommandLimits,
        command_mode: CommandMode,
        tasks: PreparedTasks | None = None,
        lag: Lag = AT_ONCE,
        guards: Guards = NO_GUARDS,
    ) -> None:
        self.kernel: Kernel | InterpretedKernel = law.kernel
        self.robot = robot
        self.period = period
        self._law, self._limits, self._guards = law, limits, guards
        self.tasks = tasks
        if tasks is not None and limits.position:
            raise ValueRangeError(
                "limits.position: keeps the limits for the law's own task alone; with further tasks give "
                "'constraints', which keep them for all"
            )
        self._command_mode: CommandMode = command_mode
        self._lag: Lag = lag
        empty, m, position = np.zeros(0), robot.input_size, limits.around
        self.constraints: PreparedConstraints | None = None
        if law.constraints is not None:
            if limits.compensation is not None:
                raise ShapeError(
                    "limits.compensation: does not go together with constraints; leave one of them out"
                )
            if position is not None:
                raise ShapeError(
                    "limits.position: constraints keep joints within their limits; leave one of them out"
                )
            self.constraints = law.constraints.prepare(robot, period, command_mode, lag)
        inverse = getattr(law, "inverse", None)
        self._grows = isinstance(inverse, FilteredInverse) and inverse.growth is None
        if self._grows:  # with the parameters of its inverse those of the law begin
            parameters = parameters.copy()
            for i, each in enumerate(growth_for(robot, law.loop_rates(parameters), lag.late, period)):
                parameters[:, _GROWTH + i] = each
        law_memory = law.state_size(robot)
        contact = law.contact
        self._contact_at, contact_memory = law_memory, CONTACT_STATE if contact else 0
        memory = position.memory(robot, command_mode, period) if position else 0
        if self.constraints:
            memory = self.constraints.memory
        self._memory_size = contact_memory + memory
        self.state_size: int = law_memory + contact_memory + memory
        self._feedback = law.delivered_at, law.last_at, self.state_size - m if memory else 0
        self._preference = law.null_space.kernel if law.null_space else None
        self._position_limit = position.kernel if position else None
        limit, limit_parameters = limits.prepare(robot)
        self._limit = limit if limit is not unlimited else None
        parts = PreparedMemory(
            table=robot.table,
            preferring=law.null_space.parameters(robot) if law.null_space else empty,
            preference_work=np.zeros(WORK_SIZE),
            parameters=parameters,
            work=np.zeros(law.work_size(robot)),
            kinematics=np.zeros(8 + 14 * m),
            position_limiting=position.parameters(robot, period, command_mode, limit_parameters)
            if position
            else empty,
            position_limit_work=np.zeros(2 * m + self.state_size),
            limiting=limit_parameters,
            tasking=tasks.parameters if tasks else empty,
            tasking_work=np.zeros(
                tasks.work_size + (robot.input_size**2 if self.constraints else 0) if tasks else 0
            ),
            constraining=self.constraints.parameters if self.constraints else empty,
            constraint_work=np.zeros(self.constraints.scratch) if self.constraints else empty,
            contacting=contact.parameters(period, guards) if contact else empty,
            contact_work=np.append([np.nan] * WRENCH, np.zeros(contact_work.size() + m - WRENCH))
            if contact
            else empty,
        )
        self.memory: Array = prepared_memory.pack(**parts._asdict())
        self._sizes = {
            "state": self.state_size,
            "table_rows": robot.table.shape[0],
            "table_columns": robot.table.shape[1],
            "inputs": m,
            "rows": len(parameters),
            "columns": parameters.shape[1],
            **{name: part.size for name, part in parts._asdict().items() if name in prepared_memory.sizes},
        }
        self._parts = prepared_memory(self.memory, *(self._sizes[name] for name in prepared_memory.sizes))
        if tasks and self._grows:
            at = task_levels.place("growth")
            growth, share = parameters[:, _GROWTH : _GROWTH + 2].max(axis=0)
            self._parts.tasking[at : at + 3] = growth, 0.5 * (period + lag.late), share
        self.parameters: Array = self._parts.parameters
        if lag_at := law.lag_at:
            self.parameters[:, lag_at] = sum(lag.mean)
        self.wrench: Array = self._parts.contact_work[:WRENCH]
        self.work, self.preferred = self._parts.work, self._parts.work[:m]
        self.pose = self._parts.kinematics[:8]
        self.report: Array = self._parts.constraint_work[: self.constraints.report if self.constraints else 0]

    def with_limits(self, limits: CommandLimits) -> Controller:
        """Return the same law with something else done to its commands before they leave."""
        return self._with(limits=limits)

    def _with(self, **others: Any) -> Controller:
        """Return the same with something else in place of what it was made of."""
        return Controller(**self._given() | others)

    def _given(self) -> dict[str, Any]:
        return {
            "law": self._law,
            "robot": self.robot,
            "parameters": self.parameters,
            "period": self.period,
            "limits": self._limits,
            "command_mode": self._command_mode,
            "tasks": self.tasks,
            "lag": self._lag,
            "guards": self._guards,
        }

    def along(self, reference: Reference, law: Law | None = None) -> Controller:
        """Return the same law, or another one, along another reference, with all else as it is."""
        return (law or self._law).prepare(
            self.robot, reference, self.period, self._limits, self._command_mode, self.tasks, self._lag
        )

    def taking_over(self, q: Array, state: Array) -> Array:
        """Return the state at q (n,) that goes on from that of another controller, which keeps the same constraints."""
        own = np.concatenate([self._law.initial_state(self.robot, q), np.zeros(self._memory_size)])
        if self.constraints:
            own[-self.constraints.memory :] = state[-self.constraints.memory :]
        return own

    def __reduce__(self) -> tuple[type, tuple[object, ...]]:
        """Let copies and other processes make their own memory and plan."""
        return Controller, tuple(self._given().values())

    @cached_property
    def depends_on_mode(self) -> bool:
        """Whether plants of another command mode or lag need another one."""
        position = self._limits.position
        remembers = position and position.memory(self.robot, "integrated", self.period)
        return bool(self.constraints or self._grows or self._law.lag_at or remembers)

    def in_mode(self, command_mode: CommandMode, lag: Lag = AT_ONCE) -> Controller:
        """Return this law for plants of a command mode; see `Law.prepare`."""
        if (command_mode, lag) == (self._command_mode, self._lag) or not self.depends_on_mode:
            return self
        return self._with(command_mode=command_mode, lag=lag)

    @property
    def stages(self) -> dict[str, Kernel | InterpretedKernel | None]:
        """What compiled code calls, by its name in ``Plan``; None where nothing is to be done."""
        contact = self._law.contact
        return {
            "kinematics": self.robot.kernels.twist_kinematics,
            "preference": self._preference,
            "law": self.kernel,
            "position_limit": self._position_limit,
            "limit": self._limit,
            "tasks": self.tasks.kernel if self.tasks else None,
            "constraint": self.constraints.kernel if self.constraints else None,
            "contact": contact.kernel if contact else None,
            "left": note_left if contact else None,
        }

    @cached_property
    def plan(self) -> NDArray[np.intp]:
        """Where compiled code finds the law's stages and sizes."""
        addresses = {
            name: stage.pointer if isinstance(stage, Kernel) else 0 for name, stage in self.stages.items()
        }
        names = ("contact_at", "delivered_at", "last_at", "sent_at")
        places = dict(zip(names, (self._contact_at, *self._feedback), strict=True))
        numbers = addresses | places | self._sizes
        return np.array([numbers[name] for name in Plan._fields], dtype=np.intp)

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
        if self.constraints:
            self.constraints.check_start(values)
        return np.concatenate([self._law.initial_state(self.robot, values), np.zeros(self._memory_size)])

    def go_on_from(self, q: ArrayLike, before: Controller, state: Array) -> Array:
        """Return `initial_state` with what contact remembers under another law, the one before, with its state.

        So the compliant frame stays where it is while M, D, K, the wanted force or the law change; what touches ended
        and displaced begins anew where the reference's are others.

        Raises
        ------
        ValueRangeError
            If an axis that has given way is to be rigid, or the deflection is along other axes.
        """
        new = self.initial_state(q)
        present, past = self._law.contact, before._law.contact
        if present is None or past is None:
            return new
        at, old = self._contact_at, before._contact_at
        kept = new[at : at + CONTACT_STATE]
        kept[:] = state[old : old + CONTACT_STATE]
        own, given = contact_state(kept), contact_parameters(self._parts.contacting)
        if own.y.any() and present.axes != past.axes:
            raise ValueRangeError(
                "contact.axes: stay as they are while the compliant frame is off the desired one"
            )
        if (present.rigid & (own.y != 0.0)).any():
            raise ValueRangeError(
                "contact: an axis that has given way cannot become rigid; give it a stiffness"
            )
        known = contact_parameters(before._parts.contacting)
        if not (np.array_equal(given.guards, known.guards) and np.array_equal(given.fit, known.fit)):
            for name in ("hits", "gone", "touched", "points", "moved", "held", "screw", "fitted"):
                getattr(own, name)[:] = 0.0
        return new

    def contact_wrench(self, state: Array) -> Array:
        """Return moment and force on the end effector in task axes as contact last heard them, (6,); 0 without it."""
        if not self._law.contact:
            return np.zeros(6)
        return contact_state(state[self._contact_at : self._contact_at + CONTACT_STATE]).wrench.copy()

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
        if out is None:
            out = np.empty(self.robot.input_size)
        try:  # what `step` does: one call less
            status = self._step(self.plan, self.memory, q, sample.numbers, -1, self.period, state, out)
        except (AttributeError, TypeError):  # a list, integers
            if not isinstance(sample, Sample):
                raise ShapeError(f"sample: expected references.Sample, got {sample!r:.80}") from None
            self._check(state, out)
            values = as_array("q", q)
            if values.ndim != 1:
                self.robot.kinematics(values)  # says what is wrong
            self.step(values, sample.numbers, -1, state, out)
            return out
        if status:
            self._raise(status, q, state, out)
        return out

    def _check(self, state: object, out: Array) -> None:
        """Raise an error if the state is not from `initial_state`, or the output does not fit."""
        m, size = self.robot.input_size, self.state_size
        if not isinstance(state, np.ndarray) or state.shape != (size,) or state.dtype != np.float64:
            raise Error(f"state: expected the array from initial_state, {size} numbers, got {state!r:.80}")
        if np.shape(out) != (m,) or out.dtype != np.float64:
            raise ShapeError(f"out: expected shape ({m},), got {np.shape(out)}")

    def step(self, q: Array, sample: Array, k: int, state: Array, out: Array) -> None:
        """Write the inputs for sample number k, given as an array (21,); −1: that of its time.

        `command` and the loop call it.
        """
        status = self._step(self.plan, self.memory, q, sample, k, self.period, state, out)
        if status:
            self._say_what_raised(status, q, sample, state)
            self._raise(status, q, state, out)

    def _say_what_raised(self, status: int, q: Array, sample: Array, state: Array) -> None:
        """Call a user's function whose compiled code raised in Python: that one says what."""
        plain = self.kernel.plain if isinstance(self.kernel, Kernel) else None
        if status != LAW_FAILED + RAISED or plain is None:
            return
        parameters, out = self.parameters[0], np.zeros(self.robot.input_size)  # a user's law has one row
        plain(q, *split(self._parts.kinematics), sample, parameters, state.copy(), self.work, out)

    def task_samples(self, number: int) -> Array:
        """Return the samples of a further task, shape (N, 21), where compiled code reads them, to write there.

        Raises
        ------
        ShapeError
            If there is no such task, or it is a posture.
        """
        if self.tasks is None or not 0 <= number < len(self.tasks.tasks):
            raise ShapeError(f"tasks: there is no task {number}")
        if self.tasks.tasks[number] is None:
            raise ShapeError(f"tasks[{number}]: a posture has no pose")
        return self.tasks.samples_in(self._parts.tasking, number)

    def place(self, name: str, pose: Array) -> None:
        """Tell its constraints where a watched body of the world is measured, pose (8,), inertial frame."""
        if self.constraints is not None:
            self.constraints.place(self._parts.constraining, name, pose)

    def sent(self, state: Array, command: Array) -> None:
        """Tell the law what left in place of its last command, as a supervisor changes it, shape (m,)."""
        if any(self._feedback) or self._law.contact:
            self._sent(self.plan, self.memory, state, command)

    @property
    def is_guarded(self) -> bool:
        """Whether touches end or displace moves of its reference."""
        return bool(self._guards.moves)

    def guided(self, samples: Array, state: Array) -> Array:
        """Return the samples (N, 21) of a finished run where the touches that its state knows displaced them to."""
        if not self.is_guarded:
            return samples
        at, out = self._contact_at, samples.copy()
        guide_again(samples, self._parts.contacting, state[at : at + CONTACT_STATE].copy(), out)
        return out

    def _raise(self, status: int, q: Array, state: Array, out: Array) -> None:
        if status >= LAW_FAILED:
            raise DivergedError(status_text(status - LAW_FAILED))
        self._check(state, out)
        self.robot.kinematics(q)  # says what is wrong

    @cached_property
    def _step(self) -> Callable[..., int]:
        return step.compiled if isinstance(self.kernel, Kernel) else self._interpreted

    def _interpreted(
        self,
        plan: object,
        memory: object,
        q: Array,
        sample: Array,
        k: int,
        period: float,
        state: Array,
        out: Array,
    ) -> int:
        """Do what `step` does for a law that is not compiled: the stages around it are called from Python."""
        self._check(state, out)
        row = max(round(sample[TIME] / period), 0) if k < 0 else k
        return compute_command(self._in_python, q, sample, row, state, out)

    @cached_property
    def _in_python(self) -> Prepared:
        """Plan and memory with the stages themselves in place of their addresses; an interpreted law has none."""
        called: dict[str, Any] = {name: stage or 0 for name, stage in self.stages.items()}
        if self._position_limit:
            called["position_limit"] = self._position_limit.function  # it calls the law
        if self.constraints:
            kept, kinematics = self.constraints.kernel, self.robot.kernels.twist_kinematics.pointer
            called["constraint"] = lambda _, *given: kept(kinematics, *given)
        numbers = dict(zip(Plan._fields, self.plan.tolist(), strict=True))
        return Prepared(Plan(**numbers | called), self._parts)

    @cached_property
    def _sent(self) -> Callable[..., object]:
        if isinstance(self.kernel, Kernel):
            return sent.compiled
        return lambda _, memory, state, command: note_sent(self._in_python, state, command)


_STATUS = {
    NOT_FINITE: "the command is not finite",
    SINGULAR: "the damped system is singular; use more damping or the filtered inverse",
    RAISED: "your own function raised an exception",
    UNTOUCHED: "the touches of the reference found no plane: give more 'depth', or look where it stands",
}


def status_text(status: int) -> str:
    """Say what a law's status code means."""
    return _STATUS.get(status, f"the law failed with status {status}")

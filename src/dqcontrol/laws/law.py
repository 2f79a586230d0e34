"""The base of control laws, and a law prepared for one robot, reference and period."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, NamedTuple, Self

import numpy as np
from msgspec import Struct
from msgspec.structs import replace
from numpy.typing import ArrayLike, NDArray

from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import Kernel
from dqcontrol.compiled.intrinsics import LAW as LAW
from dqcontrol.compiled.memory_layout import MemoryLayout
from dqcontrol.constraints.constraints import Constraints
from dqcontrol.contact.admittance import NO_GUARDS, Admittance
from dqcontrol.errors import ValueRangeError, as_array, as_positive
from dqcontrol.laws.hand_twist import twist_work
from dqcontrol.laws.null_space import AnyNullSpace
from dqcontrol.limits.command_limits import CommandLimits
from dqcontrol.named_fields import NamedFields
from dqcontrol.references.sample import Sample
from dqcontrol.robots.robot import AT_ONCE, CommandMode, Lag, Robot

if TYPE_CHECKING:
    from dqcontrol.controller.controller import Controller
    from dqcontrol.controller.task_levels import PreparedTasks
    from dqcontrol.references import Reference


@dataclass(frozen=True)
class LoopRates:
    """Rates λ at which small errors decay, ė = −λe, with ideal joints and a short period.

    Attributes
    ----------
    position, orientation
        1/s, the largest modulus at each row of the law's parameters, shape (K,); complex where errors oscillate
        even so; None where the law leaves that part free.
    integral
        k_I of both, 1/s²: ė = −λe − k_I ∫e dt.
    lag
        k_v of laws that command accelerations, 1/s: their velocities follow what λ asks for, u̇ = k_v (−λe − u), also
        those in the null space. 0 for laws that command velocities.
    """

    position: NDArray[np.inexact] | None
    orientation: NDArray[np.inexact] | None
    integral: float = 0.0
    lag: float = 0.0


def largest_rates(gains: NDArray[np.float64]) -> NDArray[np.inexact]:
    """Return the eigenvalue of largest modulus of each matrix, shape (K,); real where all are."""
    values = np.linalg.eigvals(gains)
    largest = np.take_along_axis(values, np.abs(values).argmax(axis=-1)[:, None], axis=-1)[:, 0]
    return largest.real if (np.abs(largest.imag) <= 1e-9 * np.abs(largest)).all() else largest


_MOST_STEPS = 10_000_000  # more are a slip in the unit of duration or period; an hour at 1 kHz is 3.6 million


class LawWork(NamedTuple):
    """Scratch of laws that declare none of their own: m numbers of preferred motion first, as all laws have."""

    preferred: Annotated[Array, "m"]
    scratch: Annotated[Array, 48]
    solver: Annotated[Array, twist_work.sized("m")]


class Law(
    NamedFields,
    frozen=True,
    kw_only=True,
    tag_field="kind",
    forbid_unknown_fields=True,
    repr_omit_defaults=True,
):
    """Parameters of a control law; subclasses name a kernel of signature ``LAW``, and the layout of its scratch.

    Attributes
    ----------
    file_keys
        Its parameters that name files, relative to the spec.
    gain_powers
        By name the parameters that make its loop gain: each grows with this power of it.
    """

    file_keys: ClassVar[tuple[str, ...]] = ()
    kernel: ClassVar[Kernel]
    work: ClassVar[MemoryLayout[Any]] = MemoryLayout(LawWork, "m")
    gain_powers: ClassVar[Mapping[str, float]] = {}
    null_space: AnyNullSpace | None = None
    constraints: Constraints | None = None
    contact: Admittance | None = None

    def parameter_rows(self, robot: Robot, times: Array) -> Array:
        """Return the kernel's parameters at each time, shape (N, p), or (1, p) if they are constant."""
        raise NotImplementedError

    def work_size(self, robot: Robot) -> int:
        """Return room for the preferred motion and the kernel's scratch."""
        return self.work.size(robot.input_size)

    def state_size(self, robot: Robot) -> int:
        """Return how many numbers are kept from sample to sample."""
        return 1

    @property
    def delivered_at(self) -> int:
        """Where the state takes the end effector's twist [ω ; ṗ] that left (six numbers); 0 if the law does not ask."""
        return 0

    @property
    def last_at(self) -> int:
        """Where the state takes the command that left, shape (m,); 0 if the law does not ask."""
        return 0

    @property
    def lag_at(self) -> int:
        """Where the parameters take how late the joints follow, the mean of D + τ, s; 0 if the law does not ask."""
        return 0

    def initial_state(self, robot: Robot, q: Array) -> Array:
        """Return the state before the first sample, at configuration q."""
        return np.zeros(self.state_size(robot))

    def horizon(self, reference: Reference | None) -> float:
        """Return the time after which the parameters no longer change, s."""
        return 0.0

    def loop_rates(self, parameters: Array) -> LoopRates | None:
        """Return how fast small errors decay at each of the rows of a prepared law; None if that is unknown."""
        return None

    def scaled(self, factor: float) -> Self:
        """Return the law with all its loop gains multiplied by a factor; what has no loop gain stays as it is.

        Examples
        --------
        >>> import dqcontrol as dqc
        >>> law = dqc.laws.Proportional(gain=5.0, integral_gain=4.0).scaled(2.0)
        >>> law.gain, law.integral_gain
        (10.0, 16.0)
        """
        values = {name: (getattr(self, name), factor**power) for name, power in self.gain_powers.items()}
        return replace(
            self, **{name: _multiplied(*each) for name, each in values.items() if each[0] is not None}
        )

    def prepare(
        self,
        robot: Robot,
        reference: Reference | None,
        period: float,
        limits: CommandLimits | None = None,
        command_mode: CommandMode = "measured",
        tasks: PreparedTasks | None = None,
        lag: Lag = AT_ONCE,
    ) -> Controller:
        """Check the parameters and compute what depends on time.

        Parameters
        ----------
        robot
            The robot to drive.
        reference
            The motion to follow; None where a law needs no horizon.
        period
            Control period, s.
        limits
            What is done to the command before it leaves.
        command_mode
            ``"integrated"`` for plants whose commands move a target that the joints follow with a lag: clamping then
            keeps the target within the limits, not the joints as they are measured.
        tasks
            What is to be done beside.
        lag
            How late the joints follow such a target: constraints keep more distance by what that can take, and
            feed-forward of second order leads by it.

        Raises
        ------
        Error
            If a parameter is not allowed; nothing is raised later for that reason.
        """
        period = as_positive("period", period)
        rows = np.ascontiguousarray(self.rows(robot, reference, period), dtype=np.float64)
        from dqcontrol.controller.controller import (
            Controller,  # the one import upwards: see docs/how-it-is-built.md
        )

        guards = NO_GUARDS if reference is None else reference.guards
        return Controller(
            self, robot, rows, period, limits or CommandLimits(), command_mode, tasks, lag, guards
        )

    def rows(self, robot: Robot, reference: Reference | None, period: float) -> Array:
        """Return the kernel's parameters, one row a sample as long as they change, shape (K, p)."""
        steps = math.ceil(max(self.horizon(reference), 0.0) / period - 1e-9) + 1
        check_steps("gain schedule", steps)
        return self.parameter_rows(robot, period * np.arange(steps, dtype=np.float64))

    def command(
        self, robot: Robot, q: ArrayLike, sample: Sample, period: float, state: Array | None = None
    ) -> Array:
        """Return the inputs for one sample; prepare the law once instead when there are many."""
        prepared = self.prepare(robot, None, period)
        values = as_array("q", q, (robot.configuration_size,))
        return prepared.command(values, sample, prepared.initial_state(values) if state is None else state)


def beside(rows: Array, numbers: ArrayLike) -> Array:
    """Return rows of parameters, (K, p), with the same numbers, (r,), behind each, shape (K, p + r)."""
    size, same = rows.shape[1], np.asarray(numbers)
    out = np.empty((len(rows), size + len(same)))
    out[:, :size], out[:, size:] = rows, same
    return out


def _multiplied(value: Any, factor: float) -> Any:
    """Return a number, all numbers of a list, or the values of what changes with time, times a factor."""
    if isinstance(value, list | tuple):
        return [_multiplied(each, factor) for each in value]
    if isinstance(value, Struct):
        return replace(value, values=_multiplied(value.values, factor))  # type: ignore[attr-defined]
    return value * factor


def check_steps(what: str, steps: float) -> None:
    """Raise a `ValueRangeError` if something would take more than ten million steps."""
    if not steps <= _MOST_STEPS:
        raise ValueRangeError(f"{what}: takes {steps:,.0f} steps; at most 10 million")

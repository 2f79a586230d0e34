"""What a plant is: it takes the law's command and moves the robot."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import ClassVar, Literal, Protocol, runtime_checkable

import numpy as np
from msgspec import Struct
from msgspec.structs import replace
from numpy.typing import ArrayLike

from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import READ, STATUS, WRITE, WRONG_SIZE, InterpretedKernel, Kernel
from dqcontrol.errors import DivergedError, ShapeError, ValueRangeError, as_array, as_positive
from dqcontrol.limits.command_limits import CommandLimits
from dqcontrol.plants.channels import Channel
from dqcontrol.plants.linear_model import LinearModel
from dqcontrol.robots.robot import Robot
from dqcontrol.robots.whole_body import base_coordinates

# command, parameters, noise of this step, state, q, measured
PLANT = STATUS(READ, READ, READ, WRITE, WRITE, WRITE)
_MOST_LATE = 2000  # periods: the linear model has a state for each, and a table of their squares


@runtime_checkable
class LivePlant(Protocol):
    """A plant at work, at one configuration."""

    q: Array
    measured: Array

    def step(self, command: Array) -> None:
        """Apply the inputs, shape (m,), for one period; update ``q`` and ``measured`` in place."""
        ...


@runtime_checkable
class GuardedPlant(Protocol):
    """A live plant that switches its motors off when something is wrong."""

    @property
    def fault(self) -> str:
        """Why it did so; empty while all is well."""
        ...


@runtime_checkable
class AgedPlant(Protocol):
    """A live plant whose measurements come when they come, as those of a robot on a network."""

    @property
    def age(self) -> float:
        """Age of the present measurement, s."""
        ...


@runtime_checkable
class EffortPlant(Protocol):
    """A live plant that measures the efforts of its joints."""

    @property
    def effort(self) -> Array:
        """Effort of each input, shape (m,), N·m or N."""
        ...


@runtime_checkable
class WrenchPlant(Protocol):
    """A live plant that measures what acts on its hand."""

    @property
    def wrench(self) -> Array:
        """Force and torque, shape (6,), N and N·m."""
        ...


@runtime_checkable
class TargetPlant(Protocol):
    """Parameters of a plant whose commands move targets of joint controllers."""

    @property
    def command_mode(self) -> str:
        """What they count from."""
        ...


class Plant(
    Struct, frozen=True, kw_only=True, tag_field="kind", forbid_unknown_fields=True, repr_omit_defaults=True
):
    """Parameters of a plant.

    Attributes
    ----------
    is_supervised
        Whether a supervisor stands before it unless told otherwise: of plants that move more than our own arrays.
    has_velocity_limits
        Whether commands before it are scaled to the robot's velocity limits unless told otherwise: of servos and
        physics, which real joints stand behind.
    """

    is_supervised: ClassVar[bool] = False
    has_velocity_limits: ClassVar[bool] = False

    def start(self, robot: Robot, q0: Array, dt: float, steps: int, seed: int) -> LivePlant:
        """Return the plant at configuration q0, for a number of periods dt (s); the seed draws all its noise."""
        raise NotImplementedError

    def linear_model(self, robot: Robot, q0: Array, dt: float) -> LinearModel | None:
        """Return how small commands move the measured joints near q0, with period dt (s); None if that is unknown."""
        return None


def command_mode(plant: Plant) -> Literal["integrated", "measured"]:
    """Return what a plant's commands count from: the last target, or the measured joints."""
    measured = isinstance(plant, TargetPlant) and plant.command_mode == "measured"
    return "measured" if measured else "integrated"


def lagging_mode(plant: Plant) -> Literal["integrated", "measured"]:
    """Return ``"integrated"`` if commands move a target that the joints follow with a lag, else ``"measured"``."""
    return command_mode(plant) if isinstance(plant, TargetPlant) else "measured"


def limits_before(plant: Plant, limits: CommandLimits | None, robot: Robot) -> CommandLimits:
    """Return what is done to commands before a plant: the limits as given, whether velocities are scaled decided.

    Unless told otherwise they are scaled before servos and physics of robots that have velocity limits: without that, a
    gain that is good near a target thrashes joints far from it. Commands that count from the measured joints are never
    scaled unless asked for: T u is then an offset of the target that also carries gravity, and no joint velocity.

    Parameters
    ----------
    plant
        What the commands are for.
    limits
        As given; None for none.
    robot
        The robot that has them.

    Examples
    --------
    >>> import dqcontrol as dqc
    >>> arm = dqc.load_robot("iiwa7")
    >>> [dqc.plants.limits_before(plant, None, arm).velocity for plant in (dqc.plants.Integrator(), dqc.plants.Servo())]
    [False, True]
    """
    limits = limits or CommandLimits()
    if limits.velocity is not None:
        return limits
    bounded = bool(np.isfinite(robot.limits.velocity).any()) and command_mode(plant) == "integrated"
    return replace(limits, velocity=plant.has_velocity_limits and bounded)


def start_configuration(robot: Robot, q0: ArrayLike) -> Array:
    """Return q0 as an array (n,), or say why it does not fit the robot."""
    start = as_array("q0", q0, (robot.configuration_size,))
    if start.ndim != 1:
        raise ShapeError(f"q0: expected shape ({robot.configuration_size},), got {start.shape}")
    return start


def start_within_limits(robot: Robot, q0: ArrayLike) -> Array:
    """Return q0 as an array (n,), or say why the robot cannot be there."""
    start = start_configuration(robot, q0)
    for i, name in enumerate(robot.joint_names):
        lower, upper = robot.limits.lower[i], robot.limits.upper[i]
        if not lower <= start[i] <= upper:
            raise ValueRangeError(
                f"q0: joint {i + 1} '{name}' is at {start[i]:g}; must lie in {lower:g} … {upper:g}"
            )
    return start


def plants_that_drive(robot: Robot) -> str:
    """Say which plants move a robot, in the words of an error about one that does not."""
    bases = int(base_coordinates(robot).sum()) // 3
    if not bases:
        return "arms run on kind 'mujoco'"
    if len(robot.drives) == bases == 1 and robot.drives[0, 0] == 0:
        return "use kind 'mobile', or without physics 'servo' or 'integrator'"
    return "no physics has such a base (mecanum wheels are not modelled); use kind 'servo' or 'integrator'"


def as_command(command: ArrayLike, size: int) -> Array:
    """Return a command as finite array (m,), or say what is wrong with it."""
    array = as_array("command", command)
    if array.shape != (size,):
        raise ShapeError(f"command: expected shape ({size},), got {array.shape}")
    return array


def begun_periods(field: str, seconds: float, dt: float) -> tuple[int, float]:
    """Return a time of at least 0 as a number of periods dt, the last perhaps begun only, and the share passed of it.

    Examples
    --------
    >>> [begun_periods("delay", delay, 0.01) for delay in (0.0, 0.02, 0.025)]
    [(0, 1.0), (2, 1.0), (3, 0.5)]
    """
    periods = _periods(field, seconds, dt)
    if abs(round(periods) * dt - seconds) <= 1e-9:
        return round(periods), 1.0
    return math.ceil(periods), round(periods - math.floor(periods), 12)


def _periods(field: str, seconds: float, dt: float) -> float:
    """Return a time of at least 0 over the period; refuse more periods than there is sense in remembering."""
    periods = as_positive(field, seconds, zero_allowed=True) / dt
    if not periods <= _MOST_LATE:
        raise ValueRangeError(
            f"{field}: must be ≤ {_MOST_LATE:,} periods of {dt:g} s, {_MOST_LATE * dt:.4g} s, got {seconds:g} s"
        )
    return periods


class CompiledPlant:
    """A plant whose step is a compiled function of signature ``PLANT``.

    Attributes
    ----------
    q, measured
        True and measured configuration, shape (n,), updated in place.
    noise
        What chance does, drawn before: one row a step.
    foreseen
        What the plant senses beside its configuration and is known before: quantities, and their values at each
        sample.
    """

    def __init__(
        self,
        kernel: Kernel | InterpretedKernel,
        parameters: Array,
        state: Array,
        q0: Array,
        noise: Array,
        foreseen: Sequence[tuple[Channel, Array]] = (),
    ) -> None:
        self.kernel = kernel
        self.parameters: Array = np.ascontiguousarray(parameters, dtype=np.float64)
        self.state: Array = np.ascontiguousarray(state, dtype=np.float64)
        self.q: Array = np.array(q0, dtype=np.float64)
        self.measured: Array = self.q.copy()
        self.noise = noise
        self.foreseen: tuple[tuple[Channel, Array], ...] = tuple(foreseen)
        self._step = 0

    def step(self, command: Array) -> None:
        """Apply the inputs for one period."""
        if self._step == len(self.noise):
            raise ValueRangeError(f"step: the plant was started for {self._step} periods, and they are over")
        status = self.kernel(
            command, self.parameters, self.noise[self._step], self.state, self.q, self.measured
        )
        if status == WRONG_SIZE:
            raise ShapeError(f"command: does not fit the robot, got shape {np.shape(command)}")
        if status:
            raise DivergedError("the plant produced NaN or infinity")
        self._step += 1

    def rewind(self) -> None:
        """Use the noise again from its start, for a plant that runs longer than it was started for."""
        self._step = 0

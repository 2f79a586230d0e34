"""The base of plants, which take the law's command and move the robot."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Protocol, Self

import numpy as np
from msgspec.structs import replace
from numpy.typing import ArrayLike

from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import RAISED, READ, STATUS, WRITE, WRONG_SIZE, InterpretedKernel, Kernel
from dqcontrol.errors import DivergedError, ShapeError, ValueRangeError, as_array, as_positive
from dqcontrol.limits.command_limits import CommandLimits
from dqcontrol.named_fields import NamedFields
from dqcontrol.plants.linear_model import LinearModel
from dqcontrol.robots.robot import AT_ONCE, CommandMode, Lag, Robot, base_coordinates
from dqcontrol.world import World

if TYPE_CHECKING:
    from dqcontrol.contact import PreparedImpedance

WRENCH_READINGS = ("wrist_force", "wrist_torque")  # of a force sensor, its axes, N and N·m
BASE_POSITION, BASE_QUATERNION = "base_position", "base_quaternion"  # of a base that may lift and tilt


class Channel(NamedTuple):
    """One quantity that a plant senses.

    Attributes
    ----------
    name
        Of the quantity.
    parts
        Names of its numbers; empty for a single one.
    unit
        Of each of them; empty where there is none.
    """

    name: str
    parts: tuple[str, ...]
    unit: str

    @property
    def size(self) -> int:
        """How many numbers it has."""
        return len(self.parts) or 1


_NOTHING: Array = np.zeros(0)
_NOTHING.flags.writeable = False


class ControllerSettings(NamedTuple):
    """What joint controllers are told beside their targets, as each command of a Meka tells them.

    Attributes
    ----------
    mode
        As in `CompliantPlant`; empty: stays as it is.
    stiffness
        0 … 1, shape (n,); None: stays as it is.
    slew_rate
        Of the reference, mean speed of minimum-jerk motions, rad/s, shape (n,); None: stays as it is.
    asked
        What modes without a position loop take, shape (n,): torques, N·m, or in PWM duties, −1 … 1; None: they stay.
    """

    mode: str = ""
    stiffness: Array | None = None
    slew_rate: Array | None = None
    asked: Array | None = None


class PlantProtocol(Protocol):
    """The least that a plant at work has; ``running_plant`` adds the defaults of `RunningPlant`.

    Attributes
    ----------
    q, measured
        True and measured configuration, shape (n,), rad or m; `step` changes them.
    """

    q: Array
    measured: Array

    def step(self, command: Array) -> None:
        """Apply the inputs, shape (m,), for one period; update ``q`` and ``measured``."""
        ...


class RunningPlant:
    """A plant at work, at one configuration: `q`, ``measured`` and `step`, and as much of the rest as it has.

    Attributes
    ----------
    q, measured
        True and measured configuration, shape (n,), rad or m, updated in place.
    fault
        Why it switched its motors off; empty while all is well. The run then brakes, if it has a supervisor.
    age
        Of the present measurement, s. Report it for a robot on a network, whose measurements come when they come: the
        supervisor stops at old ones. Left at 0, a robot that falls silent is noticed only where its numbers stay the
        same.
    effort
        Measured effort of each input, shape (m,), N·m or N; empty if it measures none.
    wrench
        Measured force and torque that payload and environment exert on the end effector, its axes and about its origin,
        shape (6,), N and N·m; empty if it measures none.
    channels, readings
        What it senses beside these, recorded at every sample: the quantities, and their present values one after the
        other, shape (sum of sizes,), updated in place.
    foreseen
        What it senses and is known before the run: quantities, and their values at each sample.
    periods
        For how many steps its noise was drawn.
    seen
        Where bodies of the world are measured, by name unit dual quaternions (8,), inertial frame, updated in place.
    can_be_pushed
        Whether `push` moves it.

    Examples
    --------
    >>> class Robot(RunningPlant):
    ...     def __init__(self, driver):
    ...         self.driver, self.q, self.measured = driver, driver.joints(), driver.joints()
    ...
    ...     def step(self, command):
    ...         self.driver.send(command)
    ...         self.measured[:] = self.q[:] = self.driver.joints()
    ...         self.age = self.driver.seconds_since_last_message()
    """

    q: Array
    measured: Array
    fault: str = ""
    age: float = 0.0
    effort: Array = _NOTHING
    wrench: Array = _NOTHING
    channels: tuple[Channel, ...] = ()
    readings: Array = _NOTHING
    foreseen: tuple[tuple[Channel, Array], ...] = ()
    periods: float = math.inf
    seen: Mapping[str, Array] = MappingProxyType({})
    can_be_pushed: bool = False

    def step(self, command: Array) -> None:
        """Move for one control period; what it measures is updated in place.

        Parameters
        ----------
        command
            The inputs u, shape (m,): velocities of joints, and v and ω of drives, rad/s or m/s.

        Raises
        ------
        ShapeError, ValueRangeError
            If the command has the wrong shape or is not finite, or the plant was started for fewer periods.
        DivergedError
            If the plant's state became NaN or infinite, or the command larger than its simulator takes.
        FallenError
            If the robot has fallen over.
        """
        raise NotImplementedError

    def rewind(self) -> None:
        """Use the drawn noise again from its start, for a plant that runs longer than it was started for."""

    def set_joint_control(self, control: ControllerSettings) -> None:
        """Tell joint controllers their mode, stiffness and slew rate; a plant without such takes no notice."""

    def push(self, row: int, point: Array, force: Array) -> None:
        """Push a link from the next step on, until told otherwise; a plant without physics takes no notice.

        Parameters
        ----------
        row
            Of `Robot.frames`: what the link moves with.
        point, force
            Where and how, shape (3,) each, inertial frame, m and N.
        """

    def take_effort(self, effort: Array | None) -> None:
        """Drive the joints by efforts from the next step on, in the place of targets, until told otherwise.

        Parameters
        ----------
        effort
            Shape (n,), N·m or N, beside what the plant's own controllers bear of the weight, and clipped to what the
            joints have; None: they follow targets again, which begin where the joints are.
        """

    def compiled(self) -> CompiledPlant | None:
        """Return it as the compiled loop takes it; None if its step is not one compiled function."""
        return None


# what a plant that is not derived from it may have; its step in machine code has to be
_OFFERED = {
    *vars(RunningPlant)["__annotations__"],
    *("step", "rewind", "push", "take_effort", "set_joint_control"),
}


class _CompletedPlant(RunningPlant):
    """A user's plant with the defaults for what it has not; what it has may also come later."""

    def __init__(self, plant: PlantProtocol) -> None:
        self._plant = plant

    def __getattribute__(self, name: str) -> Any:
        if name in _OFFERED:
            with suppress(AttributeError):
                return getattr(object.__getattribute__(self, "_plant"), name)
        return object.__getattribute__(self, name)


def running_plant(plant: PlantProtocol) -> RunningPlant:
    """Return a plant with defaults for what it has not; one derived from `RunningPlant` as it is.

    Examples
    --------
    >>> class Robot:
    ...     q = measured = np.zeros(7)
    ...     def step(self, command): ...
    >>> running_plant(Robot()).fault, running_plant(Robot()).age
    ('', 0.0)
    """
    return plant if isinstance(plant, RunningPlant) else _CompletedPlant(plant)


# command, parameters, noise of this step, state, q, measured
PLANT = STATUS(READ, READ, READ, WRITE, WRITE, WRITE)
_COMPILED_STEP, _INTERPRETED_STEP = 1.5e-6, 2e-4  # s
_MOST_LATE = 2000  # periods: the linear model has a state for each, and a table of their squares


class EncoderErrors(NamedTuple):
    """Standard deviation of white noise, and the step that readings are rounded to: rad or m, one or one a joint."""

    noise: float | list[float]
    resolution: float | list[float]


class PhysicsPicture(NamedTuple):
    """A robot and the things around it, as MuJoCo draws them.

    Attributes
    ----------
    spec
        ``mjSpec`` of all of it, without floor and light.
    things
        Where things stand at the start, shape (k, 3), m.
    coordinates
        Takes the compiled model, configurations (N, n) and by name what the plant sensed, (N, size); returns MuJoCo's
        coordinates, shape (N, nq).
    """

    spec: Any
    things: Array
    coordinates: Callable[[Any, Array, Mapping[str, Array]], Array]


class Plant(
    NamedFields,
    frozen=True,
    kw_only=True,
    tag_field="kind",
    forbid_unknown_fields=True,
    repr_omit_defaults=True,
):
    """Parameters of a plant.

    Attributes
    ----------
    is_supervised
        Whether a supervisor stands before it unless told otherwise: of plants that move more than our own arrays.
    touches_world
        Whether links touch the bodies of the world it is in, and each other.
    has_velocity_limits
        Whether commands before it are scaled to the robot's velocity limits unless told otherwise: of servos and
        physics, which real joints stand behind.
    is_ideal
        Whether joints do at once and exactly what is commanded.
    is_robot
        Whether it is no simulation: runs then keep real time, always with a supervisor before it, and it is started by
        nothing but a run.
    file_keys
        Its parameters that name files, relative to the spec.
    """

    spec_key: ClassVar[str] = "plant"
    is_supervised: ClassVar[bool] = False
    touches_world: ClassVar[bool] = False
    has_velocity_limits: ClassVar[bool] = False
    is_ideal: ClassVar[bool] = False
    is_robot: ClassVar[bool] = False
    file_keys: ClassVar[tuple[str, ...]] = ()

    def start(self, robot: Robot, start: Array, period: float, steps: int, seed: int) -> PlantProtocol:
        """Return the plant at configuration start, for a number of periods (s); the seed draws all its noise."""
        raise NotImplementedError

    def target_mode(self) -> CommandMode | None:
        """Return what the targets of its joint controllers grow from by T u: the last ones, or the measured joints.

        That is its key ``command_mode``; None of plants without such targets.
        """
        return getattr(self, "command_mode", None)

    def lag(self, robot: Robot) -> Lag:
        """Return how late its joints follow targets that commands move; none unless it says so."""
        return AT_ONCE

    def by_effort(self) -> Self | None:
        """Return this plant with joints that take efforts, and hold where they are without; None if they take none."""
        return None

    def prepared_impedance(self, robot: Robot) -> PreparedImpedance | None:
        """Return what gives the efforts that it is driven by in the place of servos; None if it has none."""
        return None

    def compliance(self, robot: Robot, start: Array) -> Array:
        """Return what each joint gives way by under its servo, shape (n,), rad/N·m or m/N; 0 where unknown."""
        return np.zeros(robot.configuration_size)

    def linear_model(self, robot: Robot, start: Array, period: float) -> LinearModel | None:
        """Return how small commands move the measured joints near start, with a period (s); None if that is unknown."""
        return None

    @classmethod
    def complete(cls, data: Mapping[str, Any], folder: Path) -> dict[str, Any]:
        """Return what a spec in a folder says of such a plant so that it needs no folder: names of files absolute.

        What a plant file holds stands in the place of ``file``; what the spec says besides counts before that.
        """
        if (
            isinstance(data.get("file"), str)
            and (of_file := cls.of_servos(folder / data["file"])) is not None
        ):
            data = of_file | {key: value for key, value in data.items() if key != "file"}
        names = {key: data[key] for key in cls.file_keys if isinstance(data.get(key), str)}
        return {**data, **{key: str((folder / name).resolve()) for key, name in names.items()}}

    @classmethod
    def of_servos(cls, path: Path) -> dict[str, Any] | None:
        """Return what a plant file of servos says of such a plant, as plain data; None if it takes none."""
        return None

    def varied(self, lag: float, delay: float) -> Plant | None:
        """Return the same plant with other joints, for what is uncertain of them; None if it has no such parameters.

        Parameters
        ----------
        lag
            By what share the time constants are larger.
        delay
            By how much the delays are longer, s; they do not become negative.
        """
        return None

    def files(self) -> list[Path]:
        """Return the files that it reads, for lists of what results depend on."""
        return [Path(file) for key in self.file_keys if (file := getattr(self, key))]

    def encoder_errors(self) -> EncoderErrors:
        """Return how its encoders err: its keys ``encoder_noise`` and ``encoder_resolution``, as far as it has them."""
        return EncoderErrors(
            getattr(self, "encoder_noise", 0.0), getattr(self, "encoder_resolution", 0.0) or 0.0
        )

    def body_of(self, robot: Robot) -> Robot:
        """Return a robot with the body of its base here, if that is wider than it says itself; by default as it is."""
        return robot

    def base_errors(self) -> tuple[float, float]:
        """Return the standard deviations of where a mobile base is measured, m, and of its heading, rad."""
        return 0.0, 0.0

    def joint_control(self, joints: int) -> ControllerSettings:
        """Return what so many joint controllers are told beside their targets; by default nothing."""
        return ControllerSettings()

    def state_period(self, period: float) -> float:
        """Return how often its joint controllers tell their angles to a control loop of some period, s."""
        return period

    def step_time(self, period: float, *, is_compiled: bool) -> float:
        """Return roughly how long one step of a run takes on one core, s, so that long studies are shared out."""
        return _COMPILED_STEP if is_compiled else _INTERPRETED_STEP

    def in_world(self, world: World) -> Self:
        """Return this plant among the bodies of a world; one that nothing touches stays as it is."""
        return replace(self, world=world) if self.touches_world else self

    def picture(self, robot: Robot) -> PhysicsPicture | None:
        """Return the robot among the things around it, for pictures; None if the robot alone says it all."""
        return None


def command_mode(plant: Plant) -> CommandMode:
    """Return what a plant's commands count from: the last target, or the measured joints."""
    return plant.target_mode() or "integrated"


def lagging_mode(plant: Plant) -> CommandMode:
    """Return ``"integrated"`` if commands move a target that the joints follow with a lag, else ``"measured"``."""
    return plant.target_mode() or "measured"


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


def start_configuration(robot: Robot, start: ArrayLike) -> Array:
    """Return start as an array (n,), or say why it does not fit the robot."""
    start = as_array("start", start, (robot.configuration_size,))
    if start.ndim != 1:
        raise ShapeError(f"start: expected shape ({robot.configuration_size},), got {start.shape}")
    return start


def start_within_limits(robot: Robot, start: ArrayLike) -> Array:
    """Return start as an array (n,), or say why the robot cannot be there."""
    start = start_configuration(robot, start)
    for i, name in enumerate(robot.joint_names):
        lower, upper = robot.limits.lower[i], robot.limits.upper[i]
        if not lower <= start[i] <= upper:
            raise ValueRangeError(
                f"start: joint {i + 1} '{name}' is at {start[i]:g}; must lie in {lower:g} … {upper:g}"
            )
    return start


def plants_that_drive(robot: Robot) -> str:
    """Say which plants move a robot, in the words of an error about one that does not."""
    bases = int(base_coordinates(robot).sum()) // 3
    if not bases:
        return "arms run on kind 'mujoco'"
    kinds = {kind for first, kind in robot.bases if first == 0}
    if bases == 1 and kinds & {"differential drive", "mecanum", "omni"}:
        return "use kind 'mobile', or without physics 'servo' or 'integrator'"
    return "no physics has such a base; use kind 'servo' or 'integrator'"


def as_command(command: ArrayLike, size: int) -> Array:
    """Return a command as finite array (m,), or say what is wrong with it."""
    array = as_array("command", command)
    if array.shape != (size,):
        raise ShapeError(f"command: expected shape ({size},), got {array.shape}")
    return array


def begun_periods(field: str, seconds: float, period: float) -> tuple[int, float]:
    """Return a time of at least 0 as a number of periods, the last perhaps begun only, and the share passed of it.

    Examples
    --------
    >>> [begun_periods("delay", delay, 0.01) for delay in (0.0, 0.02, 0.025)]
    [(0, 1.0), (2, 1.0), (3, 0.5)]
    """
    periods = as_positive(field, seconds, zero_allowed=True) / period
    if not periods <= _MOST_LATE:
        raise ValueRangeError(
            f"{field}: must be ≤ {_MOST_LATE:,} periods of {period:g} s, {_MOST_LATE * period:.4g} s, got {seconds:g} s"
        )
    if abs(round(periods) * period - seconds) <= 1e-9:
        return round(periods), 1.0
    return math.ceil(periods), round(periods - math.floor(periods), 12)


class CompiledPlant(RunningPlant):
    """A plant whose step is a compiled function of signature ``PLANT``.

    Attributes
    ----------
    noise
        What chance does, drawn before: one row a step.
    """

    def __init__(
        self,
        kernel: Kernel | InterpretedKernel,
        parameters: Array,
        state: Array,
        start: Array,
        noise: Array,
        foreseen: Sequence[tuple[Channel, Array]] = (),
    ) -> None:
        self.kernel = kernel
        self.parameters: Array = np.ascontiguousarray(parameters, dtype=np.float64)
        self.state: Array = np.ascontiguousarray(state, dtype=np.float64)
        self.q: Array = np.array(start, dtype=np.float64)
        self.measured: Array = self.q.copy()
        self.noise = noise
        self.foreseen: tuple[tuple[Channel, Array], ...] = tuple(foreseen)
        self.periods: float = len(noise)
        self._step = 0

    def step(self, command: Array) -> None:
        """Apply the inputs for one period; see `RunningPlant.step`."""
        if self._step == len(self.noise):
            raise ValueRangeError(f"step: the plant was started for {self._step} periods, and they are over")
        noise = self.noise[self._step]
        status = self.kernel(command, self.parameters, noise, self.state, self.q, self.measured)
        if status == WRONG_SIZE:
            raise ShapeError(f"command: does not fit the robot, got shape {np.shape(command)}")
        if status:
            raise DivergedError(self.failure(status, command, self._step))
        self._step += 1

    def failure(self, status: int, command: Array, k: int) -> str:
        """Say why step number k failed: a user's function whose compiled code raised is called in Python."""
        if status != RAISED:
            return "the plant produced NaN or infinity"
        plain = self.kernel.plain if isinstance(self.kernel, Kernel) else None
        if plain is not None:
            moved = self.state.copy(), self.q.copy(), self.measured.copy()
            try:
                plain(command, self.parameters, self.noise[k], *moved)
            except DivergedError as error:
                return str(error)
        return "the plant's function raised an exception"

    def rewind(self) -> None:
        """Use the noise again from its start; see `RunningPlant.rewind`."""
        self._step = 0

    def compiled(self) -> CompiledPlant:
        """Return itself; see `RunningPlant.compiled`."""
        return self

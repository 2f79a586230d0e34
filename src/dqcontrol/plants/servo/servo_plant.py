"""Position servos: lag or second order, gravity sag, delay, play, encoders, rate and position limits.

On bodies with mobile bases joints lag, bases move as told, and a camera tells where they are.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, ClassVar, NamedTuple, Self, TypeAlias

import msgspec
import numpy as np
from msgspec import Meta
from msgspec.structs import replace
from numpy.typing import NDArray

from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import OK, WRONG_SIZE, inline, kernel
from dqcontrol.compiled.memory_layout import MemoryLayout
from dqcontrol.errors import (
    FileFormatError,
    NoteWarning,
    ShapeError,
    ValueRangeError,
    as_array,
    as_each,
    as_positive,
)
from dqcontrol.files.input_file import read_text
from dqcontrol.files.long_array import long_array
from dqcontrol.files.yaml_file import convert, parse_yaml
from dqcontrol.limits.compensation import lag_weights
from dqcontrol.limits.rates import scale_down, scale_down_rollers, speed_limits
from dqcontrol.plants.linear_model import LinearModel
from dqcontrol.plants.plant import (
    PLANT,
    Channel,
    CompiledPlant,
    Plant,
    begun_periods,
    start_configuration,
)
from dqcontrol.plants.sensors import CAMERA_CHANNELS, Camera, Wrist
from dqcontrol.plants.servo import servo_step as layout
from dqcontrol.plants.servo.servo_step import free_response, servo, servo_kernel_inline
from dqcontrol.plants.servo.touching import touching
from dqcontrol.robots.bases import DifferentialDrive, SteeredTricycle
from dqcontrol.robots.kinematics.driving import DRIVE_COLUMNS, ROLLER_COLUMNS, advance, to_inputs
from dqcontrol.robots.kinematics.gravity import WORK, gravity_forces
from dqcontrol.robots.limits import Limits
from dqcontrol.robots.robot import CommandMode, Lag, Robot, base_coordinates
from dqcontrol.robots.serial_arm import SerialArm
from dqcontrol.world import World

Each: TypeAlias = Annotated[float, Meta(ge=0)] | list[Annotated[float, Meta(ge=0)]]
EachAboveZero: TypeAlias = Annotated[float, Meta(gt=0)] | list[Annotated[float, Meta(gt=0)]]
_MOST_SHARED = 1_000_000  # numbers, 8 MB: so much is kept until other noise is drawn
_LEAST_LAG = 1e-3  # s; quicker servos are as quick as that
_OF_SERVOS = {  # what other plants may have no place for, and how it is called
    "gain": (1.0, "", "a gain of {}"),
    "delay": (0.0, " s", "a delay of {}"),
    "friction": (0.0, " rad", "play of ± {}"),
    "sag": (0.0, "", "the sag of the joints"),
    "lags": (0.0, " s", "lags of {}"),
}
_HORIZON = 2.0  # s in which what matters of a joint is seen


class Servo(Plant, frozen=True, kw_only=True, tag="servo"):
    """Joints with position servos of first or second order that sag under gravity.

    Each period the target of joint i moves by T uᵢ, starting from where it was (``integrated``) or from the measured
    position (``measured``: what a velocity command through a position interface becomes; gravity then drags the arm
    down at every sample until the law holds it). The joint follows q̇ = (target − s(q) − q)/τ, integrated exactly with
    s held, with the sag s(q) = α K⁻¹ τ_g(q). The arm starts at rest, its target above start by s(start). Joints with a
    ``bandwidth`` ω are of second order instead: q̈ = ω² (target − s(q) − q) − 2ζω q̇. Those with ``friction`` stay behind
    what drives them by as much, to the side that they come from (play).

    Of whole bodies the joints do that. Mobile bases move with the speeds that they get, delayed as the targets: drives
    on the arc of their v and ω, with a lag on that of the mean of each over the period. ``rate_limit`` scales v and ω
    to the rim speed.

    Numbers marked "each" are one number for all joints, or one a joint; bodies with mobile bases take one for all.
    A file with such numbers, as ``dqcontrol identify`` writes it, is named in specs (``file: my_arm.yaml``) or read by
    `load_servo`.

    Parameters
    ----------
    command_mode
        ``"integrated"`` or ``"measured"``.
    time_constant
        τ in s, each; 0 for none.
    bandwidth
        ω of joints of second order, rad/s, each; 0: first order, with ``time_constant``.
    damping_ratio
        ζ of joints of second order, each.
    friction
        Half the play between a servo and its joint, rad or m, each.
    gain
        Share of a commanded move that the target makes, each.
    sag
        α, a factor on the gravity sag; 0 for none. Needs a robot with inertia.
    stiffness
        K in N·m/rad (N/m for sliding joints), each.
    delay
        From command to joint, s, each. Where it ends within a period, joints follow the older target up to there and
        then the newer one, exactly; bases the mean of both commands.
    encoder_resolution
        Step of the measured position, rad or m, each; 0 for none.
    encoder_noise
        Standard deviation of the measured position, rad or m, white, each.
    rate_limit
        True: targets move no faster than the robot's velocity limits.
    position_limit
        True: targets do not leave the robot's position limits.
    gravity
        m/s² in the base frame.
    base_time_constant
        With which the speeds of mobile bases follow their commands, s; 0: at once.
    camera
        What measures where mobile bases are; without one that is known exactly.
    wrist
        A force sensor at the end effector, which then touches the springy boxes of the world; nothing if omitted.
    world
        What it touches. A spec gives its own.
    """

    has_velocity_limits: ClassVar[bool] = True
    command_mode: CommandMode = "integrated"
    time_constant: Annotated[Each, Meta(description="τ, s")] = 0.05
    bandwidth: Annotated[Each, Meta(description="ω of second order, rad/s; 0: first order")] = 0.0
    damping_ratio: Annotated[EachAboveZero, Meta(description="ζ of second order")] = 1.0
    friction: Annotated[Each, Meta(description="half the play, rad or m")] = 0.0
    gain: Annotated[EachAboveZero, Meta(description="share of a commanded move that is made")] = 1.0
    sag: Annotated[float, Meta(ge=0, description="α, factor on the gravity sag")] = 0.0
    stiffness: Annotated[EachAboveZero, Meta(description="K, N·m/rad or N/m")] = 500.0
    delay: Annotated[Each, Meta(description="s")] = 0.0
    encoder_resolution: Annotated[Each, Meta(description="rad or m")] = 0.0
    encoder_noise: Annotated[Each, Meta(description="rad or m")] = 0.0
    rate_limit: bool = True
    position_limit: bool = True
    gravity: tuple[float, float, float] = (0.0, 0.0, -9.81)
    base_time_constant: Annotated[float, Meta(ge=0, le=100, description="of bases, s")] = 0.0
    camera: Camera | None = None
    wrist: Wrist | None = None
    world: World | None = None

    def in_world(self, world: World) -> Self:
        """Return it with what its end effector touches, if it can feel that."""
        return self if self.wrist is None else replace(self, world=world)

    @classmethod
    def of_servos(cls, path: Path) -> dict[str, Any]:
        """Return what a plant file holds."""
        content = _content(path)
        convert(path, content, _PlantFile)
        return {key: value for key, value in content["plant"].items() if key != "kind"}

    def base_errors(self) -> tuple[float, float]:
        """Return the camera's standard deviations, m and rad."""
        return (self.camera.position_noise, self.camera.angle_noise) if self.camera else (0.0, 0.0)

    def start(self, robot: Robot, start: Array, period: float, steps: int, seed: int) -> CompiledPlant:
        """Return the plant at rest at start.

        Raises
        ------
        Error
            If a parameter is out of range, the robot has no inertia and there is sag, or it has no mobile base for
            what is said of one.
        """
        start, n = start_configuration(robot, start), robot.configuration_size
        period = as_positive("period", period)
        if base_coordinates(robot).any():
            if self.wrist is not None:
                raise ValueRangeError(
                    f"plant.wrist: is at the end effector of an arm, and {robot.name} has a mobile base"
                )
            return start_on_base(self, robot, start, period, steps, seed)
        for field in ("base_time_constant", "camera"):
            if getattr(self, field):
                raise ValueRangeError(f"plant.{field}: {robot.name} has no mobile base")
        answers, sag = self._answers(n, period), self.sag
        compliance = sag / self._each("stiffness", n)
        sag0 = compliance * robot.gravity_forces(start, self.gravity) if sag else np.zeros(n)
        target = start + sag0
        ends = robot.limits if self.position_limit else Limits.none(n)
        oldest = max((each.delay for each in answers), default=0)
        head = np.zeros(layout.HEAD)
        head[layout.MEASURED_MODE] = self.command_mode == "measured"
        head[layout.OLDEST_TARGET] = oldest
        head[layout.GRAVITY : layout.GRAVITY + 3] = as_array("plant.gravity", self.gravity, (3,))
        joint = np.zeros((n, layout.COLUMNS))
        joint[:, layout.STEP] = self._each("gain", n) * period
        joint[:, layout.RATE] = robot.limits.velocity if self.rate_limit else np.inf
        joint[:, layout.LOWER], joint[:, layout.UPPER] = ends.lower, ends.upper
        joint[:, layout.COMPLIANCE] = compliance
        joint[:, layout.DELAY] = [each.delay for each in answers]
        joint[:, layout.OLDEST] = [each.oldest for each in answers]
        joint[:, layout.DECAY] = [each.decay for each in answers]
        joint[:, layout.FRICTION] = self._each("friction", n)
        for i, each in enumerate(answers):
            if each.second is not None:
                joint[i, layout.IS_SECOND :] = 1.0, *each.second
        joint[:, layout.RESOLUTION] = self._each("encoder_resolution", n)
        joint[:, layout.NOISE] = self._each("encoder_noise", n)
        bodies, table = np.zeros((0, 4)), np.zeros((1, 8))
        if sag and robot.inertia:
            bodies, table = robot.inertia.table, robot.inertia_chain
            head[layout.SAGS_BY] = gravity_forces.pointer
        head[layout.BODIES], head[layout.TABLE_COLUMNS] = len(bodies), table.shape[1]
        parameters = np.concatenate([head, joint.ravel(), bodies.ravel(), table.ravel()])
        scratch = np.zeros(WORK * len(bodies) + n)
        state = np.concatenate([target, np.zeros(n), *[target] * (oldest + 1), scratch, start])
        noise = _drawn(seed, steps, n) if joint[:, layout.NOISE].any() else np.zeros((steps, n))
        plant = CompiledPlant(servo, parameters, state, start, noise)
        if self.wrist is None:
            return plant
        return touching(plant, self.wrist, self.world, robot, self.gravity, period, seed)

    def lag(self, robot: Robot) -> Lag:
        """Return time constants and delays of its coordinates; of second order 2ζ/ω."""
        n = robot.configuration_size
        bandwidth, times = self._each("bandwidth", n), self._each("time_constant", n)
        if (second := bandwidth > 0).any():
            times[second] = 2 * self._each("damping_ratio", n)[second] / bandwidth[second]
        times[base_coordinates(robot)] = self.base_time_constant
        return Lag(tuple(times.tolist()), tuple(self._each("delay", n).tolist()))

    def linear_model(self, robot: Robot, start: Array, period: float) -> LinearModel | None:
        """Return the joints without sag, play, encoder and rate limit: positions, then their targets, newest first.

        One joint stands for all if all are alike. None for mobile bases, which move otherwise than joints.

        t⁺ = t + g T u (``integrated``) or y + g T u (``measured``), y⁺ = a y + (1 − a) t⁺ delayed, a = exp(−T/τ); where
        the delay ends within a period, t⁺ is the mean of the two that are in force then, by their weights. Speeds of
        joints of second order come last.
        """
        if base_coordinates(robot).any():
            return None
        n = robot.configuration_size
        answers = list(zip(self._answers(n, period), self._each("gain", n).tolist(), strict=True))
        if all(each == answers[0] for each in answers):
            return self._joint_model(*answers[0], period)
        from scipy.linalg import block_diag

        models = [self._joint_model(*each, period) for each in answers]
        sizes = [len(model.transition) for model in models]
        begins = np.concatenate([[0], np.cumsum(sizes)[:-1]]).astype(int)
        order = np.concatenate([begins, np.setdiff1d(np.arange(sum(sizes)), begins)])
        transition = np.asarray(block_diag(*(model.transition for model in models)))[np.ix_(order, order)]
        inputs = np.asarray(block_diag(*(model.inputs for model in models)))[order]
        return LinearModel(transition, inputs).reduced(round(_HORIZON / period))

    def _joint_model(self, answer: _Answer, gain: float, period: float) -> LinearModel:
        delay, oldest, decay, second = answer
        size = delay + 2 + (second is not None)
        transition, inputs = np.zeros((size, size)), np.zeros((size, 1))
        transition[1, 0 if self.command_mode == "measured" else 1] = 1.0
        inputs[1] = gain * period
        for late in range(2, delay + 2):
            transition[late, late - 1] = 1.0
        if second is not None:
            weights = np.array([second.newer, second.speed_newer])
            older = np.array([1 - second.kept, second.speed_lost]) - weights
            ends, newer = [0, size - 1], max(delay, 1)
            transition[ends] = np.outer(older, transition[delay + 1]) + np.outer(weights, transition[newer])
            inputs[ends] = np.outer(older, inputs[delay + 1]) + np.outer(weights, inputs[newer])
            transition[ends, 0] += second.kept, -second.speed_lost
            transition[ends, -1] += second.by_speed, second.speed_kept
            return LinearModel(transition, inputs)
        transition[0] = (1 - decay) * (oldest * transition[-1] + (1 - oldest) * transition[-2] * (delay > 0))
        transition[0, 0] += decay
        inputs[0] = (1 - decay) * (oldest * inputs[-1] + (1 - oldest) * inputs[-2] * (delay > 0))
        return LinearModel(transition, inputs)

    def varied(self, lag: float, delay: float) -> Servo:
        """Return servos whose lags are longer by a share, and their delays by a time, s; see `Plant.varied`."""

        def longer(value: Each, factor: float, more: float) -> Each:
            if isinstance(value, list):
                return [max(factor * each + more, 0.0) for each in value]
            return max(factor * value + more, 0.0)

        lags, delays = longer(self.time_constant, 1 + lag, 0.0), longer(self.delay, 1.0, delay)
        return replace(self, time_constant=lags, delay=delays)

    def _each(self, field: str, n: int) -> Array:
        """Return a parameter of each of n joints, checked."""
        return as_each(f"plant.{field}", getattr(self, field), n)

    def _answers(self, n: int, period: float) -> list[_Answer]:
        """Return how each of n joints follows its targets."""
        names = "delay", "bandwidth", "time_constant"
        delay, bandwidth, tau = (self._each(name, n).tolist() for name in names)
        is_second = any(bandwidth)
        damping = self._each("damping_ratio", n).tolist() if is_second else [1.0] * n
        joints = list(zip(delay, bandwidth, damping, tau, strict=True))
        found = {joint: _answer(*joint, period) for joint in set(joints)}  # most arms have one kind
        return [found[joint] for joint in joints]


def _drawn(seed: int, steps: int, n: int) -> Array:
    """Return normal deviates of each step and joint, shape (steps, n); the runs of a study share those of a seed."""
    return _shared(seed, steps, n) if steps * n <= _MOST_SHARED else _shared.__wrapped__(seed, steps, n)


@lru_cache(maxsize=1)
def _shared(seed: int, steps: int, n: int) -> Array:
    return np.random.default_rng(seed).standard_normal(out=long_array(steps, n))


def _answer(delay: float, bandwidth: float, damping: float, tau: float, period: float) -> _Answer:
    """Return how a joint follows its targets."""
    late, share = begun_periods("plant.delay", delay, period)
    if bandwidth:
        return _Answer(late, share, 0.0, _second_order(bandwidth, damping, (1 - share) * period, period))
    return _Answer(late, *lag_weights(share, tau, period))


class _SecondOrder(NamedTuple):
    """What a period does to distance and speed of a joint of second order, as `servo_step.IS_SECOND` says."""

    kept: float
    by_speed: float
    newer: float
    speed_lost: float
    speed_kept: float
    speed_newer: float


class _Answer(NamedTuple):
    """Delay in periods begun, weight of the oldest target, and exp(−T/τ) of a joint; or its second order."""

    delay: int
    oldest: float
    decay: float
    second: _SecondOrder | None = None


def _second_order(bandwidth: float, damping: float, newer: float, period: float) -> _SecondOrder:
    """Return the exact step, the newer target being in force for the last ``newer`` seconds of a period."""
    first, second = free_response(period, bandwidth, damping)
    late, late_second = free_response(newer, bandwidth, damping)
    stiffness, speed_kept = bandwidth**2, first - 2 * damping * bandwidth * second
    return _SecondOrder(first, second, 1 - late, stiffness * second, speed_kept, stiffness * late_second)


class BodySizes(NamedTuple):
    """Length of a command, numbers of things, and how many commands and frames are remembered."""

    command: int
    joints: int
    places: int
    inputs: int
    drives: int
    rollers: int
    commands: int
    frames: int


class BodyParameters(NamedTuple):
    """What compiled code knows of a body with mobile bases; `BodySizes` stand before it.

    Attributes
    ----------
    period, decay, mean
        T, s; what is left of a speed's distance from its command after a period, and of it on average in one.
    weight
        Of a frame of the camera.
    oldest
        Weight of the oldest command, below 1 where the delay ends within a period.
    coordinate, moved_by
        Of each joint, its place in the configuration, and its input.
    place
        Of the coordinates of the bases.
    limits
        Of the inputs and drives, as `speed_limits` has them.
    change
        By how much each input may change in a period.
    steering
        See `turn_front_wheels`.
    rollers
        Wheels with rollers.
    servos
        Parameters of the joints' servos.
    """

    period: float
    decay: float
    mean: float
    weight: float
    oldest: float
    coordinate: Annotated[Array, "sizes.joints"]
    moved_by: Annotated[Array, "sizes.joints"]
    place: Annotated[Array, "sizes.places"]
    limits: Annotated[Array, f"sizes.inputs + {DRIVE_COLUMNS} * sizes.drives"]
    change: Annotated[Array, "sizes.inputs"]
    steering: Annotated[Array, "sizes.drives", 4]
    rollers: Annotated[Array, "sizes.rollers", ROLLER_COLUMNS]
    servos: Annotated[Array, ...]


class BodyState(NamedTuple):
    """What a body with mobile bases remembers: the last commands and frames, newest first; the rest is scratch.

    ``speed`` is of the inputs, ``seen`` where the bases are believed to be, ``angles`` those of front wheels.
    """

    inputs: Annotated[Array, "sizes.inputs"]
    speed: Annotated[Array, "sizes.inputs"]
    joint_command: Annotated[Array, "sizes.joints"]
    joint_q: Annotated[Array, "sizes.joints"]
    joint_measured: Annotated[Array, "sizes.joints"]
    seen: Annotated[Array, "sizes.places"]
    now: Annotated[Array, "sizes.places"]
    commands: Annotated[Array, "sizes.inputs * sizes.commands"]
    frames: Annotated[Array, "sizes.places * sizes.frames"]
    angles: Annotated[Array, "sizes.drives"]
    servos: Annotated[Array, ...]


_sizes = MemoryLayout(BodySizes)
_SIZES = _sizes.size()
_parameters, _state = MemoryLayout(BodyParameters, "sizes"), MemoryLayout(BodyState, "sizes")


@inline
def push(queue, latest):
    """Put numbers before those of a queue, newest first, and drop as many of its oldest."""
    size = latest.shape[0]
    for i in range(queue.shape[0] - 1, size - 1, -1):
        queue[i] = queue[i - size]
    for i in range(size):
        queue[i] = latest[i]


@inline
def turn_front_wheels(drives, steering, angles, inputs):
    """Turn the front wheel of each drive by no more than its motor can, and let it turn the base as it stands.

    Rows of steering: wheelbase (0: nothing is steered, or at once), largest change of the angle in a period, largest
    angle, whether the front wheel is driven.
    """
    for k in range(drives.shape[0]):
        wheelbase, change, most = steering[k, 0], steering[k, 1], steering[k, 2]
        if wheelbase == 0.0:
            continue
        j = int(drives[k, 0]) - k
        v, across = inputs[j], wheelbase * inputs[j + 1]
        sign = -1.0 if v < 0.0 else 1.0
        if v != 0.0 or across != 0.0:
            wanted = min(max(math.atan2(sign * across, abs(v)), -most), most)
            angles[k] = min(max(wanted, angles[k] - change), angles[k] + change)
        if steering[k, 3] != 0.0:
            rim = sign * math.hypot(v, across)
            inputs[j], inputs[j + 1] = rim * math.cos(angles[k]), rim * math.sin(angles[k]) / wheelbase
        else:
            inputs[j + 1] = v * math.tan(angles[k]) / wheelbase


@kernel(PLANT)
def servo_on_base(command, parameters, noise, state, q, measured):
    """Let joints follow their targets, move the bases, read encoders and camera.

    Noise: that of the encoders, then the share of the commands that is obeyed, whether a frame arrives, its errors.
    """
    sizes = _sizes(parameters[:_SIZES])
    if command.shape[0] != sizes.command:
        return WRONG_SIZE
    joints, places, p = sizes.joints, sizes.places, sizes.inputs
    given, own = _parameters(parameters[_SIZES:], sizes), _state(state, sizes)
    limits = speed_limits(given.limits, p)
    drives, inputs, speed, seen = limits.drives, own.inputs, own.speed, own.seen
    coordinate, moved_by, place = given.coordinate, given.moved_by, given.place
    joint_command, joint_q, joint_measured = own.joint_command, own.joint_q, own.joint_measured

    if command.shape[0] == p:
        for i in range(p):
            inputs[i] = command[i]
    else:
        to_inputs(drives, measured, command, inputs)
    for i in range(joints):
        joint_command[i] = noise[joints] * inputs[int(moved_by[i])]
        inputs[int(moved_by[i])] = 0.0
        joint_q[i], joint_measured[i] = q[int(coordinate[i])], measured[int(coordinate[i])]
    status = servo_kernel_inline(joint_command, given.servos, noise, own.servos, joint_q, joint_measured)
    if status != OK:
        return status

    commands = own.commands
    push(commands, inputs)
    for i in range(p):
        inputs[i] = commands[commands.shape[0] - p + i]
        if given.oldest < 1.0:  # the delay ends within the period
            newer = commands[commands.shape[0] - 2 * p + i]
            inputs[i] = given.oldest * inputs[i] + (1.0 - given.oldest) * newer
    scale_down_rollers(q, given.rollers, inputs)
    scale_down(q, limits, inputs)
    for i in range(p):
        inputs[i] *= noise[joints]
        inputs[i] = min(max(inputs[i], speed[i] - given.change[i]), speed[i] + given.change[i])
        behind = speed[i] - inputs[i]
        speed[i] = inputs[i] + behind * given.decay
        inputs[i] += behind * given.mean
    turn_front_wheels(drives, given.steering, own.angles, inputs)
    advance(drives, inputs, given.period, q)
    for i in range(joints):
        q[int(coordinate[i])], measured[int(coordinate[i])] = joint_q[i], joint_measured[i]

    for i in range(places):
        own.now[i] = q[int(place[i])]
    push(own.frames, own.now)
    shown = own.frames[own.frames.shape[0] - places :]
    for i in range(places):
        if noise[joints + 1] != 0.0:
            seen[i] += given.weight * (shown[i] + noise[joints + 2 + i] - seen[i])
        measured[int(place[i])] = seen[i]
    return OK


def start_on_base(
    plant: Servo, body: Robot, start: Array, period: float, steps: int, seed: int
) -> CompiledPlant:
    """Return the plant of a body with mobile bases at rest at start.

    Raises
    ------
    Error
        If a parameter is out of range, or there is sag.
    """
    if not isinstance(plant.delay, int | float):
        raise ShapeError(f"plant.delay: expected one number with mobile bases, got {plant.delay}")
    driven = body.in_form("constrained")
    is_base, p = base_coordinates(body), driven.input_size
    moved_by, place = np.flatnonzero(~is_base[driven.input_coordinates]), np.flatnonzero(is_base)
    coordinate = driven.input_coordinates[moved_by]
    arm = _joints(driven, coordinate, moved_by)
    alone = replace(plant, base_time_constant=0.0, camera=None)
    servos = alone.start(arm, start[coordinate], period, steps, seed)
    velocity = driven.limits.velocity if plant.rate_limit else np.full(p, np.inf)
    tau = as_positive("plant.base_time_constant", plant.base_time_constant, zero_allowed=True)
    delay, oldest = begun_periods("plant.delay", plant.delay, period)
    noise, late, weight, foreseen = _sight(plant.camera, period, steps, len(place), seed)

    drives = body.drives
    rollers = driven.rollers if plant.rate_limit else driven.rollers[:0]
    sizes = BodySizes(
        body.input_size, len(coordinate), len(place), p, len(drives), len(rollers), delay + 1, late + 1
    )
    parameters = _parameters.pack(
        period=period,
        decay=math.exp(-period / tau) if tau else 0.0,
        mean=-math.expm1(-period / tau) * tau / period if tau else 0.0,
        weight=weight,
        oldest=oldest,
        coordinate=coordinate,
        moved_by=moved_by,
        place=place,
        limits=np.append(velocity, drives),
        change=period * driven.acceleration_limits("plant"),
        steering=_steering(body, period),
        rollers=rollers,
        servos=servos.parameters,
    )
    parameters = np.concatenate([sizes, parameters])
    state = np.concatenate([np.zeros(_state.size(sizes)), servos.state])
    own = _state(state, sizes)
    own.seen[:], own.frames[:] = start[place], np.tile(start[place], late + 1)
    return CompiledPlant(servo_on_base, parameters, state, start, np.hstack([servos.noise, noise]), foreseen)


def _steering(body: Robot, period: float) -> Array:
    """Return how each drive steers, a row each: see `turn_front_wheels`."""
    rows = np.zeros((len(body.drives), 4))
    for row, part in zip(rows, body.driven_bases, strict=True):
        if not isinstance(part, DifferentialDrive) and part.steering_rate < math.inf:
            driven = isinstance(part, SteeredTricycle)
            row[:] = part.wheelbase, part.steering_rate * period, part.steering_limit, driven
    return rows


def _joints(body: Robot, coordinate: NDArray[np.intp], moved_by: NDArray[np.intp]) -> SerialArm:
    """Return the joints of a body as an arm of their own, for their servos; without inertia its shape is the same."""
    n, limits = len(coordinate), body.limits
    frames = np.tile([1.0, 0, 0, 0, 0, 0, 0], (n + 1, 1))
    types = [body.joint_types[i] for i in coordinate]
    ends = limits.lower[coordinate], limits.upper[coordinate]
    kept = Limits(*ends, limits.velocity[moved_by], limits.effort[moved_by])
    return SerialArm(frames, types, limits=kept, name=body.name)


def _sight(
    camera: Camera | None, period: float, steps: int, places: int, seed: int
) -> tuple[Array, int, float, list[tuple[Channel, Array]]]:
    """Return the camera's noise (steps, 2 + places), its delay in periods, the weight of a frame, and its signals."""
    noise = np.zeros((steps, 2 + places))
    noise[:, :2] = 1.0
    if camera is None:
        return noise, 0, 1.0, []
    found = camera.schedule(period, steps, places // 3, seed)
    noise[:, 0], noise[:, 1], noise[:, 2:] = found.share, found.arrives[1:], found.errors[1:]
    values = found.age[:, None], found.share[:, None]
    return noise, found.delay, found.weight, list(zip(CAMERA_CHANNELS, values, strict=True))


class _PlantFile(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    plant: Servo
    identified: dict[str, Any] = {}


def load_servo(path: str | Path) -> Servo:
    """Return the servos that a plant file holds.

    Parameters
    ----------
    path
        A YAML file with the mapping ``plant``, as in specs, and perhaps ``identified``: where its numbers are from.

    Raises
    ------
    FileFormatError
        If it cannot be read or holds something else.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> file = pathlib.Path(tempfile.mkdtemp()) / "my_arm.yaml"
    >>> _ = file.write_text("plant: {kind: servo, time_constant: [0.05, 0.03], delay: 0.012}")
    >>> load_servo(file).time_constant
    [0.05, 0.03]
    """
    path = Path(path)
    return convert(path, _content(path), _PlantFile).plant


def fitting_lags(servo: Servo) -> list[tuple[float, float]]:
    """Return ω (rad/s) and ζ of each joint, of first-order ones that of a critically damped one that is as late."""
    columns = (servo.bandwidth, servo.damping_ratio, servo.time_constant)
    size = max(np.size(each) for each in columns)
    rows = zip(*(np.broadcast_to(each, size).tolist() for each in columns), strict=True)
    return [(omega, ratio) if omega else (2 / max(lag, _LEAST_LAG), 1.0) for omega, ratio, lag in rows]


def encoders_and_mode(servo: Servo) -> dict[str, Any]:
    """Return what all plants with joints take of a servo: its encoders, and from where commands count."""
    keys = ("command_mode", "encoder_resolution", "encoder_noise")
    return {key: getattr(servo, key) for key in keys}


def say_what_is_left_out(path: Path, servo: Servo, plant: str, keys: Sequence[str]) -> None:
    """Warn with a note of what a plant file holds that a plant of another kind has no place for."""
    left = []
    for key in keys:
        usual, unit, words = _OF_SERVOS[key]
        if key == "lags":
            values = [2 * ratio / omega for omega, ratio in fitting_lags(servo)]
        else:
            values = np.ravel(getattr(servo, key)).tolist()
        if any(abs(value - usual) > 1e-9 for value in values):
            ends = sorted({f"{min(values):.3g}", f"{max(values):.3g}"}, key=float)
            left.append(words.format(" to ".join(ends) + unit))
    if left:
        note = f"{path}: {plant} has no place for {', '.join(left)}: left out"
        warnings.warn(note, NoteWarning, stacklevel=3)


def _content(path: Path) -> dict[str, Any]:
    data = parse_yaml(path, read_text(path))
    if not isinstance(data, dict) or not isinstance(data.get("plant"), dict):
        raise FileFormatError(f"{path}: is no plant file: it needs the mapping 'plant', with kind: servo")
    if data["plant"].get("kind") != "servo":
        raise FileFormatError(f"{path}: plant.kind: expected 'servo', got {data['plant'].get('kind')!r:.40}")
    return data

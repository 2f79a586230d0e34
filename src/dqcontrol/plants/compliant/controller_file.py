"""Controller files: motors, springs, sensors and gains of one arm's joints."""

from __future__ import annotations

import math
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
from msgspec import Meta
from numpy.typing import ArrayLike

from dqcontrol.arrays import Array
from dqcontrol.errors import (
    FileFormatError,
    ShapeError,
    ValueRangeError,
    as_array,
    as_each,
    suggest,
    unknown_name,
)
from dqcontrol.files.yaml_file import read_yaml
from dqcontrol.named_fields import NamedFields, Three
from dqcontrol.plants.compliant import joint_columns as column
from dqcontrol.plants.compliant.elastic_model import TICK, Actuation, Hand
from dqcontrol.plants.compliant.joint_columns import butterworth
from dqcontrol.robots.files.robot_file import JointInertia
from dqcontrol.robots.robot import Robot

if TYPE_CHECKING:
    from dqcontrol.plants.compliant.compliant_plant import CompliantPlant


_OURS = Path(__file__).parent / "controllers"
SOFTEST, STIFFEST = 0.01, 1e6  # N·m/rad

Stiffness = Annotated[float, Meta(ge=SOFTEST, le=STIFFEST, description="N·m/rad")]
Springs = Annotated[list[Stiffness | None], Meta(min_length=1, max_length=1000)]


class _ControllerPart(NamedFields, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Base of all parts of a controller file. All quantities are those seen at the joint."""


class Motor(_ControllerPart, frozen=True, kw_only=True):
    """Motor, gear and amplifier."""

    rotor_inertia: Annotated[float, Meta(gt=0, le=1e3, description="of the motor, with the gear, kg m²")]
    friction: Annotated[float, Meta(ge=0, le=1e4, description="viscous, on the rotor, N·m·s/rad")]
    torque_constant: Annotated[float, Meta(gt=0, le=1e5, description="of the motor, with the gear, N·m/A")]
    resistance: Annotated[float, Meta(gt=0, le=1e4, description="of the winding, Ω")]
    voltage: Annotated[float, Meta(gt=0, le=1e3, description="of the supply, V")]
    max_duty: Annotated[float, Meta(gt=0, le=1, description="largest share of the voltage in mode PWM")]
    max_current: Annotated[float, Meta(gt=0, le=1e4, description="that the amplifier gives, A")]
    nominal_current: Annotated[float, Meta(gt=0, le=1e4, description="that the motor bears for ever, A")]
    thermal_time: Annotated[float, Meta(gt=0, le=1e5, description="time constant of the winding's heat, s")]
    overload_time: Annotated[float, Meta(gt=0, le=1e3, description="that the motor may stay too hot, s")]


class JointRange(_ControllerPart, frozen=True, kw_only=True):
    """What may be asked of a joint."""

    lower: Annotated[float, Meta(ge=-100, le=100, description="min_q, rad")]
    upper: Annotated[float, Meta(ge=-100, le=100, description="max_q, rad")]
    slew_rate: Annotated[float, Meta(gt=0, le=100, description="of the reference at most, rad/s")]
    torque: Annotated[float, Meta(gt=0, le=1e4, description="largest desired torque, N·m")]


class PositionLoop(_ControllerPart, frozen=True, kw_only=True):
    """PID from angle to torque, of the modes THETA_GC and THETA_GC_MJ."""

    k_p: Annotated[float, Meta(ge=0, le=1e6, description="of the angle's error, N·m/rad")]
    k_i: Annotated[float, Meta(ge=0, le=1e7, description="of its integral, N·m/(rad·s)")] = 0.0
    k_d: Annotated[float, Meta(ge=0, le=1e5, description="of the measured velocity, N·m·s/rad")] = 0.0
    integral_limit: Annotated[float, Meta(ge=0, le=1e4, description="of the integral's torque, N·m")] = 0.0
    integral_range: Annotated[float, Meta(ge=0, le=1e3, description="error that is integrated, rad")] = 0.0


class TorqueLoop(_ControllerPart, frozen=True, kw_only=True):
    """PID from spring torque to current, with a feed-forward share of the desired torque."""

    k_p: Annotated[float, Meta(ge=0, le=1e4, description="of the torque's error, A/(N·m)")] = 0.0
    k_i: Annotated[float, Meta(ge=0, le=1e6, description="of its integral, A/(N·m·s)")] = 0.0
    k_d: Annotated[float, Meta(ge=0, le=1e3, description="of the measured torque's rate, A·s/(N·m)")] = 0.0
    integral_limit: Annotated[float, Meta(ge=0, le=1e4, description="of the integral's current, A")] = 0.0
    integral_range: Annotated[float, Meta(ge=0, le=1e5, description="error that is integrated, N·m")] = 0.0
    feedforward: Annotated[float, Meta(ge=0, le=2, description="share of desired torque / torque constant")]


class AngleServo(_ControllerPart, frozen=True, kw_only=True):
    """Position servo on the motor's angle, of the modes THETA and THETA_MJ."""

    bandwidth: Annotated[float, Meta(gt=0, le=50, description="at the start configuration, Hz")]
    damping_ratio: Annotated[float, Meta(ge=0, le=10, description="ζ of the same")]


class Sensors(_ControllerPart, frozen=True, kw_only=True):
    """Encoder and torque sensor, and the third-order Butterworth filters behind them."""

    angle_resolution: Annotated[float, Meta(ge=0, le=1, description="step of the encoder, rad; 0 for none")]
    torque_resolution: Annotated[float, Meta(ge=0, le=1e3, description="step of the sensor, N·m; 0 for none")]
    angle_cutoff: Annotated[float, Meta(gt=0, le=450, description="of the angle's filter, Hz")]
    velocity_cutoff: Annotated[float, Meta(gt=0, le=450, description="of the velocity's filter, Hz")]
    torque_rate_cutoff: Annotated[float, Meta(gt=0, le=450, description="of the torque rate's filter, Hz")]


class JointControl(_ControllerPart, frozen=True, kw_only=True):
    """One joint."""

    name: Annotated[str, Meta(min_length=1, description="as in the robot's file, in the same order")]
    motor: Motor
    spring_damping: Annotated[float, Meta(ge=0, le=1e4, description="beside the spring, N·m·s/rad")]
    range: JointRange
    position_loop: PositionLoop
    torque_loop: TorqueLoop
    angle_servo: AngleServo
    sensors: Sensors


class WristSensor(_ControllerPart, frozen=True, kw_only=True):
    """Six-axis force–torque sensor between arm and hand, axes of the tool."""

    cutoff: Annotated[float, Meta(gt=0, le=450, description="of its filter, Hz")]
    force_noise: Annotated[float, Meta(ge=0, le=1e3, description="standard deviation, N")]
    torque_noise: Annotated[float, Meta(ge=0, le=1e3, description="standard deviation, N·m")]
    force_bias: Annotated[Three, Meta(description="three numbers, N")] = (0.0, 0.0, 0.0)
    torque_bias: Annotated[Three, Meta(description="three numbers, N·m")] = (0.0, 0.0, 0.0)


class Safety(_ControllerPart, frozen=True, kw_only=True):
    """When the motors are switched off."""

    command_timeout: Annotated[float, Meta(gt=0, le=100, description="age of the last command, s")]
    sensor_timeout: Annotated[float, Meta(gt=0, le=100, description="time without encoder, s")]


class ControllerFile(_ControllerPart, frozen=True, kw_only=True):
    """A controller file: an arm's joints at 1 kHz."""

    robot: Annotated[str, Meta(min_length=1, description="that the controllers are for")]
    description: Annotated[str, Meta(description="of the file")] = ""
    sources: Annotated[list[str], Meta(description="where the numbers are from")] = []
    springs: Annotated[
        dict[str, Springs],
        Meta(min_length=1, description="presets by name: N·m/rad for each joint, null for a rigid one"),
    ]
    hands: Annotated[dict[str, JointInertia], Meta(description="by name: a body in the tool's frame")] = {}
    wrist_sensor: WristSensor
    safety: Safety
    ramp_time: Annotated[float, Meta(gt=0, le=100, description="of a mode change, s")]
    joints: Annotated[
        list[JointControl], Meta(min_length=1, max_length=1000, description="one by one: below")
    ]

    def column(self, *path: str) -> Array:
        """Return one number of every joint, shape (n,), as ``column("motor", "friction")``."""
        number = attrgetter(".".join(path))
        return np.array([number(joint) for joint in self.joints], dtype=np.float64)

    def stiffness(self, springs: str | list[float | None]) -> Array:
        """Return the springs' stiffness by a preset's name or a list, shape (n,), N·m/rad; infinite where rigid.

        Raises
        ------
        UnknownNameError, ShapeError, ValueRangeError
            If there is no such preset or the list does not fit.
        """
        if isinstance(springs, str):
            if springs not in self.springs:
                raise unknown_name("plant.springs", springs, self.springs)
            springs = self.springs[springs]
        if len(springs) != len(self.joints):
            raise ShapeError(f"plant.springs: expected {len(self.joints)} numbers, got {len(springs)}")
        values = np.array([np.inf if value is None else value for value in springs], dtype=np.float64)
        finite = values[np.isfinite(values)]
        if np.isnan(values).any() or ((finite < SOFTEST) | (finite > STIFFEST)).any():
            raise ValueRangeError(
                f"plant.springs: must lie in {SOFTEST:g} … {STIFFEST:g} N·m/rad, or be null for a rigid joint, "
                f"got {springs}"
            )
        return values

    def actuation(self, springs: str | list[float | None], dry_friction: Array | None = None) -> Actuation:
        """Return what lies between the motors' currents and the links; no file tells of dry friction, N·m."""
        motor = self.column("motor", "rotor_inertia"), self.column("motor", "friction")
        dry = np.zeros(len(self.joints)) if dry_friction is None else dry_friction
        return Actuation(*motor, self.stiffness(springs), self.column("spring_damping"), dry)

    def hand(self, name: str | bool) -> Hand | None:
        """Return a hand by its name, the file's first if True, or None if False.

        Raises
        ------
        ValueRangeError, UnknownNameError
            If the file has no hand, or none of that name.
        """
        if name is False:
            return None
        if not self.hands:
            raise ValueRangeError(f"plant.hand: the controllers of {self.robot} describe no hand; use false")
        if name is True:
            name = next(iter(self.hands))
        if name not in self.hands:
            raise unknown_name("plant.hand", name, self.hands)
        body = self.hands[name]
        return Hand(body.mass, as_array(f"hands.{name}.center", body.center, (3,)), body.tensor.matrix)


def known_controllers() -> tuple[str, ...]:
    """Return the names of the robots whose controllers come with dqcontrol."""
    return tuple(sorted(path.stem for path in _OURS.glob("*.yaml")))


def load_controllers(robot: Robot, path: str | None = None) -> ControllerFile:
    """Read the controllers of a robot.

    Parameters
    ----------
    robot
        The arm.
    path
        A controller file; by the robot's name if omitted.

    Raises
    ------
    FileFormatError, ValueRangeError, ShapeError
        If the robot is not known and no file is given, or the file is malformed or does not fit the robot.

    Examples
    --------
    >>> import dqcontrol as dqc
    >>> load_controllers(dqc.load_robot("meka-a2")).column("motor", "rotor_inertia")[0]
    np.float64(0.1987)
    """
    if path is None and robot.name not in known_controllers():
        raise ValueRangeError(
            f"plant.controllers: no controllers are known for '{robot.name}'"
            f"{suggest(robot.name, known_controllers())}; they are for {', '.join(known_controllers())}; "
            "give a controller file"
        )
    where = Path(path) if path is not None else _OURS / f"{robot.name}.yaml"
    file = read_yaml(where, ControllerFile)
    names = [joint.name for joint in file.joints]
    if names != list(robot.joint_names):
        raise ShapeError(
            f"{where}: joints: must be those of {robot.name}, {', '.join(robot.joint_names)}, got {', '.join(names)}"
        )
    for joint in file.joints:
        if joint.range.lower >= joint.range.upper:
            raise FileFormatError(
                f"{where}: {joint.name}.range: lower {joint.range.lower:g} must be below upper {joint.range.upper:g}"
            )
    for name, springs in file.springs.items():
        if len(springs) != len(names):
            raise FileFormatError(
                f"{where}: springs.{name}: expected {len(names)} numbers, got {len(springs)}"
            )
    return file


_POSITION_MODES = (column.THETA_GC, column.THETA_GC_MJ)
_SERVO_MODES = (column.THETA, column.THETA_MJ)


def constants_table(
    plant: CompliantPlant, file: ControllerFile, actuation: Actuation, inertia: Array
) -> Array:
    """Return the joint controllers' constants, shape (n, CONSTANTS); ``inertia`` (n,) is what each motor moves."""
    n = len(file.joints)
    table = np.zeros((n, column.CONSTANTS))

    def put(index: int, value: ArrayLike) -> None:
        table[:, index] = value

    put(column.LOWER, file.column("range", "lower"))
    put(column.UPPER, file.column("range", "upper"))
    fastest = file.column("range", "slew_rate")
    if plant.slew_rate is not None:
        fastest = np.minimum(fastest, as_each("plant.slew_rate", plant.slew_rate, n))
    put(column.SLEW, TICK * fastest)
    put(column.SPEED, as_each("plant.speed", plant.speed, n))
    put(column.STIFFNESS, as_each("plant.stiffness", plant.stiffness, n))
    put(column.TORQUE_ASKED, as_each("plant.torque", plant.torque, n))
    put(column.DUTY_ASKED, as_each("plant.duty", plant.duty, n))
    put(column.POSITION_P, file.column("position_loop", "k_p"))
    put(column.POSITION_I, TICK * file.column("position_loop", "k_i"))
    put(column.POSITION_D, file.column("position_loop", "k_d"))
    put(column.POSITION_LIMIT, file.column("position_loop", "integral_limit"))
    put(column.POSITION_RANGE, file.column("position_loop", "integral_range"))
    put(column.TORQUE_P, file.column("torque_loop", "k_p"))
    put(column.TORQUE_I, TICK * file.column("torque_loop", "k_i"))
    put(column.TORQUE_D, file.column("torque_loop", "k_d"))
    put(column.TORQUE_LIMIT, file.column("torque_loop", "integral_limit"))
    put(column.TORQUE_RANGE, file.column("torque_loop", "integral_range"))
    torque_constant = file.column("motor", "torque_constant")
    put(column.FEEDFORWARD, file.column("torque_loop", "feedforward") / torque_constant)
    rate = 2 * math.pi * file.column("angle_servo", "bandwidth")
    put(column.SERVO_P, inertia * rate**2)
    put(column.SERVO_D, 2 * file.column("angle_servo", "damping_ratio") * inertia * rate)
    put(column.MAX_TORQUE, file.column("range", "torque"))
    put(column.MAX_CURRENT, file.column("motor", "max_current"))
    put(column.TORQUE_CONSTANT, torque_constant)
    put(column.RESISTANCE, file.column("motor", "resistance"))
    put(column.VOLTAGE, file.column("motor", "voltage"))
    put(column.MAX_DUTY, file.column("motor", "max_duty"))
    put(column.NOMINAL_CURRENT, file.column("motor", "nominal_current"))
    put(column.HEATING, -np.expm1(-TICK / file.column("motor", "thermal_time")))
    put(column.OVERLOAD_TICKS, np.ceil(file.column("motor", "overload_time") / TICK))
    own = file.column("sensors", "angle_resolution")
    put(column.ANGLE_RESOLUTION, own if plant.encoder_resolution is None else plant.encoder_resolution)
    put(column.ANGLE_NOISE, plant.encoder_noise)
    put(column.TORQUE_RESOLUTION, file.column("sensors", "torque_resolution"))
    put(column.SPRING, np.where(actuation.elastic, actuation.stiffness, 0.0))
    put(column.SPRING_DAMPING, np.where(actuation.elastic, actuation.damping, 0.0))
    for row, joint in zip(table, file.joints, strict=True):
        for first, cutoff in (
            (column.ANGLE_FILTER, joint.sensors.angle_cutoff),
            (column.VELOCITY_FILTER, joint.sensors.velocity_cutoff),
            (column.TORQUE_RATE_FILTER, joint.sensors.torque_rate_cutoff),
        ):
            coefficients = butterworth(cutoff, TICK)
            row[first : first + len(coefficients)] = coefficients
    return table


def gravity_bodies(robot: Robot, hand: Hand | None) -> Array:
    """Return the body table of the controllers' model, the hand in the last body, shape (n, 4)."""
    if robot.inertia is None:
        raise ValueRangeError(f"inertia: {robot.name} has none, so its gravity torque is unknown")
    bodies = robot.inertia.table.copy()
    if hand is not None:
        mass, center = bodies[-1, 0], bodies[-1, 1:].copy()
        w, v, position = robot.chain[-1, 0], robot.chain[-1, 1:4], robot.chain[-1, 4:7]
        at = position + hand.center + 2 * np.cross(v, w * hand.center + np.cross(v, hand.center))
        bodies[-1, 0] = mass + hand.mass
        bodies[-1, 1:] = (mass * center + hand.mass * at) / bodies[-1, 0]
    return bodies


def static_state(
    robot: Robot, constants: Array, mode: int, q: Array, load: Array, gravity_factor: float
) -> Array:
    """Return the controllers' state in which they hold a load at q, shape (n, STATE).

    In balance the motor's torque and the spring's are the load g. The torque loop makes it of the desired torque τ by
    k_τ (k_p (τ − g) + I) + f τ = g, with I = 0 unless there is an integral gain; the position loop makes τ of the
    reference r by τ = s (k_p (r − q) + I) + γ g, with γ the gravity factor. Integrals take what they can.

    Parameters
    ----------
    mode
        Of all joints; modes without position control are left as they are at rest.
    q
        Shape (n,), rad.
    load
        Shape (n,), N·m.

    Raises
    ------
    ValueRangeError
        If a desired torque or a current beyond its limit would be needed.
    """
    state = np.zeros((len(q), column.STATE))
    state[:, column.TARGET] = state[:, column.REFERENCE] = state[:, column.GOAL] = q
    state[:, column.ENCODER], state[:, column.SENSED], state[:, column.MOTOR_TORQUE] = q, load, load
    if mode in _SERVO_MODES:
        spring = np.where(constants[:, column.SPRING] > 0, constants[:, column.SPRING], np.inf)
        state[:, column.TARGET] += load / spring + load / constants[:, column.SERVO_P]
    elif mode in _POSITION_MODES:
        for row, number, name, g in zip(state, constants, robot.joint_names, load, strict=True):
            desired = _held_by_torque_loop(row, number, g)
            if abs(desired) > number[column.MAX_TORQUE]:
                raise ValueRangeError(
                    f"start: joint '{name}' would need a desired torque of {desired:.3g} N·m to hold {g:.3g} N·m; "
                    f"its limit is {number[column.MAX_TORQUE]:g}"
                )
            _held_by_position_loop(row, number, desired - gravity_factor * g)
    for number, name, g in zip(constants, robot.joint_names, load, strict=True):
        if (
            mode in _SERVO_MODES + _POSITION_MODES
            and abs(g) > number[column.TORQUE_CONSTANT] * number[column.MAX_CURRENT]
        ):
            raise ValueRangeError(
                f"start: joint '{name}' needs {g / number[column.TORQUE_CONSTANT]:.3g} A to hold {g:.3g} N·m; "
                f"its limit is {number[column.MAX_CURRENT]:g} A"
            )
    state[:, column.REFERENCE] = state[:, column.GOAL] = state[:, column.TARGET]
    return state


def _held_by_torque_loop(state: Array, constants: Array, load: float) -> float:
    """Set the torque loop's integral so that it holds a load, and return the desired torque that goes with it."""
    current = load / constants[column.TORQUE_CONSTANT]
    proportional, forward = constants[column.TORQUE_P], constants[column.FEEDFORWARD]
    if constants[column.TORQUE_I] > 0:
        limit = constants[column.TORQUE_LIMIT]
        state[column.TORQUE_INTEGRAL] = np.clip(current - forward * load, -limit, limit)
    gain = proportional + forward
    if gain == 0:
        return load
    return float((current - state[column.TORQUE_INTEGRAL] + proportional * load) / gain)


def _held_by_position_loop(state: Array, constants: Array, torque: float) -> None:
    """Set the position loop's integral and target so that they make a torque, as far as they can."""
    stiffness = constants[column.STIFFNESS]
    if stiffness * constants[column.POSITION_P] == 0:
        return
    wanted = torque / stiffness
    if constants[column.POSITION_I] > 0:
        limit = constants[column.POSITION_LIMIT]
        state[column.POSITION_INTEGRAL] = np.clip(wanted, -limit, limit)
    state[column.TARGET] += (wanted - state[column.POSITION_INTEGRAL]) / constants[column.POSITION_P]

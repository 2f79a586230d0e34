"""Controller files: motors, springs, sensors and gains of one arm's joints."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
from msgspec import Meta

from dqcontrol.arrays import Array
from dqcontrol.errors import FileFormatError, ShapeError, ValueRangeError, as_array, suggest, unknown_name
from dqcontrol.files.yaml_file import read_yaml
from dqcontrol.named_fields import NamedFields
from dqcontrol.plants.compliant.elastic_model import Actuation, Hand
from dqcontrol.robots.files.robot_file import JointInertia
from dqcontrol.robots.robot import Robot

_OURS = Path(__file__).parent / "controllers"
SOFTEST, STIFFEST = 0.01, 1e6  # N·m/rad

Stiffness = Annotated[float, Meta(ge=SOFTEST, le=STIFFEST, description="N·m/rad")]
Bias = tuple[float, float, float]
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
    force_bias: Annotated[Bias, Meta(description="three numbers, N")] = (0.0, 0.0, 0.0)
    torque_bias: Annotated[Bias, Meta(description="three numbers, N·m")] = (0.0, 0.0, 0.0)


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
        rows = []
        for joint in self.joints:
            value = joint
            for name in path:
                value = getattr(value, name)
            rows.append(value)
        return np.array(rows, dtype=np.float64)

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

    def actuation(self, springs: str | list[float | None]) -> Actuation:
        """Return what lies between the motors' currents and the links, without dry friction, of which no file tells."""
        return Actuation(
            self.column("motor", "rotor_inertia"),
            self.column("motor", "friction"),
            self.stiffness(springs),
            self.column("spring_damping"),
            np.zeros(len(self.joints)),
        )

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
        body, t = self.hands[name], self.hands[name].tensor
        tensor = np.array([[t.xx, t.xy, t.xz], [t.xy, t.yy, t.yz], [t.xz, t.yz, t.zz]])
        return Hand(body.mass, as_array(f"hands.{name}.center", body.center, (3,)), tensor)


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

"""A compliant arm: series elastic joints in MuJoCo under the joint controllers of the M3 software."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self

from msgspec import Meta
from msgspec.structs import replace

from dqcontrol.arrays import Array
from dqcontrol.contact import Impedance, PreparedImpedance
from dqcontrol.errors import ValueRangeError, as_each
from dqcontrol.plants.compliant import loads_and_faults
from dqcontrol.plants.compliant.controller_file import Stiffness, load_controllers
from dqcontrol.plants.compliant.elastic_model import TICK
from dqcontrol.plants.linear_model import LinearModel
from dqcontrol.plants.plant import ControllerSettings, Plant
from dqcontrol.plants.servo.servo_plant import encoders_and_mode, load_servo, say_what_is_left_out
from dqcontrol.robots.robot import CommandMode, Robot
from dqcontrol.world import World

if TYPE_CHECKING:
    from dqcontrol.plants.compliant.running_compliant import RunningCompliant

# s, roughly: a step without ticks of its joint controllers, and each tick; by `accurate`
_STEP, _TICK = 5e-5, {False: 7e-6, True: 1.6e-5}
Mode = Literal["OFF", "PWM", "TORQUE", "TORQUE_GC", "THETA", "THETA_GC", "THETA_MJ", "THETA_GC_MJ"]
_BY_TORQUE = ("TORQUE", "TORQUE_GC")
_AT_ONCE = ("THETA", "THETA_GC")  # those that follow a commanded angle at once
Share = Annotated[float, Meta(ge=0, le=1, description="0 … 1")]
_DryFriction = Annotated[float, Meta(ge=0, le=1e4)]
_Speed = Annotated[float, Meta(ge=0, le=100)]
_Torque = Annotated[float, Meta(ge=-1e4, le=1e4)]
_Duty = Annotated[float, Meta(ge=-1, le=1)]


class CompliantPlant(Plant, frozen=True, kw_only=True, tag="compliant"):
    """Rotors, springs and links of an arm, driven by its joint controllers at 1 kHz.

    The velocity command u of each period T becomes an angle q_desired for every joint, which the mode's controller
    follows; see docs/physics.md for the modes' equations. Springs, motors, gains and sensors come from a controller
    file; those of ``meka-a2`` and ``iiwa7`` come with dqcontrol.

    The arm starts at rest and in balance, its controllers running, unless their torques do not suffice.

    Parameters
    ----------
    mode
        Of the joint controllers.
    command_mode
        ``"integrated"``: q_desired grows by T u; ``"measured"``: q_desired = measured q + T u.
    stiffness
        Scales the position loop's torque in THETA_GC and THETA_GC_MJ, 0 to 1: one number, or one a joint.
    gravity_factor
        By how much the controllers' model of gravity is wrong; 1 if exact.
    hand
        That the arm bears: the first of its controller file, one by name, or none. The controllers know it.
    springs
        Name of a preset in the controller file, or N·m/rad for each joint, null for a rigid one.
    accurate
        True: Runge-Kutta steps, which keep the energy; False: faster ones.
    controllers
        A controller file; by the robot's name if omitted.
    encoder_resolution
        Step of the encoders, rad; that of the controller file if omitted; 0 for none.
    encoder_noise
        Standard deviation of the encoders at 1 kHz, rad, white.
    dry_friction
        Of the gears, on the rotors' side of the springs, N·m at the joint, whatever the speed: one number, or one a
        joint.
    exchange_period
        Time from one exchange between control loop and joint controllers to the next, s, a multiple of 1 ms, as of a
        robot's node that passes states and commands on at a rate of its own: what is measured is what it passed on
        last, and a command reaches the joints with the next exchange. The first is at the start; at every tick if
        omitted.
    base_shaking
        Intensity of a white acceleration of the base that the controllers do not know, in each direction, m/s²/√Hz;
        it is drawn once a control period, with this over √T as its standard deviation.
    slew_rate
        Of the reference in THETA and THETA_GC, rad/s: one number, or one a joint; at most the controller file's.
    speed
        Mean speed of minimum-jerk motions in THETA_MJ and THETA_GC_MJ, rad/s: one number, or one a joint.
    torque
        Asked for in TORQUE and TORQUE_GC, N·m: one number, or one a joint.
    impedance
        Asked for in TORQUE and TORQUE_GC in the place of ``torque``: springs of the end effector
        (`dqcontrol.contact.Impedance`), from the filtered angles and rates, without the hand's weight in TORQUE.
        Measured are then the targets, which are what a law leads.
    duty
        Share of the voltage asked for in PWM, −1 to 1: one number, or one a joint.
    pushes
        Forces from outside.
    payload
        Masses at the hand that the controllers do not know.
    payload_compensation
        That they weigh it with the wrist sensor, and carry it.
    encoder_losses
        When which encoder is silent.
    wrist_fault
        When the wrist sensor reads something else than what it bears.
    gravity
        m/s², base frame.
    world
        What links touch, each other included; nothing if omitted. A spec gives its own.

    Raises
    ------
    UnknownNameError, ValueRangeError, ShapeError
        If a parameter lies outside of what is allowed.

    Examples
    --------
    >>> import numpy as np, dqcontrol as dqc
    >>> arm, q = dqc.load_robot("meka-a2"), np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])
    >>> live = CompliantPlant(mode="THETA_GC", hand=True).start(arm, q, period=0.008, steps=1, seed=0)
    >>> live.step(np.zeros(7))
    >>> bool(abs(live.q - q).max() < 1e-3)
    True
    """

    has_velocity_limits: ClassVar[bool] = True
    tick: ClassVar[float] = TICK  # s, of the joint controllers
    file_keys: ClassVar[tuple[str, ...]] = ("controllers",)
    mode: Mode = "THETA_GC"
    command_mode: CommandMode = "integrated"
    stiffness: Share | list[Share] = 1.0
    gravity_factor: Annotated[float, Meta(ge=0, le=10, description="1 if exact")] = 1.0
    hand: bool | str = False
    springs: str | list[Stiffness | None] = "default"
    accurate: bool = False
    controllers: str | None = None
    encoder_resolution: Annotated[float, Meta(ge=0, le=1, description="rad")] | None = None
    encoder_noise: Annotated[float, Meta(ge=0, le=1, description="rad")] = 0.0
    dry_friction: Annotated[_DryFriction | list[_DryFriction], Meta(description="N·m")] = 0.0
    exchange_period: Annotated[float, Meta(gt=0, le=1, description="s")] | None = None
    base_shaking: Annotated[float, Meta(ge=0, le=10, description="m/s²/√Hz")] = 0.0
    slew_rate: Annotated[_Speed | list[_Speed] | None, Meta(description="rad/s")] = None
    speed: Annotated[_Speed | list[_Speed], Meta(description="rad/s")] = 0.5
    torque: Annotated[_Torque | list[_Torque], Meta(description="N·m")] = 0.0
    impedance: Impedance | None = None
    duty: Annotated[_Duty | list[_Duty], Meta(description="−1 … 1")] = 0.0
    pushes: Annotated[list[loads_and_faults.Push], Meta(max_length=1000)] = []
    payload: loads_and_faults.Payload | list[loads_and_faults.Payload] | None = None
    payload_compensation: loads_and_faults.PayloadCompensation | None = None
    encoder_losses: Annotated[list[loads_and_faults.EncoderLoss], Meta(max_length=1000)] = []
    wrist_fault: loads_and_faults.WristFault | None = None
    gravity: tuple[float, float, float] = (0.0, 0.0, -9.809)
    world: World | None = None
    touches_world: ClassVar[bool] = True

    @classmethod
    def of_servos(cls, path: Path) -> dict[str, Any]:
        """Return what fits of a plant file of servos: the encoders and the command mode.

        Its lags follow from motors, springs and gains.
        """
        servo = load_servo(path)
        say_what_is_left_out(path, servo, "a compliant arm", ("lags", "gain", "delay", "friction", "sag"))
        found = encoders_and_mode(servo)
        return {key: max(value) if isinstance(value, list) else value for key, value in found.items()}

    def __post_init__(self) -> None:
        impedance = self.impedance
        if impedance is None:
            return
        if self.mode not in _BY_TORQUE:
            raise ValueRangeError(
                f"plant.impedance: asks for torques, so mode must be {' or '.join(_BY_TORQUE)}"
            )
        if self.command_mode != "integrated" or impedance.feels:
            raise ValueRangeError(
                "plant.impedance: pulls towards a target that stays, by springs alone; "
                "command_mode: integrated, and no 'mass'"
            )

    def start(self, robot: Robot, start: Array, period: float, steps: int, seed: int) -> RunningCompliant:
        """Return the arm at rest at start.

        Parameters
        ----------
        robot
            An arm of revolute joints with inertias, and with controllers of its own or those of a file.
        start
            First configuration, shape (n,), rad, within the position limits.
        period
            Control period T, s, a multiple of 1 ms.
        steps
            Number of periods; a live arm can be stepped further, as its noise is drawn step by step.
        seed
            Of the noise; the same seed gives bit-equal runs.

        Raises
        ------
        MissingExtraError
            If mujoco is not installed.
        Error
            If something does not fit the robot, or its motors cannot hold it at start.
        """
        from dqcontrol.plants.compliant.running_compliant import RunningCompliant, assemble

        return RunningCompliant(self, assemble(self, robot, start, period), seed)

    def joint_control(self, joints: int) -> ControllerSettings:
        """Return its mode and stiffness, its slew rate if it has one of its own, and what its mode asks for."""
        slew_rate = None if self.slew_rate is None else as_each("plant.slew_rate", self.slew_rate, joints)
        stiffness, asked = as_each("plant.stiffness", self.stiffness, joints), None
        if self.mode == "PWM":
            asked = as_each("plant.duty", self.duty, joints)
        elif self.mode in _BY_TORQUE:
            asked = as_each("plant.torque", self.torque, joints)
        return ControllerSettings(self.mode, stiffness, slew_rate, asked)

    def by_effort(self) -> Self | None:
        """Return it with a mode that holds angles, while nothing drives the joints; None in modes without torques."""
        return replace(self, impedance=None) if self.mode in _BY_TORQUE else None

    def prepared_impedance(self, robot: Robot) -> PreparedImpedance | None:
        """Return its impedance for a robot, with the weight where the mode has no model of it."""
        if self.impedance is None:
            return None
        weight = self.gravity_factor if self.mode == "TORQUE" else 0.0
        rotors = load_controllers(robot, self.controllers).column("motor", "rotor_inertia")
        return self.impedance.prepare(robot, self.gravity, weight, rotors)

    def state_period(self, period: float) -> float:
        """Return its exchange period; the loop's own where the joint controllers have none."""
        return self.exchange_period or period

    def step_time(self, period: float, *, is_compiled: bool) -> float:
        """Return roughly how long a step takes; most of it are the ticks of the joint controllers."""
        return _STEP + _TICK[self.accurate] * period / TICK

    def linear_model(self, robot: Robot, start: Array, period: float) -> LinearModel | None:
        """Return all joints together, without gravity, limits and integrals; None where they do not follow angles.

        So it is in some modes, and without stiffness. Modes of minimum jerk plan anew at each command: not linear.
        """
        from dqcontrol.plants.compliant.running_compliant import linearised

        return linearised(self, robot, start, period) if self.mode in _AT_ONCE else None

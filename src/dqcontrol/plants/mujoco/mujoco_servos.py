"""Position servos of joints with masses, in MuJoCo: their parameters, and how a model gets them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, TypeAlias

import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from dqcontrol.arrays import Array
from dqcontrol.errors import ValueRangeError, as_array, as_each, as_positive, unknown_name
from dqcontrol.plants.mujoco.mujoco_model import import_mujoco
from dqcontrol.plants.plant import EncoderErrors, Plant
from dqcontrol.plants.servo.servo_file import (
    encoders_and_mode,
    fitting_lags,
    load_servo,
    say_what_is_left_out,
)
from dqcontrol.robots.command_mode import COMMAND_MODES, CommandMode

if TYPE_CHECKING:
    from dqcontrol.robots.robot import Robot


_Positive: TypeAlias = Annotated[float, Meta(gt=0)]
_Ratio: TypeAlias = Annotated[float, Meta(ge=0)]

_NOT_NEGATIVE = (
    "damping_ratio",
    "damping",
    "armature",
    "viscous_friction",
    "dry_friction",
    "encoder_resolution",
    "encoder_noise",
)


class JointServos(Plant, frozen=True, kw_only=True):
    """What `MujocoPlant`, which describes it, and `MobilePlant` share."""

    has_velocity_limits: ClassVar[bool] = True
    command_mode: CommandMode = "integrated"
    bandwidth: Annotated[_Positive | list[_Positive], Meta(description="Hz")] = 10.0
    damping_ratio: Annotated[_Ratio | list[_Ratio], Meta(description="ζ")] = 1.0
    stiffness: Annotated[float | list[float] | None, Meta(description="k_p, N·m/rad or N/m")] = None
    damping: Annotated[float | list[float] | None, Meta(description="k_d, N·m·s/rad or N·s/m")] = None
    timestep: Annotated[float, Meta(gt=0, description="s")] = 1e-3
    gravity: tuple[float, float, float] = (0.0, 0.0, -9.81)
    gravity_compensation: Annotated[float, Meta(ge=0, le=1, description="share of the gravity torque")] = 1.0
    armature: Annotated[float | list[float], Meta(description="kg m² or kg")] = 0.1
    viscous_friction: Annotated[float | list[float], Meta(description="N·m·s/rad or N·s/m")] = 0.0
    dry_friction: Annotated[float | list[float], Meta(description="N·m or N")] = 0.0
    position_limit: bool = True
    encoder_resolution: Annotated[float | list[float], Meta(description="rad or m")] = 0.0
    encoder_noise: Annotated[float | list[float], Meta(description="rad or m")] = 0.0

    def __post_init__(self) -> None:
        if self.command_mode not in COMMAND_MODES:
            raise unknown_name("plant.command_mode", str(self.command_mode), COMMAND_MODES)
        if isinstance(self.bandwidth, list):
            if (as_array("plant.bandwidth", self.bandwidth) <= 0).any():
                raise ValueRangeError(f"plant.bandwidth: must be > 0, got {self.bandwidth}")
        else:
            as_positive("plant.bandwidth", self.bandwidth)
        as_array("plant.gravity", self.gravity, (3,))
        if not 0 <= as_array("plant.gravity_compensation", self.gravity_compensation, ()) <= 1:
            raise ValueRangeError(
                f"plant.gravity_compensation: must lie in 0 … 1, got {self.gravity_compensation:g}"
            )
        if self.stiffness is not None and (as_array("plant.stiffness", self.stiffness) <= 0).any():
            raise ValueRangeError(f"plant.stiffness: must be > 0, got {self.stiffness}")
        for field in _NOT_NEGATIVE:
            value = getattr(self, field)
            if value is not None and (as_array(f"plant.{field}", value) < 0).any():
                raise ValueRangeError(f"plant.{field}: must be ≥ 0, got {value}")

    @classmethod
    def complete(cls, data: Mapping[str, Any], folder: Path) -> dict[str, Any]:
        """Return what a spec says of such a plant, with what fits of a plant file of servos in the place of ``file``.

        Those of second order keep ω and ζ at the inertia of the start; those of first order become critically damped
        ones that are as late for slow motions, ω = 2/τ.
        """
        if not isinstance(data.get("file"), str):
            return super().complete(data, folder)
        servo = load_servo(folder / data["file"])
        lags = fitting_lags(servo)
        found: dict[str, Any] = {
            "bandwidth": [round(bandwidth / (2 * math.pi), 9) for bandwidth, _ in lags],
            "damping_ratio": [ratio for _, ratio in lags],
            **encoders_and_mode(servo),
        }
        say_what_is_left_out(folder / data["file"], servo, "physics", ("gain", "delay", "friction", "sag"))
        return found | {key: value for key, value in data.items() if key != "file"}

    def target_mode(self) -> CommandMode:
        """Return its command mode."""
        return self.command_mode

    def encoder_errors(self) -> EncoderErrors:
        """Return noise and resolution of its encoders."""
        return EncoderErrors(self.encoder_noise, self.encoder_resolution)

    def substeps(self, period: float) -> int:
        """Return how many time steps a control period has."""
        period = as_positive("period", period)
        count = round(period / self.timestep)
        if count < 1 or abs(count * self.timestep - period) > 1e-9 * period:
            near = period / max(1, math.ceil(period / self.timestep))
            raise ValueRangeError(
                f"plant.timestep: the control period {period:g} s must be an integer multiple of it, "
                f"got {self.timestep:g} s ({near:.9g} would do)"
            )
        return count

    def add_servos(self, spec: Any, robot: Robot) -> None:
        """Give the joints of an arm their friction, stops and position servos, and the model its time step."""
        mujoco = import_mujoco()
        n = robot.configuration_size
        option = spec.option
        option.timestep = self.timestep
        option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        option.gravity = self.gravity
        option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET  # it would hide a divergence
        armature = as_each("plant.armature", self.armature, n)
        dry = as_each("plant.dry_friction", self.dry_friction, n)
        for i, name in enumerate(robot.joint_names):
            joint, effort = spec.joint(name), robot.limits.effort[i]
            joint.armature, joint.frictionloss = armature[i], dry[i]
            # A stop that gives way by milliradians, as stiff as the time step allows.
            joint.solref_limit, joint.solimp_limit[:2] = (4 * self.timestep, 1), (0.99, 0.999)
            # The activation integrates the control: the target moves at the rate that the control holds.
            servo = spec.add_actuator(
                name=name,
                target=name,
                trntype=mujoco.mjtTrn.mjTRN_JOINT,
                dyntype=mujoco.mjtDyn.mjDYN_INTEGRATOR,
                gaintype=mujoco.mjtGain.mjGAIN_FIXED,
                biastype=mujoco.mjtBias.mjBIAS_AFFINE,
            )
            if self.position_limit and joint.limited == mujoco.mjtLimited.mjLIMITED_TRUE:
                servo.actrange, servo.actlimited = joint.range, mujoco.mjtLimited.mjLIMITED_TRUE
            if np.isfinite(effort):  # of the servo, and of its sum with the gravity compensation
                servo.forcerange, servo.forcelimited = (-effort, effort), mujoco.mjtLimited.mjLIMITED_TRUE
                joint.actfrcrange, joint.actfrclimited = (-effort, effort), mujoco.mjtLimited.mjLIMITED_TRUE

    def set_servos(self, robot: Robot, model: Any, data: Any, start: Array, dofs: NDArray[np.intp]) -> None:
        """Set gains and targets of the servos, the model's first actuators, for the arm at rest as the data has it."""
        n = len(dofs)
        inertia = mass_matrix(model, data).diagonal()[dofs]
        load = data.qfrc_bias[dofs]
        if self.stiffness is None:
            stiffness = inertia * (2 * math.pi * as_each("plant.bandwidth", self.bandwidth, n)) ** 2
        else:
            stiffness = as_each("plant.stiffness", self.stiffness, n)
        if self.damping is None:
            ratio = as_each("plant.damping_ratio", self.damping_ratio, n)
            damping = 2 * ratio * np.sqrt(stiffness * inertia)
        else:
            damping = as_each("plant.damping", self.damping, n)
        model.actuator_gainprm[:n, 0] = stiffness
        model.actuator_biasprm[:n, 1] = -stiffness
        model.actuator_biasprm[:n, 2] = -damping
        for i, name in enumerate(robot.joint_names):
            if abs(load[i]) > robot.limits.effort[i]:
                raise ValueRangeError(
                    f"start: joint {i + 1} '{name}' needs {abs(load[i]):.4g} N·m to hold gravity; "
                    f"its effort limit is {robot.limits.effort[i]:g}"
                )
        data.act[:] = start + (1 - self.gravity_compensation) * load / stiffness


def mass_matrix(model: Any, data: Any) -> Array:
    """Return the joint-space inertia at the data's configuration, armature included, shape (n, n)."""
    mujoco, n = import_mujoco(), model.nv
    matrix, column = np.empty((n, n)), np.empty(n)
    for i, unit in enumerate(np.eye(n)):
        mujoco.mj_mulM(model, data, column, unit)
        matrix[:, i] = column
    return matrix

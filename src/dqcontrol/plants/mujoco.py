"""An arm with masses under position servos, moved by MuJoCo."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from dqcontrol.errors import ShapeError, ValueRangeError, as_array, as_positive, unknown_name
from dqcontrol.plants.linear_model import LinearModel
from dqcontrol.plants.mujoco_live import LiveMujoco, per_joint
from dqcontrol.plants.mujoco_model import add_inertias, compiled, import_mujoco, skeleton
from dqcontrol.plants.plant import Plant

if TYPE_CHECKING:
    from dqcontrol.robots.robot import Robot

Array = NDArray[np.float64]

COMMAND_MODES = ("integrated", "measured")
_NOT_NEGATIVE = (
    "damping",
    "armature",
    "viscous_friction",
    "dry_friction",
    "encoder_resolution",
    "encoder_noise",
)


class MujocoPlant(Plant, frozen=True, kw_only=True, tag="mujoco"):
    """Joints with masses, gravity and torque limits, held by position servos.

    Each servo applies τ = k_p (q* − q) − k_d q̇, clipped to the joint's effort limit. The velocity command u
    becomes servo targets once a period T; the target q* moves linearly from where it is to its new value over
    the period, as the interpolators of real arms do: a target that jumped would kick the joints by k_p T u.

    The arm starts at rest and in balance: the first target is q0 + τ_g / k_p, with τ_g the part of the
    gravity torque that is not compensated. As that part changes with the configuration, the joints sag.
    Position limits are mechanical stops, where a joint has both.

    Parameters
    ----------
    command_mode
        ``"integrated"``: q* grows by T u, whatever the joint does; at constant u the joint moves with
        velocity u, k_d / k_p seconds late. ``"measured"``: q* = measured q + T u, as of drivers that add the
        command to the encoder's reading; the joint then settles at the velocity u k_p T / (k_p T + k_d) and
        gives way to whatever part of gravity is not compensated.
    bandwidth
        Hz; k_p = M (2π bandwidth)² for each joint, M the diagonal of the joint-space inertia at the start,
        armature included.
    damping_ratio
        ζ; k_d = 2 ζ √(k_p M).
    stiffness, damping
        k_p (N·m/rad or N/m) and k_d (N·m·s/rad or N·s/m) in place of those: one number, or one a joint.
    timestep
        s; the control period must be a multiple of it.
    gravity
        m/s² in the base frame; (0, 0, 0) for none.
    gravity_compensation
        Share of the gravity torque that the arm's own controller adds, 0 to 1; 1 as in most industrial arms.
    armature
        Rotor inertia seen at the joint, kg m² (kg for sliding joints): one number, or one a joint.
    viscous_friction, dry_friction
        N·m·s/rad and N·m (N·s/m and N): one number, or one a joint.
    position_limit
        True: targets do not leave the position limits either.
    encoder_resolution
        Step of the measured position, rad or m: one number, or one a joint; 0 for none.
    encoder_noise
        Standard deviation of the measured position, rad or m, white: one number, or one a joint.

    Raises
    ------
    UnknownNameError, ValueRangeError, ShapeError
        If a parameter lies outside of what is allowed.

    Examples
    --------
    >>> import numpy as np, dqcontrol as dqc
    >>> arm = dqc.load_robot("iiwa7")
    >>> plant = MujocoPlant(bandwidth=10).start(arm, np.full(7, 0.3), dt=0.01, steps=1, seed=0)
    >>> plant.step(np.zeros(7))
    >>> bool(abs(plant.q - 0.3).max() < 1e-6)
    True
    """

    command_mode: Literal["integrated", "measured"] = "integrated"
    bandwidth: Annotated[float, Meta(gt=0, description="Hz")] = 10.0
    damping_ratio: Annotated[float, Meta(ge=0, description="ζ")] = 1.0
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
        as_positive("plant.bandwidth", self.bandwidth)
        as_positive("plant.timestep", self.timestep)
        as_positive("plant.damping_ratio", self.damping_ratio, zero_allowed=True)
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

    def start(self, robot: Robot, q0: Array, dt: float, steps: int, seed: int) -> LiveMujoco:
        """Return the arm at rest at q0.

        Parameters
        ----------
        robot
            An arm with inertias.
        q0
            First configuration, shape (n,), rad or m, within the position limits.
        dt
            Control period T, s.
        steps
            Number of periods; a live arm can be stepped further, as its noise is drawn step by step.
        seed
            Of the encoder noise; the same seed gives bit-equal runs.

        Raises
        ------
        MissingExtraError
            If mujoco is not installed.
        ShapeError, ValueRangeError
            If q0, dt or a parameter does not fit the robot, its inertias do not allow physics, or its effort
            limits cannot hold it at q0.
        """
        n = robot.configuration_size
        start = as_array("q0", q0, (n,))
        if start.ndim != 1:
            raise ShapeError(f"q0: expected shape ({n},), got {start.shape}")
        substeps = self._substeps(dt)
        lower, upper = robot.limits.lower, robot.limits.upper
        for i, name in enumerate(robot.joint_names):
            if not lower[i] <= start[i] <= upper[i]:
                raise ValueRangeError(
                    f"q0: joint {i + 1} '{name}' is at {start[i]:g}; must lie in {lower[i]:g} … {upper[i]:g}"
                )
        model = self._model(robot)
        data = self._balance(robot, model, start)
        return LiveMujoco(self, model, data, substeps, seed)

    def _substeps(self, dt: float) -> int:
        """Return how many time steps a control period has."""
        period = as_positive("dt", dt)
        count = round(period / self.timestep)
        if count < 1 or abs(count * self.timestep - period) > 1e-9 * period:
            near = period / max(1, math.ceil(period / self.timestep))
            raise ValueRangeError(
                f"plant.timestep: the control period {period:g} s must be an integer multiple of it, "
                f"got {self.timestep:g} s ({near:.9g} would do)"
            )
        return count

    def _model(self, robot: Robot) -> Any:
        """Build the model; gains are set later, at the start configuration."""
        mujoco = import_mujoco()
        n = robot.configuration_size
        spec = skeleton(robot)
        add_inertias(spec, robot)
        option = spec.option
        option.timestep = self.timestep
        option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        option.gravity = self.gravity
        # A reset after a divergence would hide it; nothing here touches anything.
        option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET | mujoco.mjtDisableBit.mjDSBL_CONTACT
        armature = per_joint("armature", self.armature, n)
        dry = per_joint("dry_friction", self.dry_friction, n)
        for i, name in enumerate(robot.joint_names):
            spec.body(f"link_{i + 1}").gravcomp = self.gravity_compensation
            joint, effort = spec.joint(name), robot.limits.effort[i]
            joint.armature, joint.frictionloss, joint.actgravcomp = armature[i], dry[i], True
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
        model = compiled(spec)
        model.dof_damping.reshape(n, -1)[:, 0] = per_joint("viscous_friction", self.viscous_friction, n)
        return model

    def _balance(self, robot: Robot, model: Any, start: Array) -> Any:
        """Set the servos' gains and targets for the start configuration."""
        mujoco = import_mujoco()
        n = model.nv
        data = mujoco.MjData(model)
        data.qpos[:] = start
        mujoco.mj_forward(model, data)
        inertia = _mass_matrix(model, data).diagonal()
        if self.stiffness is None:
            stiffness = inertia * (2 * math.pi * self.bandwidth) ** 2
        else:
            stiffness = per_joint("stiffness", self.stiffness, n)
        if self.damping is None:
            damping = 2 * self.damping_ratio * np.sqrt(stiffness * inertia)
        else:
            damping = per_joint("damping", self.damping, n)
        model.actuator_gainprm[:, 0] = stiffness
        model.actuator_biasprm[:, 1] = -stiffness
        model.actuator_biasprm[:, 2] = -damping
        for i, name in enumerate(robot.joint_names):
            if abs(data.qfrc_bias[i]) > robot.limits.effort[i]:
                raise ValueRangeError(
                    f"q0: joint {i + 1} '{name}' needs {abs(data.qfrc_bias[i]):.4g} N·m to hold gravity; "
                    f"its effort limit is {robot.limits.effort[i]:g}"
                )
        data.act[:] = start + (data.qfrc_bias - data.qfrc_gravcomp) / stiffness
        mujoco.mj_forward(model, data)
        return data

    def linear_model(self, robot: Robot, q0: Array, dt: float) -> LinearModel:
        """Return all joints together, coupled by their inertia at q0, in MuJoCo's own time steps.

        A step h takes v⁺ = (M + hD)⁻¹ (M v + h k_p (q* − q)) with D of servos and viscous friction, then
        q⁺ = q + h v⁺. What changes with the configuration (gravity, inertia), dry friction, effort limits and
        encoders are left out.
        """
        h, steps, n = self.timestep, self._substeps(dt), robot.configuration_size
        live = self.start(robot, q0, dt, 1, 0)
        mass, unit, none = _mass_matrix(live.model, live.data), np.eye(n), np.zeros((n, n))
        damping = np.diag(live.damping + live.model.dof_damping.reshape(n, -1)[:, 0])
        pull = h * np.linalg.solve(mass + h * damping, np.diag(live.stiffness))
        velocity = np.hstack([-pull, np.linalg.solve(mass + h * damping, mass), pull])
        step = np.eye(3 * n)  # of q, v and q*
        step[n : 2 * n] = velocity
        step[:n] += h * velocity
        transition, inputs = np.eye(3 * n), np.zeros((3 * n, n))
        for _ in range(steps):
            transition, inputs = step @ transition, step @ inputs
            inputs[2 * n :] += h * unit
        if self.command_mode == "measured":  # the target moves at the rate that ends at measured + T u
            transition += inputs @ np.hstack([unit, none, -unit]) / dt
        return LinearModel(transition, inputs)


def _mass_matrix(model: Any, data: Any) -> Array:
    """Return the joint-space inertia at the data's configuration, armature included, shape (n, n)."""
    mujoco, n = import_mujoco(), model.nv
    matrix, column = np.empty((n, n)), np.empty(n)
    for i, unit in enumerate(np.eye(n)):
        mujoco.mj_mulM(model, data, column, unit)
        matrix[:, i] = column
    return matrix

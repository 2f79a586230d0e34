"""A serial arm as a MuJoCo model, built from its chain of screws, without meshes and files; its position servos."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
from msgspec import Meta
from numpy.typing import ArrayLike, NDArray

from dqcontrol.arrays import Array
from dqcontrol.errors import ValueRangeError, as_each, as_positive
from dqcontrol.plants.plant import Plant
from dqcontrol.plants.servo import servo_plant
from dqcontrol.robots.files.description import drawn_reach, foot_below, joint_range, rod_radii
from dqcontrol.robots.files.mjcf import import_mujoco
from dqcontrol.robots.kinematics.kinematics_kernels import PRISMATIC
from dqcontrol.robots.robot import CommandMode, Robot

_LEAST = 1e-15  # kg, kg m²; MuJoCo refuses moving bodies below it
_ROUNDING = 1e-6  # relative; tensors written with few digits may miss the triangle inequality by it

RODS = 1  # group of the shapes that meshes replace
_SHELL = (0.93, 0.94, 0.95, 1.0)
_HUB = (0.95, 0.45, 0.10, 1.0)
_BASE = (0.25, 0.27, 0.30, 1.0)
_TRIAD = ((0.85, 0.15, 0.15, 1.0), (0.15, 0.65, 0.20, 1.0), (0.15, 0.30, 0.85, 1.0))


def skeleton(robot: Robot) -> Any:
    """Return an ``mjSpec`` with a robot's bodies, joints, end effector and shapes, without its inertias.

    Body ``link_i`` is the frame of joint i after its screw; the joint carries its name in the robot and,
    where both position limits are finite, its range, of one that follows another what that one's leave; the
    site ``hand`` is the tool. Capsules between the joints and a drum on each joint axis are for pictures
    only: they have no mass and touch nothing.

    Parameters
    ----------
    robot
        The arm.

    Raises
    ------
    MissingExtraError
        If mujoco is not installed.

    Examples
    --------
    >>> import dqcontrol as dqc
    >>> from dqcontrol.plants.mujoco.mujoco_model import skeleton
    >>> arm = dqc.SerialArm.from_dh(theta=[0, 0], d=[0, 0], a=[1, 1], alpha=[0, 0])
    >>> [joint.name for joint in skeleton(arm).joints]
    ['joint_1', 'joint_2']
    """
    spec = import_mujoco().MjSpec()
    spec.modelname = robot.name
    add_arm(spec.worldbody, robot)
    spec.compiler.degree = False
    spec.compiler.autolimits = True
    return spec


def add_arm(parent: Any, robot: Robot) -> None:
    """Add the bodies, joints, end effector and shapes of a `skeleton` to a body."""
    mujoco = import_mujoco()
    draw = _Shapes(robot)
    bodies = {-1: parent}
    for i, name in enumerate(robot.row_names):
        row, slides = robot.chain[i], robot.chain[i, 7] == PRISMATIC
        carrier = bodies[int(robot.parents[i])]
        draw.link(carrier, i)
        if slides:
            draw.rail(carrier, i)
        body = carrier.add_body(name=f"link_{i + 1}", pos=row[4:7], quat=row[:4])
        weigh(body, 1.0, np.zeros(3), np.ones(3))
        kind = mujoco.mjtJoint.mjJNT_SLIDE if slides else mujoco.mjtJoint.mjJNT_HINGE
        joint = body.add_joint(name=name, type=kind, axis=[0, 0, 1], ref=-robot.joint_offsets[i])
        ends = joint_range(robot, i)
        if np.isfinite(ends).all():
            joint.range, joint.limited = ends, mujoco.mjtLimited.mjLIMITED_TRUE
        draw.drum(body, i)
        bodies[i] = body
    for k, end in enumerate(robot.ends):
        tool, carrier = robot.chain[end], bodies[int(robot.parents[end])]
        draw.link(carrier, end)
        name = f"hand_{k + 1}" if k else "hand"
        carrier.add_site(name=name, pos=tool[4:7], quat=tool[:4], size=[1e-3] * 3, group=4)
        draw.triad(carrier, tool)


def skeleton_positions(robot: Robot, q: Array) -> Array:
    """Return MuJoCo's coordinates of a `skeleton` at configurations (…, n), with those that follow others."""
    return robot.joint_factors * q[..., robot.row_coordinates]


def add_inertias(spec: Any, robot: Robot) -> None:
    """Give the bodies of a `skeleton` their inertias.

    Raises
    ------
    ValueRangeError
        If the robot has none, or a joint's mass is zero or its tensor is that of no body: it must be
        symmetric, its principal moments positive and none larger than the sum of the others.
    """
    if robot.inertia is None:
        raise ValueRangeError(
            f"inertia: {robot.name} has none, and physics needs a mass and a tensor for every joint"
        )
    for i, name in enumerate(robot.joint_names):
        where = f"inertia: joint {i + 1} '{name}' of {robot.name}"
        mass = robot.inertia.mass[i]
        if mass <= _LEAST:
            raise ValueRangeError(
                f"{where} has mass {mass:g} kg; inertias do not allow physics, a mass must be > 0"
            )
        moments, axes = _principal(where, robot.inertia.tensor[i])
        weigh(spec.body(f"link_{i + 1}"), mass, robot.inertia.center[i], moments, axes)


def add_geom(body: Any, kind: str, size: ArrayLike, **more: Any) -> Any:
    """Add a geom of a kind, as ``"SPHERE"``, that weighs and touches nothing unless told otherwise."""
    free = {"mass": 0.0, "contype": 0, "conaffinity": 0, "size": np.append(size, np.zeros(3))[:3]}
    return body.add_geom(type=getattr(import_mujoco().mjtGeom, f"mjGEOM_{kind}"), **free | more)


def add_motor(spec: Any, name: str, joint: str, **more: Any) -> Any:
    """Add an actuator on a joint, whose control is its force."""
    return spec.add_actuator(name=name, target=joint, trntype=import_mujoco().mjtTrn.mjTRN_JOINT, **more)


def add_servo(spec: Any, joint: str, effort: float = np.inf, **more: Any) -> Any:
    """Add an actuator by a joint's name whose force is linear in control, position and speed, within ± an effort."""
    mujoco = import_mujoco()
    affine = {"gaintype": mujoco.mjtGain.mjGAIN_FIXED, "biastype": mujoco.mjtBias.mjBIAS_AFFINE}
    servo = add_motor(spec, joint, joint, **affine, **more)
    if np.isfinite(effort):
        servo.forcerange, servo.forcelimited = (-effort, effort), mujoco.mjtLimited.mjLIMITED_TRUE
    return servo


def weigh(body: Any, mass: float, center: ArrayLike, moments: ArrayLike, axes: Array | None = None) -> None:
    """Give a body mass, kg, centre, m, and principal moments, kg m², about its own axes or others (columns)."""
    body.mass, body.ipos, body.inertia, body.explicitinertial = mass, center, moments, True
    if axes is not None:
        body.iquat = quaternion_of(axes)


def quaternion_of(rotation: Array) -> Array:
    """Return the unit quaternion of a rotation matrix, as MuJoCo finds it."""
    quaternion = np.empty(4)
    import_mujoco().mju_mat2Quat(quaternion, np.ascontiguousarray(rotation).reshape(9))
    return quaternion


def turned(first: Array, second: Array) -> Array:
    """Return the product of two quaternions, as MuJoCo finds it."""
    product = np.empty(4)
    import_mujoco().mju_mulQuat(product, np.ascontiguousarray(first), second)
    return product


def compiled(spec: Any) -> Any:
    """Return the ``mjModel`` of a spec.

    Raises
    ------
    ValueRangeError
        If MuJoCo refuses it, with its words.
    """
    try:
        return spec.compile()
    except ValueError as error:
        raise ValueRangeError(f"robot: MuJoCo refuses the model of {spec.modelname}: {error}") from None


def _principal(where: str, tensor: Array) -> tuple[Array, Array]:
    """Return principal moments and right-handed axes (columns), or say why no body has this tensor."""
    if np.abs(tensor - tensor.T).max() > _ROUNDING * np.abs(tensor).max():
        raise ValueRangeError(
            f"{where} has tensor {tensor.tolist()}; inertias do not allow physics, it must be symmetric"
        )
    moments, axes = np.linalg.eigh(0.5 * (tensor + tensor.T))
    text = f"principal moments {', '.join(f'{value:.6g}' for value in moments)} kg m²"
    if moments[0] <= _LEAST:
        raise ValueRangeError(f"{where} has {text}; inertias do not allow physics, each must be > 0")
    largest = moments[0] + moments[1]
    if moments[2] > largest * (1 + _ROUNDING):
        raise ValueRangeError(
            f"{where} has {text}; inertias do not allow physics, "
            f"the largest must be ≤ the sum of the others, {largest:.6g}"
        )
    moments[2] = min(moments[2], largest * (1 - 1e-12))
    axes[:, 2] = np.cross(axes[:, 0], axes[:, 1])
    return moments, axes


def _draw(body: Any, kind: str, size: Sequence[float], colour: Any, group: int = RODS, **place: Any) -> None:
    """Add a geom that only shows."""
    add_geom(body, kind, size, rgba=colour, group=group, **place)


class _Shapes:
    """Draws the parts of an arm, thinner towards the end effector."""

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self.radii = rod_radii(robot)

    def link(self, body: Any, i: int) -> None:
        """Draw what leads from joint i − 1 to joint i (or to the end effector)."""
        end, radius, start = self.robot.chain[i, 4:7], 0.85 * self.radii[i], np.zeros(3)
        is_first, is_last = self.robot.parents[i] < 0, i in self.robot.ends
        if is_first and not is_last:
            start = foot_below(self.robot, i)
            _draw(body, "CYLINDER", [1.7 * self.radii[i], 0.1 * self.radii[i]], _BASE, pos=start)
        if np.linalg.norm(end - start) > 0.5 * radius:
            kind = "CYLINDER" if is_last else "CAPSULE"  # its end is the end effector's point
            _draw(body, kind, [radius], _BASE if is_first else _SHELL, fromto=[*start, *end])

    def drum(self, body: Any, i: int) -> None:
        """Draw joint i as a drum about its axis."""
        radius = self.radii[i]
        _draw(body, "CYLINDER", [1.02 * radius, 1.15 * radius], _SHELL)
        for side in (-1, 1):
            _draw(body, "CYLINDER", [0.7 * radius, 0.06 * radius], _HUB, pos=[0, 0, side * 1.2 * radius])

    def rail(self, body: Any, i: int) -> None:
        """Draw the way along which joint i slides."""
        row, (lower, upper) = self.robot.chain[i], joint_range(self.robot, i) + self.robot.joint_offsets[i]
        if np.isfinite(lower) and np.isfinite(upper):
            self.rod(body, row, np.eye(3)[2], (lower, upper), 0.4 * self.radii[i], _BASE)

    def triad(self, body: Any, tool: Array) -> None:
        """Draw the axes of an end effector: x red, y green, z blue."""
        reach = drawn_reach(self.robot)
        for unit, colour in zip(np.eye(3), _TRIAD, strict=True):
            self.rod(body, tool, unit, (0.0, 0.06 * reach), 0.0045 * reach, colour, group=0)

    def rod(
        self,
        body: Any,
        place: Array,
        axis: Array,
        span: Sequence[float],
        radius: float,
        colour: Any,
        **more: Any,
    ) -> None:
        """Draw a rod along an axis of a place, orientation and position (7)."""
        along = np.empty(3)
        import_mujoco().mju_rotVecQuat(along, axis, np.ascontiguousarray(place[:4]))
        ends = [end for way in span for end in place[4:7] + way * along]
        _draw(body, "CAPSULE", [radius], colour, fromto=ends, **more)


class JointServos(Plant, frozen=True, kw_only=True):
    """What `MujocoPlant`, which describes it, and `MobilePlant` share."""

    has_velocity_limits: ClassVar[bool] = True
    command_mode: CommandMode = "integrated"
    bandwidth: Annotated[servo_plant.EachAboveZero, Meta(description="Hz")] = 10.0
    damping_ratio: Annotated[servo_plant.Each, Meta(description="ζ")] = 1.0
    stiffness: Annotated[servo_plant.EachAboveZero | None, Meta(description="k_p, N·m/rad or N/m")] = None
    damping: Annotated[servo_plant.Each | None, Meta(description="k_d, N·m·s/rad or N·s/m")] = None
    timestep: Annotated[float, Meta(gt=0, description="s")] = 1e-3
    gravity: tuple[float, float, float] = (0.0, 0.0, -9.81)
    gravity_compensation: Annotated[float, Meta(ge=0, le=1, description="share of the gravity torque")] = 1.0
    armature: Annotated[servo_plant.Each, Meta(description="kg m² or kg")] = 0.1
    viscous_friction: Annotated[servo_plant.Each, Meta(description="N·m·s/rad or N·s/m")] = 0.0
    dry_friction: Annotated[servo_plant.Each, Meta(description="N·m or N")] = 0.0
    position_limit: bool = True
    encoder_resolution: Annotated[servo_plant.Each, Meta(description="rad or m")] = 0.0
    encoder_noise: Annotated[servo_plant.Each, Meta(description="rad or m")] = 0.0

    @classmethod
    def of_servos(cls, path: Path) -> dict[str, Any]:
        """Return what fits of a plant file of servos.

        Those of second order keep ω and ζ at the inertia of the start; those of first order become critically damped
        ones that are as late for slow motions, ω = 2/τ.
        """
        servo = servo_plant.load_servo(path)
        lags = servo_plant.fitting_lags(servo)
        servo_plant.say_what_is_left_out(path, servo, "physics", ("gain", "delay", "friction", "sag"))
        return {
            "bandwidth": [round(bandwidth / (2 * math.pi), 9) for bandwidth, _ in lags],
            "damping_ratio": [ratio for _, ratio in lags],
            **servo_plant.encoders_and_mode(servo),
        }

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
            servo = add_servo(spec, name, effort, dyntype=mujoco.mjtDyn.mjDYN_INTEGRATOR)
            if self.position_limit and joint.limited == mujoco.mjtLimited.mjLIMITED_TRUE:
                servo.actrange, servo.actlimited = joint.range, mujoco.mjtLimited.mjLIMITED_TRUE
            if np.isfinite(effort):  # also of its sum with the gravity compensation
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


def viscous_damping(model: Any) -> Array:
    """Return the viscous friction of all degrees of freedom, shape (n,), as a view: of new MuJoCo the linear part."""
    return model.dof_damping.reshape(model.nv, -1)[:, 0]

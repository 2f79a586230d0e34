"""A mobile manipulator, with one arm or two, on real wheels, moved by MuJoCo: the plant, and the robot in motion."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from msgspec import Meta
from numpy.typing import ArrayLike, NDArray

from dqcontrol.arrays import Array
from dqcontrol.errors import DivergedError, FallenError, ShapeError, ValueRangeError, as_each
from dqcontrol.plants.mobile import wheeled_base
from dqcontrol.plants.mobile.odometry import SEEN, FusedSight, Sight
from dqcontrol.plants.mobile.standing import check_standing
from dqcontrol.plants.mujoco import mujoco_model
from dqcontrol.plants.mujoco.gripper import GRIPPER_OPENING, Gripper, LiveGripper, add_gripper, fingers
from dqcontrol.plants.mujoco.mujoco_plant import LOST, JointEncoders, check_rate
from dqcontrol.plants.mujoco.world_model import (
    WorldBodies,
    WorldContacts,
    add_links,
    add_world,
    body_channels,
    write_coordinates,
)
from dqcontrol.plants.plant import (
    BASE_POSITION,
    BASE_QUATERNION,
    Channel,
    PhysicsPicture,
    RunningPlant,
    as_command,
    plants_that_drive,
    start_within_limits,
)
from dqcontrol.plants.sensors import AXES, CAMERA_CHANNELS, Camera
from dqcontrol.plants.servo.servo_plant import Each, EachAboveZero
from dqcontrol.robots.bases import DifferentialDrive, RollerBase
from dqcontrol.robots.files.mjcf import import_mujoco
from dqcontrol.robots.robot import Robot
from dqcontrol.robots.serial_arm import SerialArm
from dqcontrol.robots.two_arms import TwoArms
from dqcontrol.robots.whole_body import WholeBody
from dqcontrol.world import Body, World

TOPPLED = math.radians(20)  # a base that tilts by more has fallen over
SLIDING, SLIDES_FOR = 0.3, 1.0  # m/s, s; wheels that slide so fast for so long drive nowhere


class RunningMobile(RunningPlant):
    """A mobile manipulator in motion; made by `MobilePlant.start`.

    Attributes
    ----------
    model, data
        MuJoCo's own model and state, for whoever needs more.
    channels, readings
        What is recorded beside them: angles, torques and slip of the wheels (slip of a drive: speed of each wheel's
        contact along the heading, and of the axle across it; of wheels with rollers: along the axis of the roller),
        tilt and pose of the base, opening of the gripper, what links touch, where
        bodies of the world are that physics moves,
        and with a camera the age of its last frame and the share of the commands that is obeyed.
    """

    model: Any
    data: Any

    def __init__(
        self,
        plant: MobilePlant,
        robot: Robot,
        gear: wheeled_base.RunningGear,
        arm: Robot | None,
        model: Any,
        substeps: int,
        run: tuple[float, int, int],
    ) -> None:
        mujoco = import_mujoco()
        self.model, self.data = model, mujoco.MjData(model)
        self.q: Array = np.zeros(robot.configuration_size)
        self.measured: Array = np.zeros(robot.configuration_size)
        self._plant, self._robot, self._gear, self._arm, self._run = plant, robot, gear, arm, run
        self._substeps, self._advance = substeps, mujoco.mj_step
        joints = robot.joint_names[3:]
        self._joints, self._dofs = coordinates_of(model, joints), dofs_of(model, joints)
        self._wheels, self._wheel_dofs = coordinates_of(model, gear.joints), dofs_of(model, gear.joints)
        self._gripper = LiveGripper(plant.gripper, model, self.data) if plant.gripper is not None else None
        world, (period, _, seed) = plant.world, run
        self._world = WorldContacts(world, robot, model, self.data, period, seed) if world else None
        self._bodies = self._world.bodies if self._world else WorldBodies({}, model, self.data, period, seed)
        self.seen = self._bodies.seen
        self._encoders = JointEncoders(plant, len(joints), seed)
        self._slid = 0.0  # s
        inputs = robot.in_form("constrained").acceleration_limits("plant")
        self._acceleration, self._moving = inputs[: gear.inputs], np.zeros(gear.inputs)
        own = (
            Channel("wheel_angle", gear.wheels, "rad"),
            Channel("wheel_torque", gear.wheels, "N·m"),
            Channel("wheel_slip", gear.slips, "m/s"),
            Channel("tilt", (), "rad"),
            Channel(BASE_POSITION, AXES, "m"),
            Channel(BASE_QUATERNION, ("w", *AXES), ""),
        )
        self._parts = [part for part in (self._gripper, self._world) if part is not None]
        of_parts = [channel for part in self._parts for channel in part.channels]
        of_camera = CAMERA_CHANNELS if plant.location in SEEN else ()
        self.channels: tuple[Channel, ...] = (*own, *of_parts, *of_camera)
        self._tilt = 2 * len(gear.wheels) + len(gear.slips)  # among the readings
        self._slip = slice(2 * len(gear.wheels), self._tilt)
        self._own = np.zeros(sum(channel.size for channel in own))
        self.readings: Array = np.zeros(sum(channel.size for channel in self.channels))

    @property
    def time(self) -> float:
        """Time since the start, s."""
        return self.data.time

    @property
    def odometry(self) -> Array:
        """What the encoders of the wheels say about x, y and φ, shape (3,), m and rad."""
        return self._odometry.pose.copy()

    def place(self, q: Array) -> None:
        """Put the robot somewhere, upright and at rest, with wheels at zero."""
        data = self.data
        data.qvel[:] = 0.0
        data.qpos[:7] = q[0], q[1], 0.0, math.cos(q[2] / 2), 0.0, 0.0, math.sin(q[2] / 2)
        data.qpos[self._wheels] = 0.0
        data.qpos[self._joints] = q[3:]

    def begin(self, start: Array, settling: int) -> None:
        """Let the robot come to rest on its contacts in so many time steps, and start the clock there."""
        period, count, seed = self._run
        mujoco, data, plant = import_mujoco(), self.data, self._plant
        self.place(start)
        mujoco.mj_forward(self.model, data)
        if self._world is not None:
            self._world.check_start()
        if self._arm is not None:
            plant.set_servos(self._arm, self.model, data, start[3:], self._dofs)
        self._command_gripper(0.0)
        self._compensate(start)
        self._advance(self.model, data, settling)
        height, pitch = float(data.qpos[2]), data.qpos[3:7].copy()
        half = (start[2] - wheeled_base.yaw_of(pitch)) / 2
        self.place(start)
        data.qpos[2] = height
        data.qpos[3:7] = mujoco_model.turned(np.array([math.cos(half), 0, 0, math.sin(half)]), pitch)
        data.time = 0.0
        mujoco.mj_forward(self.model, data)
        self.q[:] = start
        camera = plant.camera
        self._odometry = self._gear.odometry(start[:3])
        self._sight: Sight | None = None
        if plant.location == "camera":
            self._sight = Sight(camera, start[:3], period, count, seed)
        elif plant.location == "fused":
            self._sight = FusedSight(camera, start[:3], period, count, seed, self._odometry)
        self._measure()

    def step(self, command: ArrayLike) -> None:
        """Move the robot for one control period; see `RunningPlant.step`.

        Parameters
        ----------
        command
            Inputs v and ω of the base and the joints' velocities, shape (n − 1,), or in the unconstrained form and of
            a base that moves sideways the rates of the configuration, shape (n,); m/s and rad/s.
        """
        u = as_command(command, self._robot.input_size)
        if len(self._robot.drives) and len(u) == len(self.q) and isinstance(self._robot, WholeBody):
            u = self._robot.feasible_inputs(self.measured, u)
        if self._sight is not None and self._sight.is_over:
            raise ValueRangeError("step: the plant was started for fewer periods, and they are over")
        inputs = self._gear.inputs
        self._command_wheels(u[:inputs])
        self._command_gripper(self.data.time)
        self._compensate(self.q)
        joints = len(self._joints)
        rate = self.data.ctrl[:joints]
        rate[:] = u[inputs:]
        if self._plant.command_mode == "measured":  # the rate that ends at measured + T u
            rate += (self.measured[3:] - self.data.act[:joints]) / self._run[0]
        rate *= self._share
        check_rate(self.data.ctrl)
        self._bodies.advance(self._advance, self.model, self._substeps)
        self._locate()
        if not self.q.dot(self.q) < LOST:
            raise DivergedError(
                f"plant: the robot diverged before {self.data.time:g} s, q = {self.q}; try a smaller timestep"
            )
        self._odometry.read(self.data.qpos[self._wheels])
        if self._sight is not None:
            self._sight.look(self.q[:3])
        self._measure()
        self._check_standing()

    def _check_standing(self) -> None:
        """Raise if the robot has fallen over, or slides for long."""
        tilt = self.readings[self._tilt]
        if tilt > TOPPLED:
            raise FallenError(
                f"toppled at {self.data.time:.3g} s: the base tilts by {math.degrees(tilt):.0f}°, more than "
                f"{math.degrees(TOPPLED):.0f}°; drive or move the arm more slowly, or give the base a "
                "heavier, lower or wider chassis"
            )
        slip = np.abs(self.readings[self._slip]).max()
        self._slid = self._slid + self._run[0] if slip > SLIDING else 0.0
        if self._slid > SLIDES_FOR:
            raise FallenError(
                f"slipped at {self.data.time:.3g} s: a wheel has slid over the floor at more than {SLIDING:g} m/s for "
                f"{SLIDES_FOR:g} s (tilt {math.degrees(tilt):.0f}°); it bears too little load or friction for what is "
                "commanded"
            )

    @property
    def _share(self) -> float:
        """Share of the commands that is obeyed: 1, but without frames of the camera."""
        return self._sight.share if self._sight is not None else 1.0

    def _command_wheels(self, wanted: Array) -> None:
        """Set the wheels' speeds, of a base whose speed changes no faster than it may."""
        most = self._run[0] * self._acceleration
        self._moving = np.minimum(np.maximum(wanted, self._moving - most), self._moving + most)
        heading = self.measured[2]
        if self._gear.inputs > 2:  # the middle of the period's
            heading += 0.5 * self._run[0] * self._moving[2]
        wheels = slice(len(self._joints), len(self._joints) + len(self._wheels))
        self.data.ctrl[wheels] = self._gear.wheel_speeds(self._moving, heading, self._share)

    def _command_gripper(self, time: float) -> None:
        if self._gripper is not None:
            self._gripper.drive(time)

    def _compensate(self, q: Array) -> None:
        """Let the servos carry their share of gravity."""
        share = self._plant.gravity_compensation
        if share and self._arm is not None:
            torque = self._arm.gravity_forces(q[3:], self._plant.gravity)
            self.model.actuator_biasprm[: len(self._joints), 0] = share * torque

    def _locate(self) -> None:
        """Read x, y, φ and the joints from MuJoCo's state."""
        q, data = self.q, self.data
        q[:2] = data.qpos[:2]
        q[2] += math.remainder(wheeled_base.yaw_of(data.qpos[3:7]) - q[2], 2 * math.pi)
        q[3:] = data.qpos[self._joints]

    def _measure(self) -> None:
        """Read all sensors."""
        measured, location = self.measured, self._plant.location
        self._encoders.read(self.q[3:], measured[3:])
        if location == "odometry":
            measured[:3] = self._odometry.pose
        else:
            measured[:3] = self._sight.pose if self._sight is not None else self.q[:3]
        data, out = self.data, self._own
        wheels, tilt = len(self._wheels), self._tilt
        out[:wheels] = data.qpos[self._wheels]
        out[wheels : 2 * wheels] = data.qfrc_actuator[self._wheel_dofs]
        out[self._slip] = self._slipping()
        x, y = data.qpos[4:6]
        out[tilt] = math.acos(min(1.0, 1 - 2 * (x * x + y * y)))
        out[tilt + 1 : tilt + 8] = data.qpos[:7]
        for part in self._parts:
            part.read()
        seen = [] if self._sight is None else [self._sight.age, self._sight.share]
        np.concatenate([out, *(part.readings for part in self._parts), seen], out=self.readings)

    def _slipping(self) -> Array:
        """Return how fast the wheels' contacts slide."""
        rates, phi = self.data.qvel, self.q[2]
        (vx, vy), c, s = rates[:2], math.cos(phi), math.sin(phi)
        velocity = np.array([c * vx + s * vy, c * vy - s * vx, rates[5]])
        return self._gear.slip(velocity, rates[self._wheel_dofs])


def coordinates_of(model: Any, joints: Sequence[str]) -> NDArray[np.intp]:
    """Return MuJoCo's indices of the first coordinate of each joint."""
    return np.array([int(model.joint(name).qposadr[0]) for name in joints], dtype=np.intp)


def dofs_of(model: Any, joints: Sequence[str]) -> NDArray[np.intp]:
    """Return MuJoCo's indices of the velocity of each joint."""
    return np.array([int(model.joint(name).dofadr[0]) for name in joints], dtype=np.intp)


def recorded_coordinates(
    robot: Robot,
    wheels: Sequence[str],
    gripper: Gripper | None,
    bodies: Mapping[str, Body],
    model: Any,
    q: Array,
    readings: Mapping[str, Array],
) -> Array:
    """Return MuJoCo's coordinates at each sample, shape (N, nq).

    Parameters
    ----------
    model
        Of `MobilePlant.picture`, compiled.
    robot
        Whom it shows.
    q
        Configurations, shape (N, n), rad or m.
    readings
        By name what the plant sensed, each (N, size).
    wheels
        Names of the wheels' joints.
    gripper, bodies
        The plant's, and what of the world is shown.

    Raises
    ------
    ShapeError
        If the recording is not of this robot and plant.
    """
    needed = ["wheel_angle", *([GRIPPER_OPENING] if gripper else [])]
    needed += [channel.name for channel in body_channels(bodies)]
    missing = [name for name in needed if name not in readings]
    if missing or q.shape[1] != robot.configuration_size:
        raise ShapeError(
            f"record: is not of this robot and plant; missing: {', '.join(missing) or 'coordinates'}"
        )
    out = np.zeros((len(q), model.nq))
    base = coordinates_of(model, ["base"])[0]
    if BASE_POSITION in readings:
        out[:, base : base + 3] = readings[BASE_POSITION]
        out[:, base + 3 : base + 7] = readings[BASE_QUATERNION]
    else:  # of a run without physics
        out[:, base : base + 2] = q[:, :2]
        out[:, base + 3], out[:, base + 6] = np.cos(q[:, 2] / 2), np.sin(q[:, 2] / 2)
    out[:, coordinates_of(model, wheels)] = readings["wheel_angle"]
    out[:, coordinates_of(model, robot.joint_names[3:])] = q[:, 3:]
    if gripper:
        closed = 0.5 * (gripper.opening - readings[GRIPPER_OPENING])
        out[:, coordinates_of(model, fingers())] = closed
    write_coordinates(bodies, model, readings, out)
    return out


_STIFF_FRICTION = 100.0  # stiffness of friction below its limit, against that of contacts
_CONTACT_STEPS = 5  # time constant of contacts, in time steps
_SETTLING = 0.5  # s; until the robot stands still on its contacts


class MobilePlant(mujoco_model.JointServos, frozen=True, kw_only=True, tag="mobile"):
    """A base with one arm or two on a floor: wheels that roll and slip, casters or rollers, a gripper, things to grip.

    The base, a differential drive or one on mecanum or omni wheels, is a free body; its wheels touch the floor with
    friction and are turned by speed controllers, which get ω_r = (v + b ω)/r and ω_l = (v − b ω)/r, or what
    ``RollerBase.wheel_speeds`` says, all scaled down where the rims would be too fast. The arm's joints have
    the position servos of `MujocoPlant`, with the same parameters. In a world chassis, links and fingers touch bodies
    and the floor, and those links each other that the robot's file keeps apart. A base that does not stand under its
    arm in all postures within the joint limits is refused; a run ends as toppled when the base tilts by more than
    ``TOPPLED``, and as slipping when a wheel has slid faster than ``SLIDING`` for ``SLIDES_FOR``.

    Configuration x, y and φ are those of the point of the floor below the middle of the axle, or of all wheels; the
    whole pose of the base is recorded beside it.

    Parameters
    ----------
    location
        What measures x, y and φ: ``"true"``, ``"odometry"`` (the encoders of the wheels, which do not see slip), the
        ``"camera"``, or both, ``"fused"``: odometry from frame to frame, corrected at the time that a frame shows.
    camera
        That camera.
    base
        Friction of wheels and casters, and masses, size and motors of the chassis where they are not those of the
        robot's own.
    link_mass
        Of the arm's links, if it has no inertias: one number, or one a link, kg. They are then solid rods.
    link_radius
        Of those rods, m.
    gravity_compensation
        As of `MujocoPlant`; 0 by default, as in hobby servos.
    armature
        As of `MujocoPlant`.
    gripper
        At the end effector of one arm; none if omitted.
    world
        What chassis, links and fingers touch; the floor is there anyway. A spec gives its own.

    Examples
    --------
    >>> import numpy as np, dqcontrol as dqc
    >>> body = dqc.load_robot("little-john")
    >>> plant = MobilePlant().start(body, np.zeros(8), period=0.02, steps=50, seed=0)
    >>> for _ in range(50):
    ...     plant.step(np.array([0.3, 0, 0, 0, 0, 0, 0]))
    >>> bool(0.25 < plant.q[0] < 0.3)  # it takes a moment until it drives
    True
    """

    location: Literal["true", "odometry", "camera", "fused"] = "true"
    camera: Camera = Camera()
    base: wheeled_base.WheeledBase = wheeled_base.WheeledBase()
    link_mass: Annotated[EachAboveZero, Meta(description="kg")] = 0.15
    link_radius: Annotated[float, Meta(gt=0, le=1, description="m")] = 0.025
    gravity_compensation: Annotated[float, Meta(ge=0, le=1, description="share of the gravity torque")] = 0.0
    armature: Annotated[Each, Meta(description="kg m² or kg")] = 0.02
    gripper: Gripper | None = None
    world: World | None = None
    touches_world: ClassVar[bool] = True

    @property
    def bodies(self) -> dict[str, Body]:
        """What stands on the floor, by name."""
        given = {} if self.world is None else self.world.bodies
        return {name: body for name, body in given.items() if not body.is_floor}

    def body_of(self, robot: Robot) -> Robot:
        """Return the robot with the chassis of this plant."""
        return self.base.body_of(robot)

    def base_errors(self) -> tuple[float, float]:
        """Return the camera's standard deviations, m and rad."""
        camera = self.camera if self.location in SEEN else None
        return (camera.position_noise, camera.angle_noise) if camera else (0.0, 0.0)

    def start(self, robot: Robot, start: Array, period: float, steps: int, seed: int) -> RunningMobile:
        """Return the robot at rest at start, standing on its wheels.

        Parameters
        ----------
        robot
            A whole body: a differential drive or a base on wheels with rollers first, then arms and fixed poses; or two
            arms on one.
        start
            First configuration, shape (n,), rad or m, joints within their limits.
        period
            Control period T, s.
        steps
            Number of periods.
        seed
            Of the noise of encoders and camera.

        Raises
        ------
        MissingExtraError
            If mujoco is not installed.
        Error
            If the robot has another base, one whose body is unknown, or one that falls over under its arm, or something
            does not fit it.
        """
        robot = self.body_of(robot)
        gear, arm = self._parts_of(robot)
        if arm is not None:
            check_standing(robot.name, gear, arm)
        start = start_within_limits(robot, start)
        substeps = self.substeps(period)
        model = self._mobile_model(robot, gear, arm)
        live = RunningMobile(self, robot, gear, arm, model, substeps, (period, steps, seed))
        live.begin(start, round(_SETTLING / self.timestep))
        return live

    def picture(self, robot: Robot) -> PhysicsPicture:
        """Return robot, gripper and what stands around, as they move in physics; see `Plant.picture`."""
        gear, arm = self._parts_of(robot)
        # drawn where it is
        seen = {name: body for name, body in self.bodies.items() if body.role != "moving"}
        places = np.array([[*body.position[:2], 0.0] for body in seen.values()]).reshape(-1, 3)
        coordinates = partial(recorded_coordinates, robot, gear.joints, self.gripper, seen)
        return PhysicsPicture(self._spec(robot, gear, arm, seen), places, coordinates)

    def _parts_of(self, robot: Robot) -> tuple[wheeled_base.RunningGear, Robot | None]:
        """Return what the robot drives on and what that carries, one arm or two on a torso, with inertias."""
        body = robot.base if isinstance(robot, TwoArms) else robot
        parts = body.parts if isinstance(body, WholeBody) else ()
        drive = parts[0] if parts else None
        carried = [part for part in parts[1:] if isinstance(part, SerialArm | np.ndarray)]
        if (
            not isinstance(drive, DifferentialDrive | RollerBase)
            or len(carried) < len(parts) - 1
            or len(robot.bases) > 1
        ):
            found = ", ".join(type(part).__name__ for part in parts if not isinstance(part, np.ndarray))
            raise ValueRangeError(
                f"plant: mobile moves a body that starts with its only base, a DifferentialDrive, MecanumBase or "
                f"OmniBase, got {robot.name}: {found or type(robot).__name__}; {plants_that_drive(robot)}"
            )
        gear = wheeled_base.running_gear(self.base.under(drive, robot.name), drive)
        has_torso = any(isinstance(part, SerialArm) for part in carried)
        torso = [SerialArm.join(carried, robot.name)] if has_torso else []
        if not isinstance(robot, TwoArms):
            return gear, self._with_inertias(torso)[0] if torso else None
        if self.gripper is not None:
            raise ValueRangeError(
                f"plant.gripper: is at the end effector of one arm, and {robot.name} has two"
            )
        if len(robot.drives) and robot.input_size == robot.configuration_size:
            raise ValueRangeError(
                f"plant: mobile drives two arms by v and ω, and {robot.name} is unconstrained; "
                "give its base 'form: constrained'"
            )
        arms = [part for part in (robot.left, robot.right) if isinstance(part, SerialArm)]
        if not torso:
            arms = [SerialArm.join([*carried, arm], arm.name) for arm in arms]
        *base, left, right = self._with_inertias([*torso, *arms])
        return gear, TwoArms(left, right, base=base[0] if base else None, name=robot.name)

    def _with_inertias(self, arms: list[SerialArm]) -> list[SerialArm]:
        """Return arms with inertias, those assumed if one has none."""
        if all(arm.inertia is not None for arm in arms):
            return arms
        ends = np.cumsum([arm.configuration_size for arm in arms])
        masses = np.split(as_each("plant.link_mass", self.link_mass, int(ends[-1])), ends[:-1])
        given = zip(arms, masses, strict=True)
        return [wheeled_base.with_assumed_inertia(arm, mass, self.link_radius) for arm, mass in given]

    def _spec(
        self, robot: Robot, gear: wheeled_base.RunningGear, arm: Robot | None, bodies: dict[str, Body]
    ) -> Any:
        """Return robot, gripper and what stands around without motors."""
        spec = import_mujoco().MjSpec()
        spec.modelname = robot.name
        spec.compiler.degree, spec.compiler.autolimits = False, True
        wheeled_base.add_floor(spec)
        body = gear.add_to(spec, robot.chain[3, 4:7])
        if arm is not None:
            mujoco_model.add_arm(body, arm)
            mujoco_model.add_inertias(spec, arm)
            self.add_servos(spec, arm)
            body = spec.body(f"link_{arm.configuration_size}")
        else:
            body.add_site(name="hand", pos=robot.chain[-1, 4:7], quat=robot.chain[-1, :4], size=[1e-3] * 3)
        mass = gear.mass + (0.0 if arm is None or arm.inertia is None else float(arm.inertia.mass.sum()))
        gear.add_motors(spec, mass)
        if self.gripper is not None:
            add_gripper(spec, self.gripper, body, robot.chain[-1], self.timestep)
        add_world(spec, bodies, self.timestep)
        return spec

    def _mobile_model(self, robot: Robot, gear: wheeled_base.RunningGear, arm: Robot | None) -> Any:
        """Return the model, with contacts that grip: friction is nearly rigid below its limit."""
        mujoco = import_mujoco()
        spec = self._spec(robot, gear, arm, self.bodies)
        if self.world is not None and arm is not None:
            base = robot.configuration_size - arm.configuration_size
            add_links(spec, robot, self.timestep, gripper=self.gripper, base=base)
        option = spec.option
        option.timestep, option.gravity = self.timestep, self.gravity
        option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        option.cone, option.impratio = mujoco.mjtCone.mjCONE_ELLIPTIC, _STIFF_FRICTION
        option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
        model = mujoco_model.compiled(spec)
        model.geom_solref[:] = (_CONTACT_STEPS * self.timestep, 1)
        names = robot.joint_names[3:]
        friction = as_each("plant.viscous_friction", self.viscous_friction, len(names))
        mujoco_model.viscous_damping(model)[dofs_of(model, names)] = friction
        return model

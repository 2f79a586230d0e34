"""A mobile manipulator in motion in MuJoCo: one control period at a time."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dqcontrol.arrays import Array
from dqcontrol.errors import DivergedError, FallenError, ShapeError, ValueRangeError
from dqcontrol.plants.camera import CAMERA_CHANNELS
from dqcontrol.plants.mobile.odometry import SEEN, FusedSight, Sight
from dqcontrol.plants.mobile.wheeled_base import yaw_of
from dqcontrol.plants.mujoco.gripper import GRIPPER_OPENING, Gripper, LiveGripper, fingers
from dqcontrol.plants.mujoco.mujoco_model import import_mujoco
from dqcontrol.plants.mujoco.running_mujoco import LOST, JointEncoders, check_rate
from dqcontrol.plants.mujoco.world_model import WorldBodies, WorldContacts, body_channels, write_coordinates
from dqcontrol.plants.plant import BASE_POSITION, BASE_QUATERNION, Channel, RunningPlant, as_command
from dqcontrol.robots.whole_body import WholeBody
from dqcontrol.world import Body

if TYPE_CHECKING:
    from dqcontrol.plants.mobile.mobile_plant import MobilePlant
    from dqcontrol.plants.mobile.running_gear import RunningGear
    from dqcontrol.robots.robot import Robot


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
    dofs
        MuJoCo's indices of the arm's joint velocities.
    """

    model: Any
    data: Any

    def __init__(
        self,
        plant: MobilePlant,
        robot: Robot,
        gear: RunningGear,
        arm: Robot | None,
        model: Any,
        substeps: int,
        run: tuple[float, int, int],
    ) -> None:
        self.model, self.data = model, import_mujoco().MjData(model)
        self.q: Array = np.zeros(robot.configuration_size)
        self.measured: Array = np.zeros(robot.configuration_size)
        self._plant, self._robot, self._gear, self._arm, self._run = plant, robot, gear, arm, run
        self._substeps, self._advance = substeps, import_mujoco().mj_step
        joints = robot.joint_names[3:]
        self._joints = coordinates_of(model, joints)
        self.dofs: NDArray[np.intp] = dofs_of(model, joints)
        self._wheels, self._wheel_dofs = coordinates_of(model, gear.joints), dofs_of(model, gear.joints)
        self._gripper = LiveGripper(plant.gripper, model, self.data) if plant.gripper is not None else None
        world, period, seed = plant.world, run[0], run[2]
        self._world = WorldContacts(world, robot, model, self.data, period, seed) if world else None
        self._bodies = self._world.bodies if self._world else WorldBodies({}, model, self.data, period, seed)
        self.seen = self._bodies.seen
        self._encoders = JointEncoders(plant, len(joints), run[2])
        self._slid = 0.0  # s
        inputs = robot.in_form("constrained").acceleration_limits("plant")
        self._acceleration, self._moving = inputs[: gear.inputs], np.zeros(gear.inputs)
        self.channels: tuple[Channel, ...] = _channels(
            plant, gear, self._world.channels if self._world else ()
        )
        wheels, slips = len(gear.wheels), len(gear.slips)
        self._tilt = 2 * wheels + slips  # among the readings
        self._slip = slice(2 * wheels, self._tilt)
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

    def check_start(self) -> None:
        """Raise if a link starts in a body of the world, or in another link."""
        if self._world is not None:
            self._world.check_start()

    def settle(self, start: Array, steps: int) -> None:
        """Let the robot come to rest on its contacts, and start the clock there."""
        period, count, seed = self._run
        data = self.data
        self._command_gripper(0.0)
        self._compensate(start)
        self._advance(self.model, data, steps)
        height, pitch = float(data.qpos[2]), data.qpos[3:7].copy()
        turn = start[2] - yaw_of(pitch)
        self.place(start)
        data.qpos[2] = height
        self._turned(pitch, turn, data.qpos[3:7])
        data.time = 0.0
        import_mujoco().mj_forward(self.model, data)
        self.q[:] = start
        camera = self._plant.camera
        self._odometry = self._gear.odometry(start[:3])
        self._sight: Sight | None = None
        if self._plant.location == "camera":
            self._sight = Sight(camera, start[:3], period, count, seed)
        elif self._plant.location == "fused":
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
        first = len(self._joints)
        self.data.ctrl[first : first + len(self._wheels)] = self._gear.wheel_speeds(
            self._moving, heading, self._share
        )

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
        q[2] += math.remainder(yaw_of(data.qpos[3:7]) - q[2], 2 * math.pi)
        q[3:] = data.qpos[self._joints]

    def _measure(self) -> None:
        """Read all sensors."""
        measured, location = self.measured, self._plant.location
        self._encoders.read(self.q[3:], measured[3:])
        if location == "odometry":
            measured[:3] = self._odometry.pose
        else:
            measured[:3] = self._sight.pose if self._sight is not None else self.q[:3]
        data, out = self.data, self.readings
        wheels, tilt = len(self._wheels), self._tilt
        out[:wheels] = data.qpos[self._wheels]
        out[wheels : 2 * wheels] = data.qfrc_actuator[self._wheel_dofs]
        out[self._slip] = self._slipping()
        x, y = data.qpos[4:6]
        out[tilt] = math.acos(min(1.0, 1 - 2 * (x * x + y * y)))
        out[tilt + 1 : tilt + 8] = data.qpos[:7]
        at = tilt + 8
        if self._gripper is not None:
            self._gripper.read(out[at : at + 1])
            at += 1
        if self._world is not None:
            self._world.read()
            size = len(self._world.readings)
            out[at : at + size] = self._world.readings
            at += size
        if self._sight is not None:
            out[at : at + 2] = self._sight.age, self._sight.share

    def _slipping(self) -> Array:
        """Return how fast the wheels' contacts slide."""
        data, phi = self.data, self.q[2]
        c, s = math.cos(phi), math.sin(phi)
        vx, vy, turn = data.qvel[0], data.qvel[1], data.qvel[5]
        return self._gear.slip(
            np.array([c * vx + s * vy, c * vy - s * vx, turn]), data.qvel[self._wheel_dofs]
        )

    @staticmethod
    def _turned(quaternion: Array, angle: float, out: Array) -> None:
        """Write an orientation turned about the vertical."""
        import_mujoco().mju_mulQuat(
            out, np.array([math.cos(angle / 2), 0, 0, math.sin(angle / 2)]), quaternion
        )


def coordinates_of(model: Any, joints: Sequence[str]) -> NDArray[np.intp]:
    """Return MuJoCo's indices of the first coordinate of each joint."""
    return np.array([int(model.joint(name).qposadr[0]) for name in joints], dtype=np.intp)


def dofs_of(model: Any, joints: Sequence[str]) -> NDArray[np.intp]:
    """Return MuJoCo's indices of the velocity of each joint."""
    return np.array([int(model.joint(name).dofadr[0]) for name in joints], dtype=np.intp)


def _channels(plant: MobilePlant, gear: RunningGear, world: tuple[Channel, ...]) -> tuple[Channel, ...]:
    """Return what is read, in the order of `RunningMobile.readings`."""
    return (
        Channel("wheel_angle", gear.wheels, "rad"),
        Channel("wheel_torque", gear.wheels, "N·m"),
        Channel("wheel_slip", gear.slips, "m/s"),
        Channel("tilt", (), "rad"),
        Channel(BASE_POSITION, ("x", "y", "z"), "m"),
        Channel(BASE_QUATERNION, ("w", "x", "y", "z"), ""),
        *([Channel(GRIPPER_OPENING, (), "m")] if plant.gripper is not None else []),
        *world,
        *(CAMERA_CHANNELS if plant.location in SEEN else ()),
    )


def recorded_coordinates(
    model: Any,
    robot: Robot,
    q: Array,
    readings: Mapping[str, Array],
    wheels: Sequence[str],
    gripper: Gripper | None,
    bodies: Mapping[str, Body],
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
    else:  # a recording of an earlier version
        out[:, base : base + 2] = q[:, :2]
        out[:, base + 3], out[:, base + 6] = np.cos(q[:, 2] / 2), np.sin(q[:, 2] / 2)
    out[:, coordinates_of(model, wheels)] = readings["wheel_angle"]
    out[:, coordinates_of(model, robot.joint_names[3:])] = q[:, 3:]
    if gripper:
        closed = 0.5 * (gripper.opening - readings[GRIPPER_OPENING])
        out[:, coordinates_of(model, fingers())] = closed
    write_coordinates(bodies, model, readings, out)
    return out

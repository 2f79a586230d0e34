"""A gripper with two fingers, opened and closed on schedule, or when it is told."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from msgspec import Meta

from dqcontrol import algebra
from dqcontrol.algebra.conversions import matrix_from_pose
from dqcontrol.arrays import Array
from dqcontrol.errors import ValueRangeError
from dqcontrol.geometry import Capsule, Shape
from dqcontrol.named_fields import NamedFields
from dqcontrol.plants.mujoco.mujoco_model import (
    add_geom,
    add_motor,
    quaternion_of,
    turned,
    viscous_damping,
    weigh,
)
from dqcontrol.plants.plant import Channel
from dqcontrol.robots.files.mjcf import import_mujoco
from dqcontrol.robots.kinematics.kinematics_kernels import REVOLUTE
from dqcontrol.robots.poses import positions
from dqcontrol.robots.robot import Robot

GRIPPER_OPENING = "gripper_opening"

_HANDS = ("first", "second", "third", "fourth")
_AXES = dict(zip("xyz", np.eye(3), strict=True))
_METAL = (0.35, 0.37, 0.40, 1.0)
_PAD_COLOUR = (0.95, 0.45, 0.10, 1.0)
BODIES = 2  # bit of MuJoCo's contacts of bodies of the world: what moves the robot has it as affinity alone
_PAST = 0.012  # m; the fingers reach so far beyond the end effector's point


class GripperEvent(NamedFields, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """When the gripper starts to open or to close.

    Parameters
    ----------
    time
        s.
    closed
        True: close.
    """

    spec_key: ClassVar[str] = "plant.gripper.events"
    time: Annotated[float, Meta(ge=0, le=1e6, description="s")]
    closed: bool


class Gripper(NamedFields, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Two fingers that slide towards each other, geared together, open at the start; one at each end effector.

    The end effector's point lies between the finger tips. A motor pushes with a constant force, to close or to open;
    without an object the fingers move at ``speed``. What they grip is held by friction alone.

    Parameters
    ----------
    force
        Of each finger, N.
    speed
        Of each finger, m/s.
    opening
        Largest distance between the fingers, m.
    length
        Of the fingers, m.
    mass
        Of both fingers, kg.
    points, closes
        Axis of the end effector along which the fingers point, and the one along which they close.
    schedule
        When it opens and closes, in order of time.

    Raises
    ------
    ValueRangeError, UnknownNameError
        If a number is not positive, the axes are the same, or the schedule is out of order.
    """

    spec_key: ClassVar[str] = "plant.gripper"
    force: Annotated[float, Meta(gt=0, le=1e4, description="N")] = 4.0
    speed: Annotated[float, Meta(gt=0, le=10, description="m/s")] = 0.05
    opening: Annotated[float, Meta(gt=0, le=1, description="m")] = 0.06
    length: Annotated[float, Meta(gt=0, le=1, description="m")] = 0.07
    mass: Annotated[float, Meta(gt=0, le=100, description="kg")] = 0.04
    points: Literal["x", "y", "z"] = "x"
    closes: Literal["x", "y", "z"] = "z"
    schedule: Annotated[list[GripperEvent], Meta(max_length=10_000)] = []

    def __post_init__(self) -> None:
        if self.points == self.closes:
            raise ValueRangeError(
                f"plant.gripper.closes: must be another axis than 'points', got {self.closes}"
            )
        times = [event.time for event in self.schedule]
        if any(later <= earlier for earlier, later in pairwise(times)):
            raise ValueRangeError(f"plant.gripper.schedule: times must increase, got {times}")

    def behind_fingers(self, shape: Shape, tool: Array) -> Shape:
        """Return a link's capsule up to where the fingers begin, a ball at least; other shapes as they are.

        Parameters
        ----------
        shape
            In the frame of the link that carries the end effector.
        tool
            Orientation and position of the hand in it, shape (7,) or longer, as in a robot's chain.
        """
        if not isinstance(shape, Capsule):
            return shape
        ahead = algebra.matrix_from_pose(algebra.pose(tool[:4], tool[4:7]))[:3, "xyz".index(self.points)]
        palm = float(ahead @ tool[4:7]) + _PAST - self.length - shape.radius
        start, end = float(ahead @ shape.start) - palm, float(ahead @ shape.end) - palm
        if max(start, end) <= 0.0 or start == end:
            return shape
        middle = shape.start + np.clip(start / (start - end), 0.0, 1.0) * (shape.end - shape.start)
        ends = (shape.start, middle) if start < end else (middle, shape.end)
        return Capsule(*ends, shape.radius)

    def is_closed(self, time: float) -> bool:
        """Return whether it closes at a time, s."""
        return next((event.closed for event in reversed(self.schedule) if event.time <= time + 1e-9), False)


def fingers(hand: int = 0) -> tuple[str, str]:
    """Return what both fingers of an end effector are called in MuJoCo: bodies, joints, shapes and motors."""
    return (f"finger_{2 * hand + 1}", f"finger_{2 * hand + 2}")


def add_gripper(spec: Any, gripper: Gripper, link: Any, tool: Any, timestep: float, hand: int = 0) -> None:
    """Add palm, fingers and their motors to the body that carries the end effector.

    Parameters
    ----------
    spec, link
        ``mjSpec`` and the body.
    tool
        Orientation and position of the hand in the body, shape (7,), as in a robot's chain.
    timestep
        s; the gear between the fingers is as stiff as it allows.
    hand
        Number of the end effector.
    """
    mujoco = import_mujoco()
    points, closes = _AXES[gripper.points], _AXES[gripper.closes]
    rotation = np.column_stack([closes, np.cross(points, closes), points])
    quaternion = turned(tool[:4], quaternion_of(rotation))
    half, thick, wide = 0.5 * gripper.opening, 0.006, 0.012
    palm = link.add_body(name=f"palm_{hand + 1}", pos=tool[4:7], quat=quaternion)
    begin = _PAST - gripper.length
    add_geom(palm, "BOX", [half + thick, wide, 0.01], rgba=_METAL, pos=[0, 0, begin])
    for name, side in zip(fingers(hand), (-1, 1), strict=True):
        finger = palm.add_body(name=name, pos=[side * half, 0, 0])
        middle, moment = _PAST - gripper.length / 2, gripper.mass * gripper.length**2 / 24
        weigh(finger, gripper.mass / 2, [0, 0, middle], [moment] * 3)
        joint = finger.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[-side, 0, 0])
        joint.range, joint.limited = [0, half], mujoco.mjtLimited.mjLIMITED_TRUE
        joint.armature = 0.05  # of its motor, seen at the finger
        joint.solref_limit = (4 * timestep, 1)
        bar = add_geom(finger, "BOX", [thick / 2, wide, gripper.length / 2], name=name, rgba=_PAD_COLOUR)
        bar.pos = [side * thick / 2, 0, middle]
        bar.conaffinity, bar.condim, bar.friction = BODIES, 4, [0, 0, 0]
        add_motor(spec, name, name).gainprm[0] = gripper.force
    first, second = fingers(hand)
    gear = spec.add_equality(type=mujoco.mjtEq.mjEQ_JOINT, name1=first, name2=second)
    gear.objtype = mujoco.mjtObj.mjOBJ_JOINT
    gear.data[:5], gear.solref = [0, 1, 0, 0, 0], (4 * timestep, 1)


class LiveGripper:
    """The grippers of a robot at work in MuJoCo: all of them are open, or all of them closed.

    Attributes
    ----------
    channels, readings
        How far the fingers are open, of each end effector.
    told
        Whether they are to close, whatever the schedule says; None: as that says.
    """

    def __init__(self, gripper: Gripper, model: Any, data: Any, hands: int = 1) -> None:
        self.gripper, self._data = gripper, data
        self.told: bool | None = None
        parts = _HANDS[:hands] if hands > 1 else ()
        self.channels: tuple[Channel, ...] = (Channel(GRIPPER_OPENING, parts, "m"),)
        self.readings: Array = np.zeros(hands)
        names = [name for hand in range(hands) for name in fingers(hand)]
        joints = [model.joint(name) for name in names]
        self._at = np.array([joint.qposadr[0] for joint in joints], dtype=np.intp).reshape(-1, 2)
        self._motors = np.array([model.actuator(name).id for name in names], dtype=np.intp)
        # so that they move at their speed
        viscous_damping(model)[[joint.dofadr[0] for joint in joints]] = gripper.force / gripper.speed

    def drive(self, time: float) -> None:
        """Push the fingers as they are told, or as the schedule says at a time, s."""
        closed = self.gripper.is_closed(time) if self.told is None else self.told
        self._data.ctrl[self._motors] = 1.0 if closed else -1.0

    def read(self) -> None:
        """Update how far the fingers of each end effector are apart, m."""
        self.readings[:] = self.gripper.opening - self._data.qpos[self._at].sum(axis=1)


GRIP_FORCE = "grip_force"
PADS = ("pad_1", "pad_2")
_PAD = 0.01, 0.05, 0.05  # half sizes of the end effectors' pads, m
_RUBBER = (0.15, 0.15, 0.17, 1.0)


class Pads(NamedFields, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A square pad of 10 cm on each of two end effectors, facing each other: they carry a body between them.

    What they press is held by friction, of that body.

    Parameters
    ----------
    squeeze
        How much nearer to each other the servos' targets start than the end effectors do, m: their stiffness makes a
        force of it.
    """

    spec_key: ClassVar[str] = "plant.pads"
    squeeze: Annotated[float, Meta(ge=0, description="m")] = 0.006

    def add(self, spec: Any, robot: Robot, start: Array, timestep: float) -> None:
        """Add pads to both end effectors of a robot's model, parallel to each other at a start configuration.

        Raises
        ------
        ValueRangeError
            If the robot has not two end effectors, or they are at one place.
        """
        first, second = (positions(hand) for hand in _hands(robot, start))
        apart = float(np.linalg.norm(first - second))
        if apart < 2 * _PAD[0]:
            raise ValueRangeError(
                f"plant.pads: both end effectors start {apart:.3g} m apart, too near for a body; change 'start'"
            )
        along = (first - second) / apart
        up = np.eye(3)[2] if abs(along[2]) < 0.9 else np.eye(3)[0]
        across = np.cross(up, along)
        across /= np.linalg.norm(across)
        turn = quaternion_of(np.column_stack([along, across, np.cross(along, across)]))
        for k, (row, hand) in enumerate(zip(robot.ends, _hands(robot, start), strict=True)):
            body = spec.body(f"link_{int(robot.parents[row]) + 1}")
            pad = add_geom(body, "BOX", _PAD, rgba=_RUBBER, name=PADS[k], pos=robot.chain[row, 4:7])
            pad.quat = turned(robot.chain[row, :4], turned(hand[:4] * [1, -1, -1, -1], turn))
            pad.conaffinity, pad.condim, pad.friction = BODIES, 4, [0, 0, 0]
            pad.solref[:2] = 4 * timestep, 1.0

    def squeezed(self, robot: Robot, start: Array) -> Array:
        """Return by how much the servos' targets differ at the start: each moves half the squeeze inward."""
        frames, count = robot.frames(start), robot.configuration_size
        first, second = (positions(hand) for hand in _hands(robot, start))
        along = (first - second) / np.linalg.norm(first - second)
        rows = [_hand_jacobian(robot, frames, row, count) for row in robot.ends]
        rates = [np.append(np.zeros(3), 0.5 * side * self.squeeze * along) for side in (-1.0, 1.0)]
        return np.linalg.pinv(np.vstack(rows), rcond=1e-3) @ np.concatenate(rates)


def _hands(robot: Robot, start: Array) -> list[Array]:
    """Return the poses of both end effectors, or say that a robot has not two."""
    if len(robot.ends) != 2:
        raise ValueRangeError(
            f"plant.pads: are on two end effectors, and {robot.name} has {len(robot.ends)}; take them away"
        )
    frames = robot.frames(start)
    return [frames[row] for row in robot.ends]


def _hand_jacobian(robot: Robot, frames: Array, row: int, count: int) -> Array:
    """Return the Jacobian of [ω ; ṗ] of an end effector, from the frames of the joints that carry it."""
    jacobian, end = np.zeros((6, count)), positions(frames[row])
    while (row := int(robot.parents[row])) >= 0:
        axis, origin = matrix_from_pose(frames[row])[:3, 2], positions(frames[row])
        slides, column = robot.chain[row, 7] != REVOLUTE, int(robot.row_coordinates[row])
        turn = np.zeros(3) if slides else axis
        jacobian[:, column] = [*turn, *(axis if slides else np.cross(axis, end - origin))]
    return jacobian

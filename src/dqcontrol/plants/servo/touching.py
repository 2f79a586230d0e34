"""Servos whose end effector touches springy boxes of the world, and a force sensor at the end effector.

The end effector, a point at its frame's origin, is where the servos hold it, however hard it presses: joints that
follow positions give way to nothing. So contact is a spring, exactly as stiff as the body says, along the face that is
pressed in least, with Coulomb's friction along it, which speeds below 1 mm/s build up.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import OK, inline, kernel
from dqcontrol.compiled.memory_layout import MemoryLayout
from dqcontrol.errors import ValueRangeError, error_prefix
from dqcontrol.plants.plant import PLANT, Channel, CompiledPlant
from dqcontrol.plants.sensors import CHANNELS, Three, Wrist
from dqcontrol.plants.servo.servo_step import servo_kernel_inline
from dqcontrol.robots.kinematics.kinematics_kernels import joint_frames
from dqcontrol.robots.robot import Robot
from dqcontrol.world import World

_SLIDING = 1e-3  # m/s from which on friction is whole


class SpringyBox(NamedTuple):
    """A box: its axes as columns, middle, half edges (m), N/m, N·s/m and Coulomb's coefficient."""

    axes: Annotated[Array, 3, 3]
    middle: Annotated[Array, 3]
    half: Annotated[Array, 3]
    stiffness: float
    damping: float
    friction: float


class Touching(NamedTuple):
    """Parameters of the sensor, of what is touched, and then those of the servos.

    Attributes
    ----------
    period, mass, center, gravity, bias
        See `Wrist`; s, kg, m, m/s², N and N·m.
    kept, begin, end
        Of the filter: what is left of its value, and the shares of the wrench at begin and end of a period.
    scale
        Of the noise, (6,).
    chain, boxes, servos
        Of the arm, of the world, of the servos.
    """

    period: float
    mass: float
    center: Annotated[Array, 3]
    gravity: Annotated[Array, 3]
    bias: Annotated[Array, 6]
    kept: float
    begin: float
    end: float
    scale: Annotated[Array, 6]
    chain: Annotated[Array, "joints + 1", 8]
    boxes: Annotated[Array, "boxes", 18]
    servos: Annotated[Array, ...]


class TouchState(NamedTuple):
    """What the sensor shows; force and depth of the contact, base axes; the wrench around its filter; the end effector.

    The first two are the plant's readings.
    """

    wrench: Annotated[Array, 6]
    contact: Annotated[Array, 4]
    true: Annotated[Array, 6]
    filtered: Annotated[Array, 6]
    place: Annotated[Array, 3]
    pose: Annotated[Array, 8]
    servos: Annotated[Array, ...]


_box = MemoryLayout(SpringyBox)
_touching: MemoryLayout[Touching] = MemoryLayout(Touching, "joints", "boxes")
_state: MemoryLayout[TouchState] = MemoryLayout(TouchState)
_CHANNELS = (*CHANNELS, Channel("touch_depth", (), "m"))
_READINGS = sum(channel.size for channel in _CHANNELS)


@inline
def press(box, x, y, z, vx, vy, vz, out):
    """Add the force of a box on a point that moves, base axes, (3,), and keep the largest depth, out[3]."""
    axes, half = box.axes, box.half
    dx, dy, dz = x - box.middle[0], y - box.middle[1], z - box.middle[2]
    depth, face, side = math.inf, 0, 1.0
    for i in range(3):
        along = axes[0, i] * dx + axes[1, i] * dy + axes[2, i] * dz
        inside = half[i] - abs(along)
        if inside < depth:
            depth, face, side = inside, i, 1.0 if along >= 0.0 else -1.0
    if depth <= 0.0:
        return
    nx, ny, nz = side * axes[0, face], side * axes[1, face], side * axes[2, face]
    leaving = nx * vx + ny * vy + nz * vz
    force = max(0.0, box.stiffness * depth - box.damping * leaving)
    tx, ty, tz = vx - leaving * nx, vy - leaving * ny, vz - leaving * nz
    drag = box.friction * force / max(math.sqrt(tx * tx + ty * ty + tz * tz), _SLIDING)
    out[0] += force * nx - drag * tx
    out[1] += force * ny - drag * ty
    out[2] += force * nz - drag * tz
    out[3] = max(out[3], depth)


@inline
def feel(given, boxes, q, own):
    """Write force on the end effector and its depth, and the wrench before the filter."""
    pose = own.pose
    status = joint_frames(given.chain, q, pose)
    w, x, y, z = pose[0], pose[1], pose[2], pose[3]
    px = 2.0 * (w * pose[5] - pose[4] * x - pose[6] * z + pose[7] * y)
    py = 2.0 * (w * pose[6] - pose[4] * y - pose[7] * x + pose[5] * z)
    pz = 2.0 * (w * pose[7] - pose[4] * z - pose[5] * y + pose[6] * x)
    place, contact, true, center = own.place, own.contact, own.true, given.center
    for i in range(4):
        contact[i] = 0.0
    period, mass, gravity = given.period, given.mass, given.gravity
    vx, vy, vz = (px - place[0]) / period, (py - place[1]) / period, (pz - place[2]) / period
    for i in range(boxes):
        press(_box(given.boxes[i]), px, py, pz, vx, vy, vz, contact)
    place[0], place[1], place[2] = px, py, pz
    for i in range(6):
        true[i] = given.bias[i]
    for turn in range(2):
        a, b, c = contact[0], contact[1], contact[2]
        if turn == 1:
            a, b, c = mass * gravity[0], mass * gravity[1], mass * gravity[2]
        tx, ty, tz = 2.0 * (z * b - y * c), 2.0 * (x * c - z * a), 2.0 * (y * a - x * b)
        fx, fy, fz = a + w * tx - y * tz + z * ty, b + w * ty - z * tx + x * tz, c + w * tz - x * ty + y * tx
        true[0] += fx
        true[1] += fy
        true[2] += fz
        if turn == 1:
            true[3] += center[1] * fz - center[2] * fy
            true[4] += center[2] * fx - center[0] * fz
            true[5] += center[0] * fy - center[1] * fx
    return status


@kernel(PLANT)
def touching_servo(command, parameters, noise, state, q, measured):
    """Move the servos, then feel what the end effector touches."""
    n = q.shape[0]
    boxes = int(parameters[0])
    given, own = _touching(parameters[1:], n, boxes), _state(state)
    status = servo_kernel_inline(command, given.servos, noise[0:n], own.servos, q, measured)
    if status != OK:
        return status
    filtered, true, wrench = own.filtered, own.true, own.wrench
    for i in range(6):
        filtered[i] = given.kept * filtered[i] + given.begin * true[i]
    status = feel(given, boxes, q, own)
    for i in range(6):
        filtered[i] += given.end * true[i]
        wrench[i] = filtered[i] + given.scale[i] * noise[n + i]
    return status


def touching(
    servos: CompiledPlant,
    wrist: Wrist,
    world: World | None,
    robot: Robot,
    gravity: Three,
    period: float,
    seed: int,
) -> CompiledPlant:
    """Return servos with a sensor at the end effector, among the springy boxes of a world.

    Raises
    ------
    ValueRangeError
        If the robot is no chain, something springy is no box, or the end effector is in it at the start.
    """
    if robot.table.shape[1] != 8:
        raise ValueRangeError(
            f"plant.wrist: is at the end effector of an arm, and {robot.name} has several branches"
        )
    rows = []
    for name, body in ({} if world is None else world.bodies).items():
        if body.role == "springy":
            with error_prefix(f"world.{name}"):
                if body.box is None or body.parts:
                    raise ValueRangeError(f"servos touch springy boxes alone, and this is a {body.kind}")
                placed = algebra.matrix_from_pose(body.pose)
                numbers = {"stiffness": body.stiffness, "damping": body.damping, "friction": body.friction}
                rows.append(
                    _box.pack(axes=placed[:3, :3], middle=placed[:3, 3], half=0.5 * body.size, **numbers)  # type: ignore[arg-type]
                )
    kept = wrist.kept(period)
    end = 1.0 - wrist.filter / period * (1.0 - kept)
    parameters = _touching.pack(
        period=period,
        mass=wrist.mass,
        center=wrist.center,
        gravity=gravity,
        bias=wrist.bias,
        kept=kept,
        begin=1.0 - kept - end,
        end=end,
        scale=wrist.noise,
        chain=robot.table,
        boxes=np.array(rows).reshape(-1, _box.size()),
        servos=servos.parameters,
    )
    parameters = np.concatenate([[float(len(rows))], parameters])
    state = np.concatenate([np.zeros(_state.size()), servos.state])
    own, q = _state(state), servos.q
    own.place[:] = algebra.translation(robot.fkm(q))
    feel(_touching(parameters[1:], len(q), len(rows)), len(rows), q, own)
    if own.contact[3] > 0:
        raise ValueRangeError(
            f"start: the end effector is {1e3 * own.contact[3]:.3g} mm inside of what it is to touch"
        )
    own.filtered[:] = own.wrench[:] = own.true
    noise = np.random.default_rng([seed, 6]).standard_normal((len(servos.noise), 6))
    found = CompiledPlant(touching_servo, parameters, state, q, np.hstack([servos.noise, noise]))
    found.wrench = _state(found.state).wrench
    found.channels, found.readings = _CHANNELS, found.state[:_READINGS]
    return found

"""Servos on a body with mobile bases: joints lag, bases move as told, a camera tells where they are."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import OK, WRONG_SIZE, inline, kernel
from dqcontrol.compiled.intrinsics import as_matrix
from dqcontrol.errors import ShapeError, as_positive
from dqcontrol.limits.velocity_limit import scale_down, scale_down_rollers, speed_limits
from dqcontrol.plants.camera import CAMERA_CHANNELS, Camera
from dqcontrol.plants.plant import PLANT, Channel, CompiledPlant, begun_periods
from dqcontrol.plants.servo.servo_step import servo_kernel_inline
from dqcontrol.robots.bases import DifferentialDrive, SteeredTricycle
from dqcontrol.robots.kinematics.driving import DRIVE_COLUMNS, ROLLER_COLUMNS, advance, to_inputs
from dqcontrol.robots.limits import Limits
from dqcontrol.robots.robot import Robot, base_coordinates
from dqcontrol.robots.serial_arm import SerialArm

if TYPE_CHECKING:
    from dqcontrol.plants.servo.servo_plant import Servo

# parameters: head; coordinate and input of each joint; coordinates of the bases; limits of the inputs and drives, as
# `speed_limits` has them; by how much each may change in a period; how each drive steers; wheels with rollers;
# then those of the joints' servos
_DT, _COMMANDS, _INPUTS, _JOINTS, _PLACES, _DRIVES = range(6)
_DECAY, _MEAN, _DELAY, _CAMERA_DELAY, _WEIGHT, _OLDEST = range(6, 12)
_ROLLERS = 12
_HEAD = 13


@inline
def push(queue, latest):
    """Put numbers before those of a queue, newest first, and drop as many of its oldest."""
    size = latest.shape[0]
    for i in range(queue.shape[0] - 1, size - 1, -1):
        queue[i] = queue[i - size]
    for i in range(size):
        queue[i] = latest[i]


@inline
def turn_front_wheels(drives, steering, angles, inputs):
    """Turn the front wheel of each drive by no more than its motor can, and let it turn the base as it stands.

    Rows of steering: wheelbase (0: nothing is steered, or at once), largest change of the angle in a period, largest
    angle, whether the front wheel is driven.
    """
    for k in range(drives.shape[0]):
        wheelbase, change, most = steering[4 * k], steering[4 * k + 1], steering[4 * k + 2]
        if wheelbase == 0.0:
            continue
        j = int(drives[k, 0]) - k
        v, across = inputs[j], wheelbase * inputs[j + 1]
        sign = -1.0 if v < 0.0 else 1.0
        if v != 0.0 or across != 0.0:
            wanted = min(max(math.atan2(sign * across, abs(v)), -most), most)
            angles[k] = min(max(wanted, angles[k] - change), angles[k] + change)
        if steering[4 * k + 3] != 0.0:
            rim = sign * math.hypot(v, across)
            inputs[j], inputs[j + 1] = rim * math.cos(angles[k]), rim * math.sin(angles[k]) / wheelbase
        else:
            inputs[j + 1] = v * math.tan(angles[k]) / wheelbase


@kernel(PLANT)
def servo_on_base(command, parameters, noise, state, q, measured):
    """Let joints follow their targets, move the bases, read encoders and camera.

    Noise: that of the encoders, then the share of the commands that is obeyed, whether a frame arrives, its errors.
    """
    if command.shape[0] != int(parameters[_COMMANDS]):
        return WRONG_SIZE
    p, joints = int(parameters[_INPUTS]), int(parameters[_JOINTS])
    places, drive_count = int(parameters[_PLACES]), int(parameters[_DRIVES])
    coordinate = parameters[_HEAD : _HEAD + joints]
    moved_by = parameters[_HEAD + joints : _HEAD + 2 * joints]
    at = _HEAD + 2 * joints
    place = parameters[at : at + places]
    at += places
    limits = speed_limits(parameters[at : at + p + DRIVE_COLUMNS * drive_count], p)
    at += p + DRIVE_COLUMNS * drive_count
    change = parameters[at : at + p]
    at += p
    steering = parameters[at : at + 4 * drive_count]
    at += 4 * drive_count
    rollers = as_matrix(
        parameters[at : at + ROLLER_COLUMNS * int(parameters[_ROLLERS])],
        int(parameters[_ROLLERS]),
        ROLLER_COLUMNS,
    )
    servos = parameters[at + ROLLER_COLUMNS * int(parameters[_ROLLERS]) :]
    drives = limits.drives
    inputs, speed = state[0:p], state[p : 2 * p]
    joint = state[2 * p : 2 * p + 3 * joints]
    joint_command, joint_q, joint_measured = joint[0:joints], joint[joints : 2 * joints], joint[2 * joints :]
    at = 2 * p + 3 * joints
    seen = state[at : at + places]
    now = state[at + places : at + 2 * places]
    at += 2 * places
    commands = state[at : at + p * (int(parameters[_DELAY]) + 1)]
    at += commands.shape[0]
    frames = state[at : at + places * (int(parameters[_CAMERA_DELAY]) + 1)]
    at += frames.shape[0]
    angles, servo_state = state[at : at + drive_count], state[at + drive_count :]

    if command.shape[0] == p:
        for i in range(p):
            inputs[i] = command[i]
    else:
        to_inputs(drives, measured, command, inputs)
    for i in range(joints):
        joint_command[i] = noise[joints] * inputs[int(moved_by[i])]
        inputs[int(moved_by[i])] = 0.0
        joint_q[i], joint_measured[i] = q[int(coordinate[i])], measured[int(coordinate[i])]
    status = servo_kernel_inline(joint_command, servos, noise, servo_state, joint_q, joint_measured)
    if status != OK:
        return status

    push(commands, inputs)
    for i in range(p):
        inputs[i] = commands[commands.shape[0] - p + i]
        if parameters[_OLDEST] < 1.0:  # the delay ends within the period
            newer = commands[commands.shape[0] - 2 * p + i]
            inputs[i] = parameters[_OLDEST] * inputs[i] + (1.0 - parameters[_OLDEST]) * newer
    scale_down_rollers(q, rollers, inputs)
    scale_down(q, limits, inputs)
    for i in range(p):
        inputs[i] *= noise[joints]
        inputs[i] = min(max(inputs[i], speed[i] - change[i]), speed[i] + change[i])
        behind = speed[i] - inputs[i]
        speed[i] = inputs[i] + behind * parameters[_DECAY]
        inputs[i] += behind * parameters[_MEAN]
    turn_front_wheels(drives, steering, angles, inputs)
    advance(drives, inputs, parameters[_DT], q)
    for i in range(joints):
        q[int(coordinate[i])], measured[int(coordinate[i])] = joint_q[i], joint_measured[i]

    for i in range(places):
        now[i] = q[int(place[i])]
    push(frames, now)
    shown = frames[frames.shape[0] - places :]
    for i in range(places):
        if noise[joints + 1] != 0.0:
            seen[i] += parameters[_WEIGHT] * (shown[i] + noise[joints + 2 + i] - seen[i])
        measured[int(place[i])] = seen[i]
    return OK


def start_on_base(
    plant: Servo, body: Robot, start: Array, period: float, steps: int, seed: int
) -> CompiledPlant:
    """Return the plant of a body with mobile bases at rest at start.

    Raises
    ------
    Error
        If a parameter is out of range, or there is sag.
    """
    if not isinstance(plant.delay, int | float):
        raise ShapeError(f"plant.delay: expected one number with mobile bases, got {plant.delay}")
    driven = body.in_form("constrained")
    is_base, p = base_coordinates(body), driven.input_size
    moved_by, place = np.flatnonzero(~is_base[driven.input_coordinates]), np.flatnonzero(is_base)
    coordinate = driven.input_coordinates[moved_by]
    arm = _joints(driven, coordinate, moved_by)
    alone = replace(plant, base_time_constant=0.0, camera=None)
    servos = alone.start(arm, start[coordinate], period, steps, seed)
    velocity = driven.limits.velocity if plant.rate_limit else np.full(p, np.inf)
    tau = as_positive("plant.base_time_constant", plant.base_time_constant, zero_allowed=True)
    delay, oldest = begun_periods("plant.delay", plant.delay, period)
    noise, late, weight, foreseen = _sight(plant.camera, period, steps, len(place), seed)

    head = np.zeros(_HEAD)
    head[: _DRIVES + 1] = period, body.input_size, p, len(coordinate), len(place), len(body.drives)
    head[_DECAY] = math.exp(-period / tau) if tau else 0.0
    head[_MEAN] = -math.expm1(-period / tau) * tau / period if tau else 0.0
    head[_DELAY], head[_CAMERA_DELAY], head[_WEIGHT], head[_OLDEST] = delay, late, weight, oldest
    rollers = driven.rollers if plant.rate_limit else driven.rollers[:0]
    head[_ROLLERS] = len(rollers)
    indices = np.concatenate([coordinate, moved_by, place]).astype(np.float64)
    change = period * driven.acceleration_limits("plant")
    steering = _steering(body, period)
    parameters = np.concatenate(
        [head, indices, velocity, body.drives.ravel(), change, steering, rollers.ravel(), servos.parameters]
    )
    scratch, queue = np.zeros(2 * p + 3 * len(coordinate) + len(place)), np.zeros(p * (delay + 1))
    frames = np.tile(start[place], late + 1)
    state = np.concatenate([scratch, start[place], queue, frames, np.zeros(len(body.drives)), servos.state])
    return CompiledPlant(servo_on_base, parameters, state, start, np.hstack([servos.noise, noise]), foreseen)


def _steering(body: Robot, period: float) -> Array:
    """Return how each drive steers, 4 numbers a drive: see `turn_front_wheels`."""
    rows = np.zeros((len(body.drives), 4))
    for row, part in zip(rows, body.driven_bases, strict=True):
        if not isinstance(part, DifferentialDrive) and part.steering_rate < math.inf:
            driven = isinstance(part, SteeredTricycle)
            row[:] = part.wheelbase, part.steering_rate * period, part.steering_limit, driven
    return rows.ravel()


def _joints(body: Robot, coordinate: NDArray[np.intp], moved_by: NDArray[np.intp]) -> SerialArm:
    """Return the joints of a body as an arm of their own, for their servos; without inertia its shape is the same."""
    n, limits = len(coordinate), body.limits
    frames = np.tile([1.0, 0, 0, 0, 0, 0, 0], (n + 1, 1))
    types = [body.joint_types[i] for i in coordinate]
    kept = Limits(
        limits.lower[coordinate], limits.upper[coordinate], limits.velocity[moved_by], limits.effort[moved_by]
    )
    return SerialArm(frames, types, limits=kept, name=body.name)


def _sight(
    camera: Camera | None, period: float, steps: int, places: int, seed: int
) -> tuple[Array, int, float, list[tuple[Channel, Array]]]:
    """Return the camera's noise (steps, 2 + places), its delay in periods, the weight of a frame, and its signals."""
    noise = np.zeros((steps, 2 + places))
    noise[:, :2] = 1.0
    if camera is None:
        return noise, 0, 1.0, []
    found = camera.schedule(period, steps, places // 3, seed)
    noise[:, 0], noise[:, 1], noise[:, 2:] = found.share, found.arrives[1:], found.errors[1:]
    values = found.age[:, None], found.share[:, None]
    return noise, found.delay, found.weight, list(zip(CAMERA_CHANNELS, values, strict=True))

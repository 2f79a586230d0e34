"""What a recording's topics hold, and the messages of each sample."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dqcontrol.arrays import Array
from dqcontrol.loop.record import Record
from dqcontrol.recording.cdr import Alike, cdr
from dqcontrol.references.sample import TWIST, TWIST_RATE

STATES, MEASURED, COMMAND, DISTURBANCE, SAMPLE = (
    "/joint_states",
    "/measured_joint_states",
    "/joint_command",
    "/disturbance",
    "/dqcontrol/sample",
)

READINGS = "/readings/"
NUMBERS = "std_msgs/Float64MultiArray"

TOPICS = {
    STATES: "sensor_msgs/JointState",
    MEASURED: "sensor_msgs/JointState",
    COMMAND: "sensor_msgs/JointState",
    "/hand/pose": "geometry_msgs/PoseStamped",
    "/hand/desired": "geometry_msgs/PoseStamped",
    "/hand/desired_twist": "geometry_msgs/TwistStamped",
    "/hand/desired_acceleration": "geometry_msgs/AccelStamped",
    DISTURBANCE: "geometry_msgs/TwistStamped",
    "/error": "std_msgs/Float64",
    SAMPLE: NUMBERS,
}

_FRAME = "world"


def messages_of(record: Record, stamps: NDArray[np.int64]) -> dict[str, Alike]:
    """Return the messages of all samples by topic.

    Parameters
    ----------
    record
        What they say.
    stamps
        Times of the messages, ns, shape (N,), not negative.
    """
    header = np.stack(np.divmod(stamps, 10**9), axis=1).astype(np.uint32), _FRAME
    with np.errstate(invalid="ignore", over="ignore"):  # a diverged run
        speed = np.zeros_like(record.q)
        speed[:-1] = np.diff(record.q, axis=0) / np.diff(record.time)[:, None]
        linear, acceleration = _hand_motion(record)
    joints = *header, record.joint_names
    messages = {
        STATES: cdr(*joints, *_sequence(record.q), *_sequence(speed), 0),
        MEASURED: cdr(*joints, *_sequence(record.measured), 0, 0),
        COMMAND: cdr(*header, record.input_names, 0, *_sequence(record.command), 0),
        "/hand/pose": cdr(*header, record.position, *_quaternion(record.pose)),
        "/hand/desired": cdr(*header, record.desired_position, *_quaternion(record.desired)),
        "/hand/desired_twist": cdr(*header, linear, record.desired[:, TWIST][:, :3]),
        "/hand/desired_acceleration": cdr(*header, acceleration, record.desired[:, TWIST_RATE][:, :3]),
        "/error": cdr(record.error[:, None]),
        SAMPLE: _numbers("time, pose, desired", record.time[:, None], record.pose, record.desired),
    }
    if record.disturbance is not None:
        messages[DISTURBANCE] = cdr(*header, record.disturbance[:, 3:], record.disturbance[:, :3])
    for signal in record.readings.values():
        messages[READINGS + signal.name] = _numbers(", ".join(signal.headings()), signal.values)
    return messages


def _sequence(*values: Array) -> tuple[int | Array, ...]:
    return sum(each.shape[1] for each in values), *values


def _quaternion(pose: Array) -> tuple[Array, Array]:
    """Return a pose's x, y, z and w, as geometry_msgs/Quaternion has them."""
    return pose[:, 1:4], pose[:, :1]


def _numbers(label: str, *values: Array) -> Alike:
    """Return messages of the type ``NUMBERS``: their one dimension with label, size and stride, no offset, the data."""
    size, *_ = _sequence(*values)
    return cdr(1, label, size, size, 0, *_sequence(*values))


def _hand_motion(record: Record) -> tuple[Array, Array]:
    """Return ṗ_d = v − p × ω and p̈_d = v̇ − ṗ × ω − p × ω̇ of the reference."""
    twist, rate, p = record.desired[:, TWIST], record.desired[:, TWIST_RATE], record.desired_position
    velocity = twist[:, 3:] - np.cross(p, twist[:, :3])
    return velocity, rate[:, 3:] - np.cross(velocity, twist[:, :3]) - np.cross(p, rate[:, :3])

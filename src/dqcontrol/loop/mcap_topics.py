"""What a recording's topics hold, and the messages of each sample."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dqcontrol.loop.record import Record
from dqcontrol.loop.signals import Signal
from dqcontrol.references.sample import TWIST, TWIST_RATE

Array = NDArray[np.float64]

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


def columns_of(record: Record) -> dict[str, Callable[[int], dict[str, Any]]]:
    """Return for each topic the function that makes the message of one sample."""
    q, measured, command = record.q.tolist(), record.measured.tolist(), record.command.tolist()
    joints, inputs = list(record.joint_names), list(record.input_names)
    with np.errstate(invalid="ignore", over="ignore"):  # a diverged run
        speed = np.zeros_like(record.q)
        speed[:-1] = np.diff(record.q, axis=0) / np.diff(record.time)[:, None]
        linear, acceleration = _hand_motion(record)
    speeds, sample = speed.tolist(), np.column_stack([record.time, record.pose, record.desired]).tolist()
    layout = {"dim": [{"label": "time, pose, desired", "size": len(sample[0]), "stride": len(sample[0])}]}
    twist = _vectors(linear, record.desired[:, TWIST][:, :3])
    accel = _vectors(acceleration, record.desired[:, TWIST_RATE][:, :3])
    pose, desired = _poses(record.position, record.pose), _poses(record.desired_position, record.desired_pose)
    error = record.error.tolist()
    columns: dict[str, Callable[[int], dict[str, Any]]] = {
        STATES: lambda k: {"name": joints, "position": q[k], "velocity": speeds[k]},
        MEASURED: lambda k: {"name": joints, "position": measured[k]},
        COMMAND: lambda k: {"name": inputs, "velocity": command[k]},
        "/hand/pose": lambda k: {"pose": pose[k]},
        "/hand/desired": lambda k: {"pose": desired[k]},
        "/hand/desired_twist": lambda k: {"twist": twist[k]},
        "/hand/desired_acceleration": lambda k: {"accel": accel[k]},
        "/error": lambda k: {"data": error[k]},
        SAMPLE: lambda k: {"layout": layout, "data": sample[k]},
    }
    if record.disturbance is not None:
        pushes = _vectors(record.disturbance[:, 3:], record.disturbance[:, :3])
        columns[DISTURBANCE] = lambda k: {"twist": pushes[k]}
    for signal in record.readings.values():
        columns[READINGS + signal.name] = _numbers(signal)
    return columns


def _numbers(signal: Signal) -> Callable[[int], dict[str, Any]]:
    values, size = signal.values.tolist(), len(signal.units)
    layout = {"dim": [{"label": ", ".join(signal.headings()), "size": size, "stride": size}]}
    return lambda k: {"layout": layout, "data": values[k]}


def _hand_motion(record: Record) -> tuple[Array, Array]:
    """Return ṗ_d = v − p × ω and p̈_d = v̇ − ṗ × ω − p × ω̇ of the reference."""
    twist, rate, p = record.desired[:, TWIST], record.desired[:, TWIST_RATE], record.desired_position
    velocity = twist[:, 3:] - np.cross(p, twist[:, :3])
    return velocity, rate[:, 3:] - np.cross(velocity, twist[:, :3]) - np.cross(p, rate[:, :3])


def _vectors(linear: Array, angular: Array) -> list[dict[str, Any]]:
    return [
        {"linear": _xyz(a), "angular": _xyz(b)}
        for a, b in zip(linear.tolist(), angular.tolist(), strict=True)
    ]


def _poses(position: Array, pose: Array) -> list[dict[str, Any]]:
    return [
        {"position": _xyz(p), "orientation": {"w": r[0], "x": r[1], "y": r[2], "z": r[3]}}
        for p, r in zip(position.tolist(), pose.tolist(), strict=True)
    ]


def _xyz(v: list[float]) -> dict[str, float]:
    return {"x": v[0], "y": v[1], "z": v[2]}

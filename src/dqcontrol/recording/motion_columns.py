"""A motion as columns of a LeRobot dataset."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.files.lerobot_dataset import ACTION, COMMAND, POSE, REFERENCE, STATE, Feature
from dqcontrol.loop.record import Record
from dqcontrol.loop.signals import Signal
from dqcontrol.recording.export import DUAL_QUATERNION
from dqcontrol.robots.robot import Robot

_POSE_FEATURE = Feature(DUAL_QUATERNION, ("",) * 4 + ("m",) * 4)
_TAKEN_EARLY = (
    1e-6  # s: stamps of a recording are whole nanoseconds, and floats of a million seconds 1e-10 apart
)


def record_columns(robot: Robot, record: Record) -> dict[str, tuple[Feature, Array]]:
    """Return the columns of a run; see `motion_columns`."""
    return motion_columns(
        robot,
        record.time,
        record.measured,
        record.command,
        None,
        record.desired_pose,
        record.readings.values(),
    )


def motion_columns(
    robot: Robot,
    time: Array,
    measured: Array,
    command: Array | None,
    target: Array | None = None,
    desired: Array | None = None,
    readings: Iterable[Signal] = (),
) -> dict[str, tuple[Feature, Array]]:
    """Return the columns of a motion of N samples, by their names in a dataset.

    ``observation.state`` are measured positions, ``observation.pose`` the end effector's pose there (unit dual
    quaternion), ``observation.NAME`` what else was sensed (a wrench), ``action`` the commanded positions: ``target``,
    or the first measured position and what the commanded velocities add up to, q₀ + Σ T u; of robots whose inputs are
    no rates of their coordinates, the inputs. ``command`` are the commanded velocities, ``reference.pose`` the desired
    pose.

    Parameters
    ----------
    robot
        Names and units are its.
    time
        (N,), s.
    measured, target
        (N, n), rad or m.
    command
        (N, m), rad/s or m/s.
    desired
        (N, 8).
    readings
        What else was sensed, N samples.
    """
    units = tuple("rad" if kind == "revolute" else "m" for kind in robot.joint_types)
    rates = tuple("rad/s" if kind == "revolute" else "m/s" for kind in robot.input_types)
    positions = Feature(tuple(f"{name}.pos" for name in robot.joint_names), units)
    speeds = Feature(tuple(f"{name}.vel" for name in robot.input_names), rates)
    columns = {STATE: (positions, measured), POSE: (_POSE_FEATURE, robot.fkm(measured))}
    for signal in readings:
        names = tuple(signal.parts or (signal.name,))
        columns[f"observation.{signal.name}"] = Feature(names, tuple(signal.units)), signal.values
    if target is None and command is not None and tuple(robot.input_names) == tuple(robot.joint_names):
        steps = np.diff(time, append=2 * time[-1] - time[-2])[:, None]
        target = measured[0] + np.cumsum(steps * command, axis=0)
    if target is not None:
        columns[ACTION] = positions, target
        if command is not None:
            columns[COMMAND] = speeds, command
    elif command is not None:
        columns[ACTION] = speeds, command
    if desired is not None:
        columns[REFERENCE] = _POSE_FEATURE, desired
    return columns


def at_rate(time: Array, columns: Mapping[str, tuple[Feature, Array]], fps: int) -> dict[str, Array]:
    """Return the values of columns at a number of frames a second: at each the latest sample, as a recorder sees it."""
    count = int(np.floor((time[-1] - time[0]) * fps + _TAKEN_EARLY)) + 1
    rows = np.searchsorted(time - time[0], np.arange(count) / fps + _TAKEN_EARLY, side="right") - 1
    return {name: values[rows] for name, (_, values) in columns.items()}

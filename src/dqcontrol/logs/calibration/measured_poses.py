"""Poses of an end effector as a camera or tracker measured them, with the joint angles at which it did."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dqcontrol.algebra import matrix_from_rotation, rotation, rotation_from_matrix, translation
from dqcontrol.algebra.functions import WRITTEN_TOLERANCE
from dqcontrol.arrays import Array
from dqcontrol.errors import FileFormatError, ShapeError, ValueRangeError
from dqcontrol.files.input_file import as_number, read_text
from dqcontrol.logs.joint_log import names_in_log, refuse_topics
from dqcontrol.logs.joint_messages import is_recording, read_joint_states, read_poses
from dqcontrol.logs.joint_table import DEGREES_NOTE, Angles, must_be_degrees
from dqcontrol.logs.text_table import ANGLES, LENGTHS, find_columns, name_and_unit, table_rows, unit_scale
from dqcontrol.references.points import POSITION, QUATERNION
from dqcontrol.robots import Robot, SerialArm
from dqcontrol.robots.poses import positions, shift

_FARTHEST = 20.0  # m; no tracker sees an arm so far away, so such numbers without a unit are mm
_GAP = 0.1  # s without joint states beside a pose, at most
_MOST = 2000  # poses of a recording that are used


@dataclass(frozen=True, eq=False)
class MeasuredPoses:
    """N measured poses of what is fixed to the end effector of a robot with n joints.

    Attributes
    ----------
    path
        The file.
    q
        Measured joint positions, shape (N, n), rad or m.
    position
        Of the target in the frame of camera or tracker, shape (N, 3), m.
    rotation
        Of the target, unit quaternions, shape (N, 4); None if positions alone were measured.
    notes
        What was recognised, a line each.
    """

    path: Path
    q: Array
    position: Array
    rotation: Array | None
    notes: tuple[str, ...] = ()

    def chosen(self, rows: NDArray[np.bool_]) -> MeasuredPoses:
        """Return it with those poses only for which ``rows`` (N,) is True."""
        turned = self.rotation[rows] if self.rotation is not None else None
        return MeasuredPoses(self.path, self.q[rows], self.position[rows], turned, self.notes)


def read_measured_poses(
    path: str | Path,
    robot: Robot,
    *,
    joints: Sequence[str] | None = None,
    angles: Angles | None = None,
    joint_topic: str | None = None,
    pose_topic: str | None = None,
) -> MeasuredPoses:
    r"""Read joint positions and measured poses of the end effector: a table, an MCAP file, a ROS 1 or ROS 2 bag.

    A table is a text file with a line of column names and one line a pose. Its columns, in any order: one for each
    joint, by the robot's joint names or ``q1`` … ``qn``; ``x``, ``y``, ``z``; and, if orientations were measured, the
    unit quaternion ``qw``, ``qx``, ``qy``, ``qz``. Units may stand behind names, as ``q1 [deg]`` or ``x [mm]``; without
    one, rad and m, unless that cannot be, which is said. Other columns are left out.

    In recordings, poses come from a topic of type geometry_msgs/PoseStamped, joint positions from one of type
    sensor_msgs/JointState, joined linearly at the times of the poses.

    Parameters
    ----------
    path
        The file.
    robot
        Whose joints to look for.
    joints
        Their names in the file, if it has others, in the robot's order.
    angles
        Unit of the joints' columns that do not name theirs: ``"rad"`` (default) or ``"deg"``.
    joint_topic, pose_topic
        Of a recording; by default ``/joint_states`` or the only ones of their types.

    Raises
    ------
    ShapeError
        If ``joints`` does not fit the robot, or an option does not apply to this kind of file.
    FileFormatError
        If the file is missing or malformed; the message begins with the file and its line.
    ValueRangeError
        If numbers without a unit must be degrees.

    Examples
    --------
    >>> import tempfile, pathlib, dqcontrol as dqc
    >>> file = pathlib.Path(tempfile.mkdtemp()) / "poses.csv"
    >>> _ = file.write_text("q1 [deg],q2 [deg],x [mm],y [mm],z [mm]\n0,0,2000,0,0\n90,0,0,2000,0\n")
    >>> arm = dqc.SerialArm.from_dh([0, 0], [0, 0], [1, 1], [0, 0])
    >>> read_measured_poses(file, arm).position.tolist()
    [[2.0, 0.0, 0.0], [0.0, 2.0, 0.0]]
    """
    path, names = Path(path), names_in_log(robot, joints)
    if not is_recording(path):
        refuse_topics(path, "table", joint_topic=joint_topic, pose_topic=pose_topic)
        return _read_table(path, robot, names, angles)
    if angles is not None:
        raise ShapeError(f"angles: {path} is a recording, and its messages are in rad; leave it out")
    return _read_recording(path, names, joint_topic, pose_topic)


def _read_table(path: Path, robot: Robot, names: Sequence[str], angles: Angles | None) -> MeasuredPoses:
    (line, header), *rows = table_rows(path, read_text(path).splitlines())
    where, n = f"{path}:{line}", len(names)
    known = {*names, *(f"q{i + 1}" for i in range(n)), *POSITION, *QUATERNION}
    cells = [name_and_unit(cell, known) for cell in header]
    columns, units = [cell[0] for cell in cells], [cell[1] for cell in cells]
    places = find_columns(where, "joints", columns, names, "q")
    places += find_columns(where, "measured positions", columns, POSITION, "")
    turned = any(name in columns for name in QUATERNION)
    if turned:
        places += find_columns(where, "measured quaternion", columns, QUATERNION, "")
    if not rows:
        raise FileFormatError(f"{path}: has no poses below the column names")
    values = np.empty((len(rows), len(places)))
    for k, (number, row) in enumerate(rows):
        if len(row) != len(columns):
            raise FileFormatError(f"{path}:{number}: expected {len(columns)} values, got {len(row)}")
        values[k] = [as_number(f"{path}:{number}: {columns[i]}", row[i]) for i in places]
    notes = []
    if angles is None and must_be_degrees(path, robot, [units[i] for i in places[:n]], values):
        angles = "deg"
        notes.append(DEGREES_NOTE)
    far = np.abs(values[:, n : n + 3]).max() > _FARTHEST
    length = "mm" if far and not any(units[i] for i in places[n : n + 3]) else "m"
    if length == "mm":
        notes.append("x, y and z without a unit are taken for mm: as metres they are too far away")
    for column, i in enumerate(places[: n + 3]):
        turns = column < n and robot.joint_types[column] == "revolute"
        allowed, default = (ANGLES, angles or "rad") if turns else (LENGTHS, length if column >= n else "m")
        values[:, column] *= unit_scale(f"{where}: {columns[i]}", units[i], allowed, default)
    quaternions = None
    if turned:
        quaternions = values[:, n + 3 :]
        norms = np.linalg.norm(quaternions, axis=1)
        for k in np.flatnonzero(np.abs(norms - 1) > WRITTEN_TOLERANCE)[:1]:
            raise FileFormatError(f"{path}:{rows[k][0]}: qw … qz: must have norm 1, got {norms[k]:.9g}")
        quaternions = quaternions / norms[:, None]
    return MeasuredPoses(path, values[:, :n], values[:, n : n + 3], quaternions, tuple(notes))


def _read_recording(
    path: Path, names: Sequence[str], joint_topic: str | None, pose_topic: str | None
) -> MeasuredPoses:
    joint_stamps, q = read_joint_states(path, names, joint_topic)
    stamps, poses = read_poses(path, pose_topic, field="pose_topic")
    after = np.searchsorted(joint_stamps, stamps)
    beside = np.clip(after, 1, len(joint_stamps) - 1)
    known = (after > 0) & (after < len(joint_stamps))
    known &= joint_stamps[beside] - joint_stamps[beside - 1] < _GAP * 1e9
    if not known.any():
        raise ValueRangeError(f"{path}: no pose was measured while joint states came")
    chosen = np.flatnonzero(known)
    notes = []
    if len(chosen) < len(stamps):
        notes.append(f"{len(stamps) - len(chosen)} of {len(stamps)} poses have no joint states beside them")
    chosen = chosen[:: max(1, -(-len(chosen) // _MOST))]
    seconds, times = (joint_stamps - joint_stamps[0]) / 1e9, (stamps[chosen] - joint_stamps[0]) / 1e9
    joined = np.column_stack([np.interp(times, seconds, each) for each in q.T])
    return MeasuredPoses(path, joined, translation(poses[chosen]), rotation(poses[chosen]), tuple(notes))


def searched_frames(arm: SerialArm, measured: MeasuredPoses) -> tuple[Array, Array]:
    """Return the poses (7,) of the arm's base in the measuring frame and of the target in the hand, M = Y F X.

    With orientations the rotations come from the singular vectors of Σ R_F ⊗ R_M and the positions from a linear system
    (Shah 2013); with positions alone the target is taken to be at the end effector, and the base from an orthogonal
    fit.
    """
    hand = arm.fkm(measured.q)
    turned, points = matrix_from_rotation(hand[:, :4]), positions(hand)
    if measured.rotation is None:
        middle, seen = points.mean(axis=0), measured.position.mean(axis=0)
        turn = _nearest_rotation((measured.position - seen).T @ (points - middle))
        return _pose(turn, seen - turn @ middle), shift()
    seen = matrix_from_rotation(measured.rotation)
    product = sum(np.kron(of_hand, of_seen) for of_hand, of_seen in zip(turned, seen, strict=True))
    left, _, right = np.linalg.svd(product)
    base = _nearest_rotation(left[:, 0].reshape(3, 3).T)
    tool = _nearest_rotation(right[0].reshape(3, 3).T).T
    if np.sum((base @ turned @ tool - seen) ** 2) > np.sum((-base @ turned @ tool - seen) ** 2):
        base = _nearest_rotation(-left[:, 0].reshape(3, 3).T)
    rows = np.concatenate([np.concatenate([base @ each, np.eye(3)], axis=1) for each in turned])
    found = np.linalg.lstsq(rows, (measured.position - points @ base.T).ravel(), rcond=None)[0]
    return _pose(base, found[3:]), _pose(tool, found[:3])


def _nearest_rotation(matrix: Array) -> Array:
    left, _, right = np.linalg.svd(matrix)
    return left @ np.diag([1, 1, np.sign(np.linalg.det(left @ right))]) @ right


def _pose(rotation: Array, position: NDArray[Any]) -> Array:
    return np.concatenate([rotation_from_matrix(rotation), position])

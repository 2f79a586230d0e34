"""Record of one run, as plain arrays over time."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from dqcontrol import algebra
from dqcontrol.algebra.dual_quaternion_kernels import conjugate_multiply
from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import READ2, WRITE2, kernel, types
from dqcontrol.errors import ShapeError, ValueRangeError
from dqcontrol.files.long_array import long_array, row_by_row
from dqcontrol.loop.signals import Signal
from dqcontrol.references.sample import POSE, SAMPLE_SIZE


@kernel(types.void(READ2, READ2, WRITE2))
def pose_errors(poses, desired, out):
    """Write x_e = x* x_d of each row, the sign with a real part ≥ 0; NaN where a pose is not finite. [P16 2.23]

    Rows of ``desired`` are poses (8) or samples (21), which begin with one.
    """
    for i in range(out.shape[0]):
        conjugate_multiply(poses[i], desired[i], out[i])
        sign = -1.0 if out[i, 0] < 0.0 else 1.0
        for k in range(8):
            if not (math.isfinite(poses[i, k]) and math.isfinite(desired[i, k])):
                sign = math.nan
        for k in range(8):
            out[i, k] *= sign


_ONE = np.array([1.0, 0, 0, 0, 0, 0, 0, 0])


def row_norms(vectors: Array) -> Array:
    """Return the Euclidean norm of each row, (N, n) → (N,); on short rows several times faster than NumPy's `norm`."""
    return np.sqrt(np.einsum("ij,ij->i", vectors, vectors))


def error_norms(errors: Array) -> Array:
    """Return |1 − x_e| of errors x_e, (N, 8) → (N,)."""
    return row_norms(_ONE - errors)


FAILURES = ("diverged", "faulted", "halted", "toppled", "slipped")


def has_failed(stopped: str) -> bool:
    """Return whether a run that ended so diverged, was halted, switched its motors off, or fell over."""
    return stopped.startswith(FAILURES)


@dataclass(frozen=True, eq=False)
class Record:
    """One run of the closed loop, N samples of a robot with n configuration variables and m inputs.

    Row k holds what was true, measured, desired and commanded at ``time[k]``; ``command[k]`` is held until
    ``time[k + 1]``, so the last row's command moved nothing. Arrays become read-only float64 views; a run
    that diverged may hold NaN or infinity anywhere but in the time.
    `dqcontrol.measures.evaluate` measures it, `dqcontrol.recording.save_record` and `export_record` write it.

    Parameters
    ----------
    time
        Increasing, shape (N,), s.
    q
        True configuration, shape (N, n), rad or m.
    measured
        Configuration as the law saw it, shape (N, n), rad or m.
    command
        Inputs after all limits, shape (N, m), rad/s or m/s.
    pose
        End pose of ``q``, shape (N, 8), inertial frame, m.
    desired
        Samples of the reference, shape (N, 21): pose, twist, twist rate and time as in ``Sample.data``.
    joint_names
        n names of the configuration variables.
    input_names
        m names of the inputs; the joints' names if omitted.
    stopped
        Why the run ended: ``"duration"``, ``"settled"``, ``"diverged at …"``; or ``"faulted at …"``: the plant switched
        its motors off, and the run went on; or ``"halted at …"``: the supervisor or the clock stopped the robot; or
        ``"toppled at …"``, ``"slipped at …"``: a mobile robot fell over, or its wheels lost their grip.
    disturbance
        Twist ω + ε(ṗ + p × ω) that a disturbance gave the end effector from each sample to the next, shape (N, 6),
        rad/s and m/s, inertial frame; None if there was none.
    readings
        What else the plant sensed, by name, shape (N, columns) each.

    Raises
    ------
    ShapeError
        If an array is not numeric, or shapes or names do not fit together.
    ValueRangeError
        If the time is not finite and increasing.

    Examples
    --------
    >>> import numpy as np
    >>> from dqcontrol.loop.record import Record
    >>> pose = np.tile([1.0, 0, 0, 0, 0, 0, 0, 0], (3, 1))
    >>> desired = np.hstack([pose, np.zeros((3, 13))])
    >>> time, q = np.array([0, 0.1, 0.2]), np.zeros((3, 2))
    >>> record = Record(time, q, q, q, pose, desired, ("a", "b"))
    >>> record.error.tolist()
    [0.0, 0.0, 0.0]
    """

    time: Array
    q: Array
    measured: Array
    command: Array
    pose: Array
    desired: Array
    joint_names: tuple[str, ...]
    input_names: tuple[str, ...] = ()
    stopped: str = field(default="duration", kw_only=True)
    disturbance: Array | None = field(default=None, kw_only=True)
    readings: Mapping[str, Signal] = field(default_factory=dict, kw_only=True)

    def __post_init__(self) -> None:
        time = _frozen("time", self.time, None)
        count = len(time)
        q, command = _frozen("q", self.q, count, None), _frozen("command", self.command, count, None)
        n, m = q.shape[1], command.shape[1]
        arrays: dict[str, object] = {
            "time": time,
            "q": q,
            "measured": _frozen("measured", self.measured, count, n),
            "command": command,
            "pose": _frozen("pose", self.pose, count, 8),
            "desired": _frozen("desired", self.desired, count, SAMPLE_SIZE),
        }
        if self.disturbance is not None:
            arrays["disturbance"] = _frozen("disturbance", self.disturbance, count, 6)
        arrays["readings"] = {
            name: signal._replace(values=_frozen(f"readings.{name}", signal.values, count, len(signal.units)))
            for name, signal in self.readings.items()
        }
        if not count:
            raise ShapeError("time: a record needs at least one sample, got none")
        # between finite ends what increases is finite, too
        if not (math.isfinite(time[0]) and math.isfinite(time[-1]) and (time[1:] > time[:-1]).all()):
            raise ValueRangeError(
                f"time: must be finite and increasing, got {np.array2string(time, threshold=8)}"
            )
        joints, inputs = tuple(self.joint_names), tuple(self.input_names)
        if not inputs and m == n:
            inputs = joints
        for name, names, size in (("joint_names", joints, n), ("input_names", inputs, m)):
            if len(names) != size:
                raise ShapeError(f"{name}: expected {size} names, got {len(names)}")
        vars(self).update(arrays, joint_names=joints, input_names=inputs)

    def __len__(self) -> int:
        return len(self.time)

    def __repr__(self) -> str:
        end = f"ended by {self.stopped}" if " " not in self.stopped else self.stopped
        return f"Record({len(self)} samples over {self.duration:g} s, {self.q.shape[1]} coordinates, {end})"

    @property
    def duration(self) -> float:
        """Time between the first and the last sample, s."""
        return float(self.time[-1] - self.time[0])

    @cached_property
    def desired_pose(self) -> Array:
        """Desired end pose, shape (N, 8), inertial frame, m."""
        return _locked(row_by_row(lambda rows: np.ascontiguousarray(rows[:, POSE]), self.desired))

    @cached_property
    def position(self) -> Array:
        """End effector position p, shape (N, 3), m, inertial frame."""
        return _locked(row_by_row(_position, self.pose))

    @cached_property
    def desired_position(self) -> Array:
        """Desired end effector position, shape (N, 3), m, inertial frame."""
        return _locked(row_by_row(_position, self.desired_pose))

    @cached_property
    def error(self) -> Array:
        """|vec8(1 − x* x_d)| with the shorter sign of x_d, shape (N,), no unit [P16 5.1]."""
        return _locked(row_by_row(error_norms, self._pose_error))

    @cached_property
    def position_error(self) -> Array:
        """Distance |p_d − p|, shape (N,), m."""
        ends = self.desired_position, self.position
        return _locked(row_by_row(lambda wanted, is_: row_norms(wanted - is_), *ends))

    @cached_property
    def orientation_error(self) -> Array:
        """Angle of the rotation from the end effector to its desired orientation, 0 … π, shape (N,), rad."""
        return _locked(row_norms(self.rotation_error))

    @cached_property
    def rotation_error(self) -> Array:
        """Rotation vector from the end effector to its desired orientation, end effector frame, shape (N, 3), rad."""
        return _locked(row_by_row(_rotation_vector, self._pose_error))

    @cached_property
    def _pose_error(self) -> Array:
        """x_e = x* x_d, the sign with a real part ≥ 0; NaN where a pose is not finite."""
        error = long_array(len(self), 8)
        pose_errors(self.pose, self.desired, error)
        return _locked(error)


def part_of(record: Record, first: int, last: int) -> Record:
    """Return the samples first … last of a record, without copying them."""
    return _rows_of(record, slice(first, last))


def thinned(record: Record, most: int) -> Record:
    """Return at most so many samples of a record, and that of the largest error: all that a picture of it shows."""
    step = -(-len(record) // most)
    if step == 1:
        return record
    largest = int(np.argmax(record.error))
    return _rows_of(record, np.unique([*range(0, len(record), step), largest, len(record) - 1]))


def _rows_of(record: Record, rows: slice | NDArray[np.int_]) -> Record:
    disturbance = record.disturbance
    return Record(
        record.time[rows],
        record.q[rows],
        record.measured[rows],
        record.command[rows],
        record.pose[rows],
        record.desired[rows],
        record.joint_names,
        record.input_names,
        stopped=record.stopped,
        disturbance=None if disturbance is None else disturbance[rows],
        readings={name: each._replace(values=each.values[rows]) for name, each in record.readings.items()},
    )


def _position(poses: Array) -> Array:
    """Return the positions of poses, NaN where one is not finite."""
    if np.isfinite(poses).all():
        return algebra.translation(poses)
    finite = np.isfinite(poses).all(axis=1)
    position = np.full((len(poses), 3), np.nan)
    position[finite] = algebra.translation(poses[finite])
    return position


def _rotation_vector(pose_errors: Array) -> Array:
    w, v = pose_errors[:, :1], pose_errors[:, 1:4]
    sine = row_norms(v)[:, None]  # atan2, because acos loses half the digits near 0
    scale = np.divide(2 * np.arctan2(sine, w), sine, out=np.full_like(sine, 2.0), where=sine != 0)
    return scale * v


def _frozen(name: str, value: object, *shape: int | None) -> Array:
    """Return a read-only view (or copy) as float64 with this shape, None for any length; NaN may pass."""
    try:
        array = np.asarray(value)
        if array.dtype.kind not in "iuf":
            raise TypeError
    except (TypeError, ValueError):
        raise ShapeError(f"{name}: expected real numbers, got {value!r:.80}") from None
    if array.ndim != len(shape) or (
        array.shape != shape
        and any(want not in (None, got) for want, got in zip(shape, array.shape, strict=True))
    ):
        wanted = ", ".join("any" if want is None else str(want) for want in shape)
        raise ShapeError(f"{name}: expected shape ({wanted}{',' * (len(shape) == 1)}), got {array.shape}")
    return _locked(np.ascontiguousarray(array, dtype=np.float64).view())


def _locked(array: Array) -> Array:
    array.flags.writeable = False
    return array

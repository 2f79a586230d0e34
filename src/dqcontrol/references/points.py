"""Poses given one by one or in a table of comma-separated values; a smooth motion through them."""

from __future__ import annotations

import csv
import math
import os
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from dqcontrol import algebra
from dqcontrol.algebra.functions import WRITTEN_TOLERANCE
from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import READ, WRITE, WRITE2, inline, kernel, types
from dqcontrol.errors import (
    ExistsError,
    FileFormatError,
    ShapeError,
    ValueRangeError,
    as_array,
    as_positive,
    suggest,
    writing,
)
from dqcontrol.files.input_file import as_number, read_text
from dqcontrol.files.lerobot_dataset import POSE as POSE_COLUMN, Dataset, episode_of, only_episode
from dqcontrol.references.reference import (
    NO_CORNERS,
    FileName,
    Reference,
    Seconds,
    SpecStart,
    corners_between,
)
from dqcontrol.references.sample import POSE, SAMPLE_SIZE, TWIST, as_pose, motion_samples


@dataclass(frozen=True, eq=False, repr=False)
class Points(Reference):
    """Run from pose to pose by ScLERP: constant twist between two, the short way round.

    Poses of one orientation are so joined by straight lines at constant speed.

    Parameters
    ----------
    times
        Shape (N,), s, increasing, N ≥ 2; the first becomes time 0.
    poses
        Unit dual quaternions, shape (N, 8), inertial frame, m.
    streamed
        They came one by one, so nobody knew then how they go on: twists are zero, and laws feed nothing forward.

    Raises
    ------
    ShapeError, ValueRangeError
        If the shapes do not fit, the times do not increase, or a pose is no unit dual quaternion.

    Examples
    --------
    >>> there = [[1, 0, 0, 0, 0, 0, 0, 0], [1, 0, 0, 0, 0, 0.1, 0, 0]]
    >>> Points([0.0, 4.0], there).at(1.0).twist.round(12).tolist()
    [0.0, 0.0, 0.0, 0.05, 0.0, 0.0]
    """

    kind = "points"

    times: ArrayLike
    poses: ArrayLike
    streamed: bool = False
    _twists: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        times, poses = as_path(self.times, self.poses)
        steps = algebra.log_screw(algebra.multiply(algebra.conjugate(poses[:-1]), poses[1:]))
        twists = algebra.adjoint_twist(poses[:-1], 2 * steps / np.diff(times)[:, None])
        after = np.concatenate([twists[1:], np.zeros((1, 6))])
        corners = NO_CORNERS if self.streamed else corners_between(twists, after, times[1:])
        duration = float(times[-1])
        vars(self).update(times=times, poses=poses, duration=duration, corners=corners, _twists=twists)

    @classmethod
    def from_spec(
        cls, start: SpecStart, *, file: FileName, duration: Seconds | None = None, streamed: bool = False
    ) -> Points:
        """Run from pose to pose of a file; see `dqcontrol.references.load_points`.

        ``streamed``: the poses came one by one, as from an end effector; twists are zero.
        """
        path = start.folder / file
        start.refuse_position(path)
        if start.orientation_keys:
            try:
                load_points(path, duration=duration)
            except ValueRangeError:  # it has no orientations: those of the start are needed
                return load_points(path, start.pose, duration, streamed=streamed)
            start.refuse_orientation(path)
        return load_points(path, start.pose, duration, streamed=streamed)

    def motion(self, times: Array) -> Array:
        """Return samples (N, 21); see `Reference.motion`."""
        begins, poses = np.asarray(self.times), np.asarray(self.poses)
        i = np.clip(np.searchsorted(begins, times, side="right") - 1, 0, len(self._twists) - 1)
        out = np.zeros((len(times), SAMPLE_SIZE))
        elapsed = times - begins[i]
        out[:, POSE] = algebra.multiply(algebra.exp_screw(0.5 * elapsed[:, None] * self._twists[i]), poses[i])
        if not self.streamed:
            out[:, TWIST] = self._twists[i]
        return out


def as_path(times: ArrayLike, poses: ArrayLike) -> tuple[Array, Array]:
    """Return times (N,) from 0 and unit poses (N, 8) of signs that go the short way round, or say what is wrong."""
    times = as_array("times", times)
    if times.ndim != 1 or len(times) < 2:
        raise ShapeError(f"times: expected shape (N,) with N ≥ 2, got {times.shape}")
    late = np.flatnonzero(np.diff(times) <= 0)
    if len(late):
        i = late[0]
        raise ValueRangeError(
            f"times: must increase, got {times[i + 1]:g} after {times[i]:g} at index {i + 1}"
        )
    poses = algebra.as_unit("poses", poses)
    if poses.shape != (len(times), 8):
        raise ShapeError(f"poses: expected shape ({len(times)}, 8) as there are times, got {poses.shape}")
    poses = algebra.renormalise(poses)
    signs = np.where(np.sum(poses[1:, :4] * poses[:-1, :4], axis=1) < 0, -1.0, 1.0)
    poses[1:] *= np.cumprod(signs)[:, None]
    return times - times[0], poses


POSITION = ("x", "y", "z")
QUATERNION = ("qw", "qx", "qy", "qz")
DUAL_QUATERNION = ("pw", "px", "py", "pz", "dw", "dx", "dy", "dz")
_COLUMNS = ("time", *POSITION, *QUATERNION, *DUAL_QUATERNION)
_LAYOUTS = (POSITION, POSITION + QUATERNION, DUAL_QUATERNION)


def load_points(
    path: str | os.PathLike[str],
    start: ArrayLike | None = None,
    duration: float | None = None,
    *,
    streamed: bool = False,
) -> Points:
    r"""Return the reference that runs through the points of a file.

    The first line that is neither empty nor a comment (``#``) names the columns, in any order: ``time`` (s;
    may be left out) and either ``x, y, z`` (m, inertial frame), or these and ``qw, qx, qy, qz`` (unit
    quaternion), or the dual quaternion ``pw, px, py, pz, dw, dx, dy, dz``. Each further line is one point.

    A file that begins with a line of three numbers has no names: every line is ``x y z``, divided by blanks, as [P16
    4.5] wrote its paths, one point a sample.

    Of a LeRobot dataset (``FOLDER``, or ``FOLDER:EPISODE``) the points are its ``observation.pose``, which datasets
    written by `dqcontrol convert` have.

    Parameters
    ----------
    path
        The file.
    start
        Pose that gives the orientation if the file has positions only: `DualQuaternion` or shape (8,).
    duration
        s, shared equally among the points, if the file has no ``time``.
    streamed
        As of `Points`.

    Raises
    ------
    FileFormatError
        If the file cannot be read; the message begins with the file and the line.
    ValueRangeError
        If ``start`` or ``duration`` is needed and not given, or ``duration`` is given and not needed.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> file = pathlib.Path(tempfile.mkdtemp()) / "points.csv"
    >>> _ = file.write_text("x, y, z\n0, 0, 0\n0.1, 0, 0\n")
    >>> load_points(file, start=[1, 0, 0, 0, 0, 0, 0, 0], duration=2.0).corners.tolist()
    [2.0]
    """
    if (dataset := episode_of(path)) is not None:
        return _points_of_episode(path, *dataset, duration, streamed)
    lines, values, text = [], [], read_text(path)
    if _is_plain(text):
        names, rows = list(POSITION), _rows(text, plain=True)
    else:
        rows = _rows(text)
        number, names = next(rows, (1, []))
        names = [name.lower() for name in names]
        _check_names(f"{path}:{number}", names)
    for number, words in rows:
        where = f"{path}:{number}"
        if len(words) != len(names):
            raise FileFormatError(
                f"{where}: expected {len(names)} values ({', '.join(names)}), got {len(words)}"
            )
        values.append([as_number(f"{where}: {name}", word) for name, word in zip(names, words, strict=True)])
        lines.append(where)
    if len(values) < 2:
        raise FileFormatError(f"{path}: expected at least two points, got {len(values)}")
    table = dict(zip(names, np.array(values).T, strict=True))
    return Points(_times(path, table, lines, duration), _poses(path, table, lines, start), streamed)


def _points_of_episode(
    path: str | os.PathLike[str], data: Dataset, number: int | None, duration: float | None, streamed: bool
) -> Points:
    if POSE_COLUMN not in data.features:
        raise FileFormatError(
            f"{path}: has no column {POSE_COLUMN}; it has {', '.join(data.features) or 'none'}"
        )
    if duration is not None:
        raise ValueRangeError(f"duration: {path} has its own time; leave it out")
    poses = data.episode(only_episode(path, data, number))[POSE_COLUMN]
    if poses.shape[1] != 8 or len(poses) < 2:
        raise FileFormatError(
            f"{path}: {POSE_COLUMN}: expected at least two dual quaternions, got shape {poses.shape}"
        )
    poses = _units(poses, [f"{path}: frame {i}" for i in range(len(poses))], POSE_COLUMN)
    return Points(np.arange(len(poses)) / data.fps, poses, streamed)


def _rows(text: str, *, plain: bool = False) -> Iterator[tuple[int, list[str]]]:
    """Yield the number and the values of each line that is neither empty nor a comment; plain ones by their blanks."""
    for number, line in enumerate(text.splitlines(), start=1):
        content = line.partition("#")[0]
        if content.strip():
            yield number, content.split() if plain else [word.strip() for word in next(csv.reader([content]))]


def _is_plain(text: str) -> bool:
    """Tell whether the first line is three numbers divided by blanks."""
    _, words = next(_rows(text, plain=True), (1, []))
    try:
        return len([float(word) for word in words]) == len(POSITION)
    except ValueError:
        return False


def _check_names(where: str, names: list[str]) -> None:
    for name in names:
        if name not in _COLUMNS:
            raise FileFormatError(
                f"{where}: unknown column '{name:.40}'{suggest(name, _COLUMNS)} "
                f"(allowed: {', '.join(_COLUMNS)})"
            )
        if names.count(name) > 1:
            raise FileFormatError(f"{where}: column '{name}' is there {names.count(name)} times")
    found = set(names) - {"time"}
    if found not in [set(layout) for layout in _LAYOUTS]:
        allowed = "; or ".join(", ".join(layout) for layout in _LAYOUTS)
        raise FileFormatError(f"{where}: expected the columns {allowed}; got {', '.join(names) or 'none'}")


def _times(path: object, table: dict[str, Array], lines: list[str], duration: float | None) -> Array:
    if "time" not in table:
        if duration is None:
            raise ValueRangeError(f"duration: {path} has no column 'time': give the duration (s)")
        return np.linspace(0.0, as_positive("duration", duration), len(lines))
    if duration is not None:
        raise ValueRangeError(f"duration: {path} has its own column 'time', got {duration:g} besides")
    times = table["time"]
    for i in np.flatnonzero(np.diff(times) <= 0)[:1]:
        raise FileFormatError(f"{lines[i + 1]}: time: must increase, got {times[i + 1]:g} after {times[i]:g}")
    return times


def _poses(path: object, table: dict[str, Array], lines: list[str], start: ArrayLike | None) -> Array:
    if "pw" in table:
        x = np.stack([table[name] for name in DUAL_QUATERNION], axis=1)
        return _units(x, lines, "pw … dz")
    position = np.stack([table[name] for name in POSITION], axis=1)
    if "qw" in table:
        r = np.zeros((len(lines), 8))
        r[:, :4] = np.stack([table[name] for name in QUATERNION], axis=1)
        return algebra.pose(_units(r, lines, "qw … qz")[:, :4], position)
    if start is None:
        raise ValueRangeError(f"start: {path} gives no orientation: give a pose that has it")
    return algebra.pose(as_pose("start", start)[:4], position)


def _units(x: Array, lines: list[str], columns: str) -> Array:
    """Return dual quaternions (N, 8), normalised."""
    norms = np.linalg.norm(x[:, :4], axis=1)
    along = np.abs(np.sum(x[:, :4] * x[:, 4:], axis=1))
    wrong = (np.abs(norms - 1) > WRITTEN_TOLERANCE) | (along > WRITTEN_TOLERANCE)
    for i in np.flatnonzero(wrong)[:1]:
        raise FileFormatError(
            f"{lines[i]}: {columns}: must have norm 1, got {norms[i]:.9g} + ε {along[i]:.6g}"
        )
    return algebra.renormalise(x)


_LEAST = 1e-3  # s of way between two poses, less is none


class PointsWriter:
    """Appends poses to a file that `load_points` reads, each at once; the file is made with the first one.

    From pose to pose it takes as long as the way does at the speeds given.

    Parameters
    ----------
    path
        A file that does not exist yet.
    linear, angular
        Speeds, m/s and rad/s.

    Raises
    ------
    ExistsError
        If the file exists.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> from dqcontrol.references import load_points
    >>> writer = PointsWriter(pathlib.Path(tempfile.mkdtemp()) / "poses.csv", linear=0.05)
    >>> writer.add([1, 0, 0, 0, 0, 0, 0, 0]), writer.add([1, 0, 0, 0, 0, 0.1, 0, 0])  # 0.2 m apart
    (1, 2)
    >>> load_points(writer.path).duration
    4.0
    """

    path: Path

    def __init__(self, path: str | os.PathLike[str], linear: float = 0.1, angular: float = 0.5) -> None:
        self.path, self._linear, self._angular = Path(path), linear, angular
        self._time, self._count, self._last = 0.0, 0, np.zeros(8)
        if self.path.exists():
            raise ExistsError(f"{path}: exists already; choose another name or remove it")

    def add(self, pose: Array | list[float], note: str = "") -> int:
        """Append a pose, shape (8,), inertial frame, with a comment; return how many there are.

        Raises
        ------
        ValueRangeError
            If it is the one before.
        Error
            If it cannot be written.
        """
        new = np.asarray(pose, dtype=np.float64)
        way = self._way(new) if self._count else 0.0
        if self._count and way < _LEAST:
            raise ValueRangeError("pose: is the one before; move the hand first")
        values = [self._time + way, *algebra.translation(new), *algebra.rotation(new)]
        line = ", ".join(f"{value:.9g}" for value in values) + (f"  # {note}" if note else "")
        heading = "" if self._count else ", ".join(("time", *POSITION, *QUATERNION)) + "\n"
        with writing(self.path), open(self.path, "a" if self._count else "x", encoding="utf-8") as file:
            file.write(heading + line + "\n")
        self._time, self._last, self._count = self._time + way, new, self._count + 1
        return self._count

    def _way(self, pose: Array) -> float:
        """Return the time from the last pose, s."""
        turn = 2.0 * math.acos(min(1.0, abs(float(pose[:4] @ self._last[:4]))))
        distance = float(np.linalg.norm(algebra.translation(pose) - algebra.translation(self._last)))
        return max(distance / self._linear, turn / self._angular)


_EXACT = 1e-4  # m that a straight line between two rows may be off
_FIRST, _MOST = 16, 16_384  # rows
_TURNED = 1e-6  # of an orientation's numbers: what turns by less does so by rounding


def position_path(reference: Reference) -> Array:
    """Return rows [t, x, y, z] of a reference, shape (N, 4), s and m: shifts from its first position.

    Between rows it is off a straight line by at most 0.1 mm. They are the ``path`` of a `world.Motion`.

    Parameters
    ----------
    reference
        A motion with an end that does not turn.

    Raises
    ------
    ValueRangeError
        If it never ends, turns, or is so long and bent that it takes more than 16 000 rows.

    Examples
    --------
    >>> import dqcontrol as dqc
    >>> circle = dqc.references.Circle(start=[1, 0, 0, 0, 0, 0, 0, 0], radius=0.1, duration=4.0)
    >>> rows = position_path(circle)
    >>> rows[[0, -1], 0].tolist()  # s
    [0.0, 4.0]
    >>> rows[0, 1:].tolist()  # m
    [0.0, 0.0, 0.0]
    """
    if not math.isfinite(reference.duration):
        raise ValueRangeError("it never ends; give its duration")
    rows = _FIRST
    while True:
        even = np.linspace(0.0, reference.duration, 2 * rows + 1)
        times = np.unique(np.concatenate([even[::2], reference.corners]))
        middles = 0.5 * (times[:-1] + times[1:])
        poses = reference.samples(np.concatenate([times, middles]))[:, POSE]
        at, between = np.split(algebra.translation(poses), [len(times)])
        if 1.0 - np.abs(poses[:, :4] @ poses[0, :4]).min() > _TURNED:
            raise ValueRangeError("it turns, and bodies that move by themselves keep their orientation")
        off = np.linalg.norm(between - 0.5 * (at[:-1] + at[1:]), axis=1)
        if off.max() <= _EXACT:
            return np.column_stack([times, at - at[0]])
        rows *= 2
        if rows > _MOST:
            raise ValueRangeError(
                f"it takes more than {_MOST:,} straight lines of which none is {1e3 * _EXACT:g} mm off"
            )


_FARTHEST_TURN = 150.0  # degrees between two poses

_CUBICS = types.Array(types.float64, 3, "C", readonly=True)
_PIECE = types.Array(types.intp, 1, "C", readonly=True)


@inline
def _vector_of_product(a, b, out):
    """Write Im(a b*)."""
    aw, ax, ay, az = a[0], a[1], a[2], a[3]
    bw, bx, by, bz = b[0], -b[1], -b[2], -b[3]
    out[0] = aw * bx + ax * bw + ay * bz - az * by
    out[1] = aw * by - ax * bz + ay * bw + az * bx
    out[2] = aw * bz + ax * by - ay * bx + az * bw


@kernel(types.void(_CUBICS, _PIECE, READ, WRITE, WRITE2, WRITE2, WRITE2, WRITE2, WRITE2, WRITE2), strict=True)
def _run(cubics, which, elapsed, work, position, velocity, acceleration, rotation, spin, spin_rate):
    """Write the motion, as `motion_samples` takes it, at elapsed times within the pieces of a spline.

    Parameters
    ----------
    cubics
        As of `ViaPoints`: of the rotation's four coefficients, then of the position.
    which, elapsed
        Piece, and time in it, shape (N,), s.
    work
        Shape (12,).
    position, velocity, acceleration, rotation, spin, spin_rate
        Shapes (N, 3), of the rotation (N, 4).
    """
    c, c_rate, c_change = work[0:4], work[4:8], work[8:12]
    for i in range(which.shape[0]):
        k, t = which[i], elapsed[i]
        for n in range(7):
            k0, k1, k2, k3 = cubics[0, k, n], cubics[1, k, n], cubics[2, k, n], cubics[3, k, n]
            value = k0 + t * (k1 + t * (k2 + t * k3))
            rate, change = k1 + t * (2 * k2 + 3 * t * k3), 2 * k2 + 6 * t * k3
            if n < 4:
                c[n], c_rate[n], c_change[n] = value, rate, change
            else:
                position[i, n - 4], velocity[i, n - 4], acceleration[i, n - 4] = value, rate, change
        square, growth = 0.0, 0.0
        for n in range(4):
            square += c[n] * c[n]
            growth += c_rate[n] * c[n]
        _vector_of_product(c_rate, c, spin[i])
        _vector_of_product(c_change, c, spin_rate[i])
        for n in range(3):
            spin[i, n] = 2 * spin[i, n] / square
            spin_rate[i, n] = 2 * spin_rate[i, n] / square - 2 * growth / square * spin[i, n]
        for n in range(4):
            rotation[i, n] = c[n] / math.sqrt(square)


@dataclass(frozen=True, eq=False, repr=False)
class ViaPoints(Reference):
    """Run through poses smoothly: velocities and accelerations, also of turning, are continuous.

    Positions are natural cubic splines over time. So are the four coefficients of the rotation quaternion,
    which are then divided by their norm: r = c/|c|, ω = 2 Im(ċ c*)/|c|², α = 2 Im(c̈ c*)/|c|² − 2 ω (ċ·c)/|c|².
    Between two poses it goes the short way round. It starts and ends at speed, like every reference; wrap it
    in `JerkLimited` or `StartRamp` to start from rest.

    Parameters
    ----------
    times
        Shape (N,), s, increasing, N ≥ 2; the first becomes time 0.
    poses
        Unit dual quaternions, shape (N, 8), inertial frame, m.

    Raises
    ------
    ShapeError, ValueRangeError
        If the shapes do not fit, the times do not increase, a pose is no unit dual quaternion, or two poses
        in succession are more than 150 degrees apart.

    Examples
    --------
    >>> import numpy as np
    >>> poses = np.zeros((3, 8))
    >>> poses[:, 0], poses[:, 5], poses[1, 6] = 1.0, [0.0, 0.1, 0.2], 0.1  # half the positions
    >>> via = ViaPoints([0.0, 1.0, 2.0], poses)
    >>> via.at(1.0).pose[5:].round(12).tolist(), via.at(1.0).twist[3:].round(12).tolist()
    ([0.1, 0.1, 0.0], [0.2, 0.0, 0.0])
    """

    kind = "via-points"

    times: ArrayLike
    poses: ArrayLike
    _cubics: Array = field(init=False, repr=False)  # (4, N - 1, 7): coefficients of 1, τ, τ², τ³

    def __post_init__(self) -> None:
        times, poses = as_path(self.times, self.poses)
        turn = np.degrees(2 * np.arccos(np.clip(np.sum(poses[1:, :4] * poses[:-1, :4], axis=1), -1.0, 1.0)))
        if (turn > _FARTHEST_TURN).any():
            i = int(np.argmax(turn > _FARTHEST_TURN))
            raise ValueRangeError(
                f"poses: must turn by at most {_FARTHEST_TURN:g} degrees between two, got {turn[i]:.6g} between "
                f"index {i} and {i + 1}: give one in between"
            )
        cubics = _natural_spline(times, np.concatenate([poses[:, :4], algebra.translation(poses)], axis=1))
        _check_norms(times, cubics)
        vars(self).update(times=times, poses=poses, duration=float(times[-1]), _cubics=cubics)
        end = np.array([self.duration])
        vars(self).update(corners=corners_between(self.motion(end)[:, TWIST], np.zeros((1, 6)), end))

    @classmethod
    def from_spec(cls, start: SpecStart, *, file: FileName, duration: Seconds | None = None) -> ViaPoints:
        """Run smoothly through the poses of a file; see `dqcontrol.references.ViaPoints`."""
        points = Points.from_spec(start, file=file, duration=duration)
        return cls(points.times, points.poses)

    def motion(self, times: Array) -> Array:
        """Return samples (N, 21); see `Reference.motion`."""
        begins = np.asarray(self.times)
        which = np.clip(np.searchsorted(begins, times, side="right") - 1, 0, len(begins) - 2)
        count = len(times)
        position, velocity, acceleration, spin, spin_rate = (np.empty((count, 3)) for _ in range(5))
        rotation = np.empty((count, 4))
        elapsed, work = times - begins[which], np.empty(12)
        _run(self._cubics, which, elapsed, work, position, velocity, acceleration, rotation, spin, spin_rate)
        return motion_samples(position, velocity, acceleration, rotation, spin, spin_rate)


def _natural_spline(times: Array, values: Array) -> Array:
    """Return the cubics (4, N - 1, k) of the C² spline through values (N, k) that ends without curvature.

    SciPy's has the same (a test compares), but loading it takes 1.3 times as long as loading Numba.
    """
    h = np.diff(times)[:, None]
    slope = np.diff(values, axis=0) / h
    bend = np.zeros_like(values)  # second derivatives; tridiagonal system by elimination
    upper, right = np.zeros(len(times)), np.zeros_like(values)
    for i in range(1, len(times) - 1):
        pivot = 2 * (h[i - 1, 0] + h[i, 0]) - h[i - 1, 0] * upper[i - 1]
        upper[i] = h[i, 0] / pivot
        right[i] = (6 * (slope[i] - slope[i - 1]) - h[i - 1, 0] * right[i - 1]) / pivot
    for i in range(len(times) - 2, 0, -1):
        bend[i] = right[i] - upper[i] * bend[i + 1]
    first = slope - h * (2 * bend[:-1] + bend[1:]) / 6
    return np.stack([values[:-1], first, 0.5 * bend[:-1], np.diff(bend, axis=0) / (6 * h)])


def _check_norms(times: Array, cubics: Array) -> None:
    """Refuse coefficients that come near zero, where the rotation would whirl."""
    fractions = np.linspace(0.0, 1.0, 17)[:, None, None]
    t = fractions * np.diff(times)[None, :, None]
    k0, k1, k2, k3 = cubics[:, :, :4]
    norms = np.linalg.norm(k0 + t * (k1 + t * (k2 + t * k3)), axis=2).min(axis=0)
    if norms.min() < 0.2:
        i = int(np.argmin(norms))
        raise ValueRangeError(
            f"poses: turn too far and unevenly between index {i} and {i + 1} for a smooth motion: give more of them"
        )

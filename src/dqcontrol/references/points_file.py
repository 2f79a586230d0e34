"""The points file: a table of positions or poses as comma-separated values."""

from __future__ import annotations

import csv
import math
import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from dqcontrol.algebra import pose, renormalise, rotation, translation
from dqcontrol.algebra.batch import WRITTEN_TOLERANCE
from dqcontrol.arrays import Array
from dqcontrol.errors import ExistsError, FileFormatError, ValueRangeError, as_positive, suggest, writing
from dqcontrol.files.lerobot_dataset import POSE as POSE_COLUMN, Dataset, episode_of, only_episode
from dqcontrol.files.text_file import as_number, read_text
from dqcontrol.references.points import Points
from dqcontrol.references.reference import Reference
from dqcontrol.references.sample import POSE, as_pose

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
        return pose(_units(r, lines, "qw … qz")[:, :4], position)
    if start is None:
        raise ValueRangeError(f"start: {path} gives no orientation: give a pose that has it")
    return pose(as_pose("start", start)[:4], position)


def _units(x: Array, lines: list[str], columns: str) -> Array:
    """Return dual quaternions (N, 8), normalised."""
    norms = np.linalg.norm(x[:, :4], axis=1)
    along = np.abs(np.sum(x[:, :4] * x[:, 4:], axis=1))
    wrong = (np.abs(norms - 1) > WRITTEN_TOLERANCE) | (along > WRITTEN_TOLERANCE)
    for i in np.flatnonzero(wrong)[:1]:
        raise FileFormatError(
            f"{lines[i]}: {columns}: must have norm 1, got {norms[i]:.9g} + ε {along[i]:.6g}"
        )
    return renormalise(x)


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
        values = [self._time + way, *translation(new), *rotation(new)]
        line = ", ".join(f"{value:.9g}" for value in values) + (f"  # {note}" if note else "")
        heading = "" if self._count else ", ".join(("time", *POSITION, *QUATERNION)) + "\n"
        with writing(self.path), open(self.path, "a" if self._count else "x", encoding="utf-8") as file:
            file.write(heading + line + "\n")
        self._time, self._last, self._count = self._time + way, new, self._count + 1
        return self._count

    def _way(self, pose: Array) -> float:
        """Return the time from the last pose, s."""
        turn = 2.0 * math.acos(min(1.0, abs(float(pose[:4] @ self._last[:4]))))
        distance = float(np.linalg.norm(translation(pose) - translation(self._last)))
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
        at, between = np.split(translation(poses), [len(times)])
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

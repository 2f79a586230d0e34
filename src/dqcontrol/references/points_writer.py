"""Writing a points file pose by pose."""

from __future__ import annotations

import math
import os
from pathlib import Path

import numpy as np

from dqcontrol.algebra import rotation, translation
from dqcontrol.arrays import Array
from dqcontrol.errors import ExistsError, ValueRangeError, writing
from dqcontrol.references.points_file import POSITION, QUATERNION

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

"""Poses given one by one, as recorded or computed elsewhere."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dqcontrol.algebra import adjoint_twist, as_unit, conjugate, exp_screw, log_screw, multiply, renormalise
from dqcontrol.arrays import Array
from dqcontrol.errors import ShapeError, ValueRangeError, as_array
from dqcontrol.references.reference import Reference, corners_between
from dqcontrol.references.sample import POSE, SAMPLE_SIZE, TWIST
from dqcontrol.references.yaml_form import FileName, Seconds, SpecStart


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
    duration: float = field(init=False)
    corners: NDArray[np.float64] = field(init=False, repr=False)
    _times: Array = field(init=False, repr=False)
    _poses: Array = field(init=False, repr=False)
    _twists: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        times, poses = as_path(self.times, self.poses)
        steps = log_screw(multiply(conjugate(poses[:-1]), poses[1:]))
        twists = adjoint_twist(poses[:-1], 2 * steps / np.diff(times)[:, None])
        values = {
            "times": times,
            "poses": poses,
            "duration": float(times[-1]),
            "corners": np.zeros(0)
            if self.streamed
            else corners_between(twists, np.concatenate([twists[1:], np.zeros((1, 6))]), times[1:]),
            "_times": times,
            "_poses": poses,
            "_twists": twists,
        }
        for name, value in values.items():
            object.__setattr__(self, name, value)

    @classmethod
    def from_spec(
        cls, start: SpecStart, *, file: FileName, duration: Seconds | None = None, streamed: bool = False
    ) -> Points:
        """Run from pose to pose of a file; see `dqcontrol.references.load_points`.

        ``streamed``: the poses came one by one, as from an end effector; twists are zero.
        """
        from dqcontrol.references.points_file import load_points

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
        i = np.clip(np.searchsorted(self._times, times, side="right") - 1, 0, len(self._twists) - 1)
        out = np.zeros((len(times), SAMPLE_SIZE))
        elapsed = times - self._times[i]
        out[:, POSE] = multiply(exp_screw(0.5 * elapsed[:, None] * self._twists[i]), self._poses[i])
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
    poses = as_unit("poses", poses)
    if poses.shape != (len(times), 8):
        raise ShapeError(f"poses: expected shape ({len(times)}, 8) as there are times, got {poses.shape}")
    poses = renormalise(poses)
    signs = np.where(np.sum(poses[1:, :4] * poses[:-1, :4], axis=1) < 0, -1.0, 1.0)
    poses[1:] *= np.cumprod(signs)[:, None]
    return times - times[0], poses

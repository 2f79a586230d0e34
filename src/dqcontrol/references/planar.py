"""What circles, squares, spirals and drawings share: strokes on a sheet of paper that is held in space."""

from __future__ import annotations

import numpy as np

from dqcontrol.algebra import translation
from dqcontrol.arrays import Array
from dqcontrol.references.reference import Reference, corners_between
from dqcontrol.references.rigid_motion import motion_samples, turned
from dqcontrol.references.sample import TWIST
from dqcontrol.references.strokes import PenPath


class PlanarReference(Reference):
    """A reference that traces strokes on a plane, its orientation fixed or turning with the stroke.

    Attributes
    ----------
    trace
        The strokes over time, in paper coordinates.
    """

    trace: PenPath
    _start: Array
    _axes: Array
    _follow: bool
    _advance: Array

    def _place(
        self, trace: PenPath, start: Array, axes: Array, *, follow: bool = False, advance: Array | None = None
    ) -> None:
        """Hold the paper's origin at the start pose (8,); advance (3,), m/s, moves the paper meanwhile."""
        values = {
            "trace": trace,
            "start": start,
            "_start": start,
            "_axes": axes,
            "_follow": follow,
            "_advance": np.zeros(3) if advance is None else advance,
            "duration": float(trace.times[-1]),
        }
        for name, value in values.items():
            object.__setattr__(self, name, value)
        ends = self._samples(trace.times[1:], trace.ends())[:, TWIST]
        starts = self._samples(trace.times[1:-1], trace.at(trace.times[1:-1]))[:, TWIST]
        after = np.concatenate([starts, np.zeros((1, 6))])
        object.__setattr__(self, "corners", corners_between(ends, after, trace.times[1:]))

    def motion(self, times: Array) -> Array:
        """Return samples (N, 21); see `Reference.motion`."""
        return self._samples(times, self.trace.at(times))

    def sheet(self) -> dict[str, Array | float]:
        """Return how the paper is held, by the names of `computed_path.PathHead`."""
        return {
            "start": self._start,
            "axes": self._axes.ravel(),
            "advance": self._advance,
            "follow": float(self._follow),
            "follow_from": float(self.trace.yaw[0]),
        }

    def _samples(self, times: Array, traced: tuple[Array, Array, Array, Array, Array]) -> Array:
        position, velocity, acceleration, yaw, rate = traced
        p = translation(self._start) + position @ self._axes + times[:, None] * self._advance
        v = velocity @ self._axes + self._advance
        a = acceleration @ self._axes
        r = self._start[:4]
        if not self._follow:
            return motion_samples(p, v, a, r)
        normal = np.cross(self._axes[0], self._axes[1])
        return motion_samples(p, v, a, turned(r, normal, yaw - self.trace.yaw[0]), rate[:, None] * normal)

"""References one after the other."""

from __future__ import annotations

from collections.abc import Sequence as Several
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dqcontrol.algebra import translation
from dqcontrol.arrays import Array
from dqcontrol.errors import ValueRangeError
from dqcontrol.references.reference import Reference, corners_between
from dqcontrol.references.sample import POSE, SAMPLE_SIZE, TWIST

if TYPE_CHECKING:
    from dqcontrol.references.gripping import GripperStep
    from dqcontrol.references.guarded import Guards

_SAME_POSE = 1e-6  # largest difference of the eight coefficients between an end and the next start


@dataclass(frozen=True, eq=False, repr=False)
class Sequence(Reference):
    """References one after the other, each from where the one before it ends.

    Parameters
    ----------
    references
        At least one; all but the last of finite duration. ``SetPoint(pose, duration=2.0)`` makes a pause.

    Raises
    ------
    ValueRangeError
        If there is none, one that is not the last never ends, or one starts elsewhere than the one before it
        ends.

    Examples
    --------
    >>> from dqcontrol.references import Circle, SetPoint
    >>> start = [1, 0, 0, 0, 0, 0, 0, 0]
    >>> Sequence([SetPoint(start, duration=2.0), Circle(start, radius=0.1, duration=10.0)]).duration
    12.0
    """

    references: Several[Reference]
    duration: float = field(init=False)
    corners: NDArray[np.float64] = field(init=False, repr=False)
    _times: Array = field(init=False, repr=False)
    _signs: Array = field(init=False, repr=False)
    _distinct: tuple[Reference, ...] = field(
        init=False, repr=False
    )  # a repeated reference is sampled at once
    _which: NDArray[np.intp] = field(init=False, repr=False)  # of these each one is

    def __post_init__(self) -> None:
        parts = tuple(self.references)
        if not parts:
            raise ValueRangeError("references: expected at least one, got none")
        for i, part in enumerate(parts[:-1]):
            if not np.isfinite(part.duration):
                raise ValueRangeError(f"references[{i}]: never ends, so nothing can follow it")
        numbers: dict[int, int] = {}
        which = np.array([numbers.setdefault(id(part), len(numbers)) for part in parts])
        distinct = tuple({id(part): part for part in parts}.values())
        times = np.concatenate([[0.0], np.cumsum([part.duration for part in parts])])
        starts = np.concatenate([part.motion(np.zeros(1)) for part in distinct])[which]
        lasting = [part.duration if np.isfinite(part.duration) else 0.0 for part in distinct]
        ends = np.concatenate(
            [part.motion(np.array([end])) for part, end in zip(distinct, lasting, strict=True)]
        )
        ends = ends[which[:-1]]
        object.__setattr__(self, "references", parts)
        object.__setattr__(self, "duration", float(times[-1]))
        object.__setattr__(self, "_times", times)
        object.__setattr__(self, "_distinct", distinct)
        object.__setattr__(self, "_which", which)
        object.__setattr__(self, "_signs", _signs(ends[:, POSE], starts[1:, POSE]))
        seams = corners_between(ends[:, TWIST], starts[1:, TWIST], times[1:-1])
        within = [part.corners[part.corners < part.duration] for part in distinct]
        inner = [within[i] + time for i, time in zip(which, times, strict=False)]
        last = parts[-1].corners[parts[-1].corners == parts[-1].duration] + times[-2]
        corners = np.sort(np.concatenate([seams, *inner, last]))
        corners.flags.writeable = False
        object.__setattr__(self, "corners", corners)

    @property
    def guards(self) -> Guards:
        """Those of its parts."""
        from dqcontrol.references.guarded import Guards  # which has sequences

        found = [
            part.guards.later(float(time)) for part, time in zip(self.references, self._times, strict=False)
        ]
        planes = [each.plane for each in found if each.plane is not None]
        if len(planes) > 1:
            raise ValueRangeError(
                f"references: {len(planes)} of them have 'touch'; one plane is told in a run"
            )
        return Guards(tuple(move for each in found for move in each.moves), planes[0] if planes else None)

    @property
    def gripper_steps(self) -> tuple[GripperStep, ...]:
        """Those of its parts."""
        parts = zip(self.references, self._times, strict=False)
        return tuple(step.later(float(time)) for part, time in parts for step in part.gripper_steps)

    def motion(self, times: Array) -> Array:
        """Return samples (N, 21); see `Reference.motion`."""
        place = np.clip(np.searchsorted(self._times, times, side="right") - 1, 0, len(self.references) - 1)
        inner_times, which = times - self._times[place], self._which[place]
        order = np.argsort(which, kind="stable")
        out = np.empty((len(times), SAMPLE_SIZE))
        for rows in np.split(order, np.flatnonzero(np.diff(which[order])) + 1):
            if len(rows):
                part = self._distinct[which[rows[0]]]
                out[rows] = part.motion(part.snapped(inner_times[rows])[0])
        out[:, POSE] *= self._signs[place, None]
        return out


class Repeat(Sequence):
    """A reference several times; it must end where it starts.

    Parameters
    ----------
    reference
        Of finite duration.
    count
        How often, ≥ 1.

    Raises
    ------
    ValueRangeError
        If the count is not a whole number ≥ 1, or the reference never ends, or not where it starts.

    Examples
    --------
    >>> from dqcontrol.references import Circle
    >>> circle = Circle([1, 0, 0, 0, 0, 0, 0, 0], radius=0.1, duration=10.0)
    >>> Repeat(circle, 3).corners.tolist()  # smooth where the rounds join
    [30.0]
    """

    def __init__(self, reference: Reference, count: int) -> None:
        if not isinstance(count, int) or count < 1:
            raise ValueRangeError(f"count: expected a whole number ≥ 1, got {count!r}")
        super().__init__((reference,) * count)


def _signs(ends: Array, starts: Array) -> Array:
    """Return the sign of each part that lets the pose go on without jumping between x and −x."""
    same = np.where(np.sum(ends[:, :4] * starts[:, :4], axis=1) < 0, -1.0, 1.0)
    gaps = np.abs(ends - same[:, None] * starts).max(axis=1, initial=0.0)
    for i in np.flatnonzero(gaps > _SAME_POSE):
        before, after = translation(ends[i]), translation(starts[i])
        turn = np.degrees(2 * np.arccos(min(1.0, abs(ends[i, :4] @ starts[i, :4]))))
        raise ValueRangeError(
            f"references[{i + 1}]: must start where references[{i}] ends, but starts "
            f"{np.linalg.norm(after - before):.6g} m and {turn:.6g} degrees from there"
        )
    signs = np.ones(len(starts) + 1)
    signs[1:] = np.cumprod(same)
    return signs

"""A motion for where a body of the world stands, carried along to where that is measured."""

from __future__ import annotations

import math
from dataclasses import dataclass

from numpy.typing import ArrayLike

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.errors import as_positive
from dqcontrol.references.reference import Reference
from dqcontrol.references.sample import TIME, as_pose, displaced


@dataclass(frozen=True, eq=False, repr=False)
class Follow(Reference):
    """A reference x for a body at a place y₀, displaced at each sample to where the body is measured, y: y y₀* x.

    Its twist is that of x, turned alike: that of the body is not known. As long as nobody measures the body it is where
    it was to be.

    Parameters
    ----------
    reference
        The motion for the body at ``taught``.
    body
        Its name in the world.
    taught
        y₀, unit dual quaternion, shape (8,), inertial frame.
    until
        From then on the last measurement counts, s, as of a body that the end effector has gripped; to the end if
        omitted.

    Examples
    --------
    >>> from dqcontrol.references import SetPoint
    >>> above = SetPoint([1, 0, 0, 0, 0, 0.25, 0, 0.1])
    >>> follow = Follow(above, "cube", [1, 0, 0, 0, 0, 0.25, 0, 0])
    >>> row = follow.samples([0.0])
    >>> follow.carried(row[0], [1, 0, 0, 0, 0, 0.3, 0, 0])[5:8].tolist()  # half the position
    [0.3, 0.0, 0.1]
    """

    reference: Reference
    body: str
    taught: ArrayLike
    until: float = math.inf

    def __post_init__(self) -> None:
        if math.isfinite(self.until):
            as_positive("until", self.until, zero_allowed=True)
        vars(self).update(duration=self.reference.duration, corners=self.reference.corners)
        vars(self).update(taught=as_pose("taught", self.taught))

    def motion(self, times: Array) -> Array:
        """Return samples (N, 21) with the body where it was taught; see `Reference.motion`."""
        return self.reference.motion(times)

    def displacement(self, seen: ArrayLike) -> Array:
        """Return y y₀*, shape (8,), of a body that is measured at a pose y, shape (8,)."""
        return algebra.multiply(as_pose("seen", seen), algebra.conjugate(self.taught))

    def carried(self, row: Array, seen: ArrayLike) -> Array:
        """Return a sample (21,) for a body that is measured at a pose (8,)."""
        out = displaced(self.displacement(seen), row[None])[0]
        out[TIME] = row[TIME]
        return out


def follow_in(reference: Reference | None) -> Follow | None:
    """Return the `Follow` that a reference is, or that it leads in time; None if there is none."""
    while reference is not None and not isinstance(reference, Follow):
        reference = getattr(reference, "reference", None)
    return reference

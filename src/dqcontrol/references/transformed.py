"""References moved rigidly."""

from __future__ import annotations

from dataclasses import dataclass, field

from numpy.typing import ArrayLike

from dqcontrol.arrays import Array
from dqcontrol.references.reference import Reference
from dqcontrol.references.rigid_motion import displaced
from dqcontrol.references.sample import as_pose


@dataclass(frozen=True, eq=False, repr=False)
class Transformed(Reference):
    """A reference seen after a constant displacement y: pose yx, twist Ad(y)ξ, twist rate Ad(y)ξ̇ [S17 4.9].

    Parameters
    ----------
    reference
        What to displace.
    by
        y, unit dual quaternion, `DualQuaternion` or shape (8,), inertial frame, m.

    Raises
    ------
    ShapeError, ValueRangeError
        If ``by`` is no unit dual quaternion.

    Examples
    --------
    >>> from dqcontrol.references import SetPoint
    >>> up = [1, 0, 0, 0, 0, 0, 0, 0.5]
    >>> Transformed(SetPoint([1, 0, 0, 0, 0, 0.1, 0, 0]), by=up).at(0.0).pose.tolist()
    [1.0, 0.0, 0.0, 0.0, 0.0, 0.1, 0.0, 0.5]
    """

    reference: Reference
    by: ArrayLike
    duration: float = field(init=False)
    corners: Array = field(init=False, repr=False)
    _by: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        by = as_pose("by", self.by)
        kept = {"duration": self.reference.duration, "corners": self.reference.corners}
        for name, value in {"by": by, "_by": by, **kept}.items():
            object.__setattr__(self, name, value)

    def motion(self, times: Array) -> Array:
        """Return samples (N, 21); see `Reference.motion`."""
        return displaced(self._by, self.reference.motion(times))

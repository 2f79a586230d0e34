"""A resting target."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dqcontrol.errors import as_positive
from dqcontrol.references.reference import NO_CORNERS, Reference
from dqcontrol.references.sample import POSE, SAMPLE_SIZE, as_pose
from dqcontrol.references.yaml_form import Seconds, SpecStart


@dataclass(frozen=True, eq=False, repr=False)
class SetPoint(Reference):
    """Rest at one pose.

    Parameters
    ----------
    pose
        Unit dual quaternion, `DualQuaternion` or shape (8,), inertial frame, m.
    duration
        s; no end if omitted. A finite one makes a pause in a `Sequence`.

    Raises
    ------
    ShapeError, ValueRangeError
        If the pose is no unit dual quaternion or the duration is not positive.

    Examples
    --------
    >>> SetPoint([1, 0, 0, 0, 0, 0.1, 0, 0]).at(3.0).pose.tolist()
    [1.0, 0.0, 0.0, 0.0, 0.0, 0.1, 0.0, 0.0]
    """

    kind = "set-point"

    pose: ArrayLike
    duration: float = math.inf

    def __post_init__(self) -> None:
        duration = math.inf if self.duration == math.inf else as_positive("duration", self.duration)
        vars(self).update(pose=as_pose("pose", self.pose), duration=duration, corners=NO_CORNERS)

    @classmethod
    def from_spec(cls, start: SpecStart, *, duration: Seconds | None = None) -> SetPoint:
        """Rest at the start pose, without end or for a given duration."""
        return cls(start.pose, math.inf if duration is None else duration)

    def to_spec(self) -> dict[str, Any] | None:
        """Return its pose and duration; see `Reference.to_spec`."""
        if type(self) is not SetPoint:
            return super().to_spec()
        return {"start": self.pose} | ({"duration": self.duration} if math.isfinite(self.duration) else {})

    def motion(self, times: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return samples (N, 21); see `Reference.motion`."""
        out = np.zeros((len(times), SAMPLE_SIZE))
        out[:, POSE] = self.pose
        return out

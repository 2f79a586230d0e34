"""Resting targets: a set-point, and those while a gripper closes or opens; and what of a world the hand holds then."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, NamedTuple

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import ArrayLike, NDArray

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.errors import ValueRangeError, as_positive, unknown_name
from dqcontrol.references.reference import NO_CORNERS, Reference, Seconds, SpecStart
from dqcontrol.references.sample import POSE, SAMPLE_SIZE, as_pose
from dqcontrol.world import Body, SetDown


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


_LASTS = 1.0  # s: fingers that are 60 mm apart close at 50 mm/s each in 0.6 s


class GripperStep(NamedTuple):
    """When a gripper closes or opens, from ``begin`` to ``end``, s; on what; and the end effector's pose then, (8,)."""

    begin: float
    end: float
    closes: bool
    body: str | None
    pose: Array

    def later(self, by: float) -> GripperStep:
        """Return the same some seconds later."""
        return self._replace(begin=self.begin + by, end=self.end + by)


@dataclass(frozen=True, eq=False, repr=False)
class Grip(SetPoint):
    """Rest while the gripper closes; from the end of it on the hand holds a body of the world.

    Parameters
    ----------
    pose, duration
        As of `SetPoint`.
    body
        Its name; its key ``held`` says how the hand holds it. Nothing is held if omitted.

    Examples
    --------
    >>> Grip([1, 0, 0, 0, 0, 0, 0, 0], body="rod").gripper_steps[0].end
    1.0
    """

    kind = "grip"

    duration: float = _LASTS
    body: str | None = None

    @classmethod
    def from_spec(  # pyright: ignore[reportIncompatibleMethodOverride] — these always end
        cls,
        start: SpecStart,
        *,
        duration: Seconds = _LASTS,
        body: Annotated[str, Meta(min_length=1, description="of the world, with 'held'")] | None = None,
    ) -> SetPoint:
        """Rest while the gripper closes, which then holds ``body``."""
        return cls(start.pose, duration, body)

    @property
    def gripper_steps(self) -> tuple[GripperStep, ...]:
        """The one that it is."""
        return (GripperStep(0.0, self.duration, True, self.body, self.at(0.0).pose),)


@dataclass(frozen=True, eq=False, repr=False)
class Release(SetPoint):
    """Rest while the gripper opens; from the begin of it on what the hand held stands where it is.

    Parameters
    ----------
    pose, duration
        As of `SetPoint`.

    Examples
    --------
    >>> Release([1, 0, 0, 0, 0, 0, 0, 0]).gripper_steps[0].closes
    False
    """

    kind = "release"

    duration: float = _LASTS

    @classmethod
    def from_spec(  # pyright: ignore[reportIncompatibleMethodOverride] — these always end
        cls, start: SpecStart, *, duration: Seconds = _LASTS
    ) -> SetPoint:
        """Rest while the gripper opens."""
        return cls(start.pose, duration)

    @property
    def gripper_steps(self) -> tuple[GripperStep, ...]:
        """The one that it is."""
        return (GripperStep(0.0, self.duration, False, None, self.at(0.0).pose),)


def held_by_steps(bodies: Mapping[str, Body], steps: Iterable[GripperStep]) -> dict[str, Body]:
    """Return bodies of a world with when the hand holds them, and where they stand afterwards, by steps in order.

    Raises
    ------
    UnknownNameError, ValueRangeError
        If there is no such body, nothing says how it is held, or it is gripped twice.
    """
    found, now = dict(bodies), list[str]()
    gripped = set[str]()
    for step in steps:
        if step.closes and step.body is not None:
            if step.body not in found:
                raise unknown_name("grip.body", step.body, tuple(found))
            if step.body in gripped:
                raise ValueRangeError(
                    f"grip.body: '{step.body}' is gripped twice; a body is held once in a run"
                )
            found[step.body] = _held(step.body, found[step.body], since=step.end)
            now.append(step.body)
            gripped.add(step.body)
        for name in [] if step.closes else now:
            held = found[name].held
            assert held is not None
            place = algebra.multiply(step.pose, held.grasp)
            put = SetDown(
                position=tuple(algebra.translation(place).tolist()),
                rpy=tuple(algebra.rpy_from_rotation(algebra.rotation(place)).tolist()),
            )
            frames = held.frame is not None  # whose pose no step says
            found[name] = _held(
                name, found[name], since=held.since, until=step.begin, put=None if frames else put
            )
        now = now if step.closes else []
    return found


def never_held(bodies: Mapping[str, Body], names: Iterable[str]) -> dict[str, Body]:
    """Return bodies of a world of which some, that steps grip, are not held yet."""
    return {
        **bodies,
        **{name: _held(name, bodies[name], since=float("inf")) for name in names if name in bodies},
    }


def _held(name: str, body: Body, **times: object) -> Body:
    if body.held is None:
        raise ValueRangeError(
            f"grip.body: nothing says how the hand holds '{name}'; give it 'held', as held: {{}}"
        )
    changed = {"until": None, "put": None, **times}
    return msgspec.structs.replace(body, held=msgspec.structs.replace(body.held, **changed))

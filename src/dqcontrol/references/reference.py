"""The base of all references: samples of a desired motion over time."""

from __future__ import annotations

import dataclasses
import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, NamedTuple

import numpy as np
from msgspec import Meta
from numpy.typing import ArrayLike, NDArray

from dqcontrol.algebra import translation
from dqcontrol.algebra.functions import UNIT_TOLERANCE, first_not_unit
from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import READ, WRITE, inline, kernel, types
from dqcontrol.errors import ShapeError, ValueRangeError, as_array
from dqcontrol.files.long_array import long_array
from dqcontrol.references.sample import SAMPLE_SIZE, TIME, TWIST, TWIST_RATE, Sample
from dqcontrol.world import World

Positive = Annotated[float, Meta(gt=0)]
Metres = Annotated[float, Meta(gt=0, description="m")]
Seconds = Annotated[float, Meta(gt=0, description="s")]
Vector = tuple[float, float, float]
FileName = Annotated[str, Meta(min_length=1, description="path, relative to the spec")]


class Yaml(NamedTuple):
    """Annotates a parameter that takes arrays in Python: what a file may hold for it."""

    form: Any


@dataclass(frozen=True)
class SpecStart:
    """Where a reference of a spec starts; see `Reference.from_spec`.

    Attributes
    ----------
    pose
        Unit dual quaternion, shape (8,), inertial frame, m.
    folder
        Where relative file names start.
    place
        The reference's field in the spec, for messages.
    position_keys, orientation_keys
        Keys of the spec that say where, and how turned, it starts.
    """

    pose: Array
    folder: Path
    place: str
    position_keys: tuple[str, ...] = ()
    orientation_keys: tuple[str, ...] = ()

    def refuse_position(self, file: Path) -> None:
        """Refuse keys for the position, because a file says it."""
        self._refuse(self.position_keys, f"{file} says itself where it starts")

    def refuse_orientation(self, file: Path) -> None:
        """Refuse keys for the orientation, because a file says it."""
        self._refuse(self.orientation_keys, f"{file} says itself how the hand is turned")

    def _refuse(self, keys: tuple[str, ...], why: str) -> None:
        for key in keys:
            raise ValueRangeError(f"{self.place}.{key}: {why}: leave it out, or use 'transform'")


if TYPE_CHECKING:
    from dqcontrol.constraints.prepared_constraints import PreparedConstraints
    from dqcontrol.references.sequence import Guards
    from dqcontrol.references.set_points import GripperStep
    from dqcontrol.robots import Robot

# a twist that jumps by less, compared with the largest, comes of rounded input and is no corner
SMOOTH = 1e-3
SNAP = 1e-9  # s; a time this near to a corner is the corner: a multiple of the period seldom hits one exactly
_BLOCK = 4096  # times sampled at once: all that is computed of them fits into the processor's cache


@inline
def begun(starts, time):
    """Return how many of the starts (N,), which increase, are not after a time."""
    low, high = 0, starts.shape[0]
    while low < high:
        middle = (low + high) // 2
        if starts[middle] <= time:
            low = middle + 1
        else:
            high = middle
    return low


@kernel(types.void(READ, READ, types.float64, WRITE, types.Array(types.boolean, 1, "C")), strict=True)
def _snap(times, corners, duration, inside, at_corner):
    """Put times into [0, duration] and onto the nearest corner, or the end, within `SNAP`; say which are there."""
    for i in range(times.shape[0]):
        time = min(max(times[i], 0.0), duration)
        passed = begun(corners, time)
        before = corners[passed - 1] if passed > 0 else -np.inf
        after = corners[passed] if passed < corners.shape[0] else duration
        nearest = before if time - before <= after - time else after
        at_corner[i] = abs(time - nearest) <= SNAP
        inside[i] = nearest if at_corner[i] else time


class Reference(ABC):
    """A desired pose, twist and twist rate over time, inertial frame.

    A subclass sets the two attributes and writes `motion`.

    Attributes
    ----------
    duration
        s; ``math.inf`` for a set-point.
    corners
        Times at which the twist jumps, shape (k,), s, increasing. The end is one if the motion does not come
        to rest there by itself; the start is not.
    plans_around
        Whether `of_robot` asks what constraints keep.
    kind
        Its name in specs; empty if it has none. Its keys there are the parameters of `from_spec`.
    """

    kind: ClassVar[str] = ""
    plans_around: ClassVar[bool] = False
    duration: float
    corners: Array

    @classmethod
    def from_spec(cls, start: SpecStart, *_: Any, **parameters: Any) -> Reference:
        """Return the reference that a spec describes; a subclass says its keys as keyword-only parameters with types.

        Without that they are those of the constructor, of a dataclass with a field ``start``.

        Parameters
        ----------
        start
            Where it starts.
        **parameters
            As the spec gives them.
        """
        return cls(start.pose, **parameters)  # type: ignore[call-arg] — of a dataclass

    @classmethod
    def of_robot(
        cls,
        reference: Reference,
        robot: Robot,
        start: Array,
        world: World | None = None,
        kept: PreparedConstraints | None = None,
        *_: Any,
        **parameters: Any,
    ) -> Reference:
        """Return what a robot at its start configuration, shape (n,), makes of the reference of a spec.

        Parameters
        ----------
        reference
            From `from_spec`, with all that modifies it.
        robot, start
            Who follows it, and from where, rad or m.
        world
            What stands around.
        kept
            What the laws of the spec keep; given to a reference that plans around it.
        **parameters
            As of `from_spec`.
        """
        return reference

    def to_spec(self) -> dict[str, Any] | None:
        """Return its keys in a spec, and ``start``, its first pose; None if a spec cannot say it."""
        if (
            not vars(type(self)).get("kind")
            or type(self).from_spec.__func__ is not Reference.from_spec.__func__
        ):
            return None
        return {each.name: getattr(self, each.name) for each in dataclasses.fields(self) if each.init}  # type: ignore[arg-type]

    def __repr__(self) -> str:
        """Return the class and its parameters in a line: of arrays their shape."""
        fields = dataclasses.fields(self) if dataclasses.is_dataclass(self) else ()
        given = (
            f"{each.name}={_in_short(getattr(self, each.name))}" for each in fields if each.init and each.repr
        )
        return f"{type(self).__name__}({', '.join(given)})"

    @property
    def guards(self) -> Guards:
        """What of it touches end or displace: nothing, unless a subclass says so.

        Raises
        ------
        ValueRangeError
            If it changes a reference with guarded moves and does not know how to change these.
        """
        from dqcontrol.references.sequence import Guards  # which has references

        inner = getattr(self, "reference", None)
        if isinstance(inner, Reference) and inner.guards.moves:
            raise ValueRangeError(
                f"reference: {type(self).__name__} changes the timing or place of guarded moves; put 'until' and "
                "'touch' outside of it"
            )
        return Guards()

    @property
    def gripper_steps(self) -> tuple[GripperStep, ...]:
        """When grippers close and open along it, in order: never, unless a subclass says so.

        Raises
        ------
        ValueRangeError
            If it changes a reference with such steps.
        """
        inner = getattr(self, "reference", None)
        if isinstance(inner, Reference) and inner.gripper_steps:
            raise ValueRangeError(
                f"reference: {type(self).__name__} changes a motion with 'grip' or 'release'; change the other steps"
            )
        return ()

    @abstractmethod
    def motion(self, times: Array) -> Array:
        """Return samples (N, 21) for times (N,) in [0, duration], s: what a subclass writes.

        At an inner corner the twist is the right-hand one, at ``duration`` the left-hand one. `samples` takes
        care of everything else.
        """

    def samples(self, times: ArrayLike) -> Array:
        """Return the desired motion at many times.

        Parameters
        ----------
        times
            Shape (N,), s, ≥ 0, in any order. From ``duration`` on the reference rests at its last pose. A
            time within 1 ns of a corner is the corner: the twist is the one after it, the twist rate 0.

        Returns
        -------
        array
            Shape (N, 21): pose (8), twist (6), twist rate (6) and the time asked for; see `Sample`.

        Raises
        ------
        ShapeError, ValueRangeError
            If the times are not a row of finite numbers ≥ 0.

        Examples
        --------
        >>> import dqcontrol.references as references
        >>> circle = references.Circle(start=[1, 0, 0, 0, 0, 0, 0, 0], radius=0.07, duration=10.0)
        >>> circle.samples([0.0, 5.0]).shape
        (2, 21)
        """
        asked = as_array("times", times)
        if asked.ndim != 1:
            raise ShapeError(f"times: expected shape (N,), got {asked.shape}")
        if (asked < 0).any():
            raise ValueRangeError(f"times: must be ≥ 0, got {asked.min():g}")
        if len(asked) <= _BLOCK:
            return self._block(asked)
        out = long_array(len(asked), SAMPLE_SIZE)
        for first in range(0, len(asked), _BLOCK):
            out[first : first + _BLOCK] = self._block(asked[first : first + _BLOCK])
        return out

    def _block(self, times: Array) -> Array:
        """Return samples at times that are checked."""
        inside, at_corner = self.snapped(times)
        found = np.ascontiguousarray(self.motion(inside), dtype=np.float64)
        found[at_corner, TWIST_RATE] = 0.0
        found[inside >= self.duration, TWIST.start : TWIST_RATE.stop] = 0.0
        found[:, TIME] = times
        return found

    def at(self, time: float) -> Sample:
        """Return the sample at one time, s, ≥ 0."""
        return Sample.of_row(self.samples([float(as_array("time", time, ()))])[0])

    def snapped(self, times: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Return the times (N,), s, put into [0, duration] and onto near corners, and which are corners.

        For references made of other references, whose own times are sums and differences.
        """
        inside, at_corner = np.empty(len(times)), np.empty(len(times), dtype=np.bool_)
        _snap(np.ascontiguousarray(times), self.corners, self.duration, inside, at_corner)
        return inside, at_corner


def _in_short(value: object) -> str:
    """Return a parameter in a few letters."""
    if callable(value):
        return getattr(value, "__name__", type(value).__name__)
    if isinstance(value, str | bool | int | Reference):
        return repr(value)
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, list | tuple) and any(isinstance(each, Reference) for each in value):
        return f"{len(value)} references"
    try:
        shape = np.shape(getattr(value, "vec8", value))  # type: ignore[arg-type]
    except ValueError:
        return f"{len(value)} parts"  # type: ignore[arg-type]
    if shape == (8,):
        numbers = np.ascontiguousarray(getattr(value, "vec8", value), dtype=np.float64)
        if first_not_unit(numbers[None], UNIT_TOLERANCE) < 0:
            x, y, z = translation(numbers)
            return f"pose at ({x:.4g}, {y:.4g}, {z:.4g})"
    return f"array {shape}" if math.prod(shape) > 6 else str(np.asarray(value).tolist())


def corners_between(left: Array, right: Array, times: Array) -> Array:
    """Return those of the times (k,) at which the twists before, (k, 6), and after, (k, 6), differ."""
    jumps = np.zeros(len(times), dtype=bool)
    for half in (slice(0, 3), slice(3, 6)):
        size = max(np.abs(left[:, half]).max(initial=0.0), np.abs(right[:, half]).max(initial=0.0))
        jumps |= np.abs(left[:, half] - right[:, half]).max(axis=1, initial=0.0) > SMOOTH * size
    chosen = times[jumps]
    chosen.flags.writeable = False
    return chosen


NO_CORNERS = np.zeros(0)
NO_CORNERS.flags.writeable = False

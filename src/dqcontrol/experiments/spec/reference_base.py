"""What all references in a spec share: where they start, and the keys that modify them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, ClassVar

import msgspec
import numpy as np
from msgspec import Meta

from dqcontrol import algebra, references as shapes
from dqcontrol.arrays import Array
from dqcontrol.constraints.prepared_constraints import PreparedConstraints
from dqcontrol.errors import Error, FileFormatError, ValueRangeError, as_array
from dqcontrol.named_fields import NamedFields
from dqcontrol.references.yaml_form import SpecStart
from dqcontrol.robots import Robot
from dqcontrol.world import World

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]

_NO_TURN = (1.0, 0.0, 0.0, 0.0)
_START_KEYS = {"position": (("position",), "translation"), "orientation": (("quaternion", "rpy"), "rotation")}
_MOST_CORNERS = 1_000_000  # a few nested repeats would fill any memory


class Part(NamedFields, frozen=True, kw_only=True, forbid_unknown_fields=True, repr_omit_defaults=True):
    """Base of all parts of a spec."""


class StartPose(Part, frozen=True, kw_only=True):
    """Where the reference starts, base frame; what is left out is the end effector's at the start configuration."""

    position: Annotated[Vector | None, Meta(description="m")] = None
    quaternion: Annotated[Quaternion | None, Meta(description="scalar first")] = None
    rpy: Annotated[Vector | None, Meta(description="roll, pitch, yaw: Rz(y) Ry(p) Rx(r), rad")] = None


class Offset(Part, frozen=True, kw_only=True):
    """A displacement of the start pose, base axes: so far is the end effector from its target when the run starts."""

    translation: Annotated[Vector, Meta(description="m")] = (0.0, 0.0, 0.0)
    rotation: Annotated[Vector, Meta(description="rotation vector, rad")] = (0.0, 0.0, 0.0)


class Displacement(Part, frozen=True, kw_only=True):
    """A displacement y of a whole reference, base frame: x_d becomes y x_d."""

    position: Annotated[Vector, Meta(description="m")] = (0.0, 0.0, 0.0)
    quaternion: Annotated[Quaternion | None, Meta(description="scalar first")] = None
    rpy: Annotated[Vector | None, Meta(description="roll, pitch, yaw: Rz(y) Ry(p) Rx(r), rad")] = None


class JerkLimits(Part, frozen=True, kw_only=True):
    """Limits along the path; see `dqcontrol.references.JerkLimited`."""

    velocity: Annotated[float, Meta(gt=0, description="m/s")]
    acceleration: Annotated[float, Meta(gt=0, description="m/s²")]
    jerk: Annotated[float, Meta(gt=0, description="m/s³")]
    angular_velocity: Annotated[float, Meta(gt=0, description="rad/s")] | None = None
    angular_acceleration: Annotated[float, Meta(gt=0, description="rad/s²")] | None = None
    angular_jerk: Annotated[float, Meta(gt=0, description="rad/s³")] | None = None


class Preview(Part, frozen=True, kw_only=True):
    """By how much twists come early and lead, for laws with feed-forward; see `dqcontrol.references.Previewed`."""

    delay: Annotated[float, Meta(ge=0, description="s")] = 0.0
    lag: Annotated[float, Meta(ge=0, description="s")] = 0.0
    step: Annotated[float, Meta(gt=0, description="s")] | None = None


class Until(Part, frozen=True, kw_only=True):
    """What ends a motion before its time; see `dqcontrol.references.Guarded`."""

    force: Annotated[float, Meta(gt=0, description="N")] | None = None
    drop: Annotated[float, Meta(gt=0, description="m")] | None = None


class Touch(Part, frozen=True, kw_only=True):
    """Three touches that find the plane of a reference; see `dqcontrol.references.OnTouchedPlane`."""

    force: Annotated[float, Meta(gt=0, description="N")] = 1.0
    normal: Vector = (0.0, 0.0, 1.0)
    points: Annotated[list[Vector], Meta(min_length=3, max_length=3, description="m")] | None = None
    height: Annotated[float, Meta(gt=0, description="m")] = 0.01
    depth: Annotated[float, Meta(gt=0, description="m")] = 0.01
    speed: Annotated[float, Meta(gt=0, description="m/s")] = 0.005
    travel: Annotated[float, Meta(gt=0, description="m/s")] = 0.05


class ReferenceSpec(Part, frozen=True, kw_only=True, tag_field="kind"):
    """A reference; subclasses say which.

    The other keys modify it in this order: ``repeat``, one of ``ramp``, ``corner_stops`` and ``jerk_limits``,
    ``transform``, ``preview``, ``touch``, ``until``.
    """

    plans_around: ClassVar[bool] = False  # see `Reference`
    start: StartPose = StartPose()
    offset: Offset = Offset()
    repeat: Annotated[int, Meta(ge=1, le=10_000)] = 1
    ramp: Annotated[float, Meta(gt=0, description="s")] | None = None
    corner_stops: Annotated[float, Meta(gt=0, description="s")] | None = None
    jerk_limits: JerkLimits | None = None
    transform: Displacement | None = None
    preview: Preview | None = None
    touch: Touch | None = None
    until: Until | None = None

    def build(self, hand: Array, folder: Path, where: str = "reference") -> shapes.Reference:
        """Return the reference.

        Parameters
        ----------
        hand
            Pose of the end effector at the start configuration, shape (8,), inertial frame.
        folder
            Where relative file names start.
        where
            Name of the field, for error messages.

        Raises
        ------
        Error
            If the values do not fit together or a file cannot be read.
        """
        timings = [
            name for name in ("ramp", "corner_stops", "jerk_limits") if getattr(self, name) is not None
        ]
        if len(timings) > 1:
            raise ValueRangeError(f"{where}: give only one of {', '.join(timings)}")
        start = self._start(hand, where)
        with _within(f"{where}."):
            reference = self._shape(
                SpecStart(start, folder, where, self._given("position"), self._given("orientation"))
            )
        if self.repeat > 1:
            if (corners := self.repeat * len(reference.corners)) > _MOST_CORNERS:
                raise ValueRangeError(
                    f"{where}.repeat: makes {corners} corners, at most {_MOST_CORNERS} are allowed"
                )
            with _within(f"{where}.repeat: "):
                reference = shapes.Repeat(reference, self.repeat)
        if self.ramp is not None:
            with _within(f"{where}.ramp: "):
                reference = shapes.StartRamp(reference, self.ramp)
        if self.corner_stops is not None:
            with _within(f"{where}.corner_stops: "):
                reference = shapes.CornerStops(reference, self.corner_stops)
        if self.jerk_limits is not None:
            with _within(f"{where}.jerk_limits: "):
                reference = shapes.JerkLimited(reference, **msgspec.structs.asdict(self.jerk_limits))
        if self.transform is not None:
            by = self.transform
            turn = rotation_from(f"{where}.transform", by.quaternion, by.rpy)
            position = as_array(f"{where}.transform.position", by.position, (3,))
            reference = shapes.Transformed(
                reference, algebra.pose(_NO_TURN if turn is None else turn, position)
            )
        if self.preview is not None:
            reference = shapes.Previewed(reference, **msgspec.structs.asdict(self.preview))
        if self.touch is not None:
            with _within(f"{where}."):
                reference = shapes.OnTouchedPlane(reference, **msgspec.structs.asdict(self.touch))
        if isinstance(self.until, Until):  # the key of 'follow' is a time
            with _within(f"{where}."):
                reference = shapes.Guarded(reference, self.until.force, self.until.drop)
        return reference

    def of_robot(
        self,
        reference: shapes.Reference,
        robot: Robot,
        start: Array,
        world: World | None,
        kept: PreparedConstraints | None = None,
    ) -> shapes.Reference:
        """Return the reference that `build` returned, or what a robot at its start, in a world, makes of it."""
        return reference

    def _shape(self, start: SpecStart) -> shapes.Reference:
        """Return the reference before it is modified."""
        raise NotImplementedError

    def _start(self, hand: Array, where: str) -> Array:
        rotation, position = algebra.rotation(hand), algebra.translation(hand)
        if self.start.position is not None:
            position = as_array(f"{where}.start.position", self.start.position, (3,))
        turned = rotation_from(f"{where}.start", self.start.quaternion, self.start.rpy)
        rotation = rotation if turned is None else turned
        angle = as_array(f"{where}.offset.rotation", self.offset.rotation, (3,))
        turn = algebra.exp_body(np.concatenate([angle / 2, np.zeros(3)]))
        turned = algebra.multiply(turn, np.concatenate([rotation, np.zeros(4)]))[:4]
        moved = position + as_array(f"{where}.offset.translation", self.offset.translation, (3,))
        return algebra.pose(turned, moved)

    def _given(self, part: str) -> tuple[str, ...]:
        """Return the keys given that say where, its position, or how turned, its orientation, the reference starts."""
        keys, offset = _START_KEYS[part]
        given = [f"start.{key}" for key in keys if getattr(self.start, key) is not None]
        return (*given, *([f"offset.{offset}"] if any(getattr(self.offset, offset)) else []))


def rotation_from(field: str, quaternion: Quaternion | None, rpy: Vector | None) -> Array | None:
    """Return the unit quaternion that a spec gives as such or as roll, pitch and yaw; None if it gives neither."""
    if quaternion is not None and rpy is not None:
        raise ValueRangeError(f"{field}: has both 'quaternion' and 'rpy'; leave out one of them")
    if rpy is not None:
        return algebra.rotation_from_rpy(as_array(f"{field}.rpy", rpy, (3,)))
    return None if quaternion is None else algebra.as_unit_quaternion(f"{field}.quaternion", quaternion)


@contextmanager
def _within(prefix: str) -> Iterator[None]:
    """Put the field before the message of an error that names neither it nor a file."""
    try:
        yield
    except FileFormatError:
        raise
    except Error as error:
        if str(error).startswith(prefix):
            raise
        raise type(error)(f"{prefix}{error}") from None

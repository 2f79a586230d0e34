"""References as a spec describes them: one structure a kind."""

from __future__ import annotations

import dataclasses
import inspect
import math
import types
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, TypeAlias, get_type_hints

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import ArrayLike

from dqcontrol import algebra, references as shapes
from dqcontrol.algebra import pose, rotation, translation
from dqcontrol.arrays import Array
from dqcontrol.constraints.prepared_constraints import PreparedConstraints
from dqcontrol.errors import Error, FileFormatError, ShapeError, ValueRangeError, as_array, unknown_name
from dqcontrol.extensions.registry import registered, union_of
from dqcontrol.extensions.user_code import function_at, place_from
from dqcontrol.named_fields import NamedFields
from dqcontrol.planning import PlanTo
from dqcontrol.planning.drive_and_plan import StepsInTurn
from dqcontrol.planning.followed_path import followed
from dqcontrol.references.drive_to import PlannedWay
from dqcontrol.references.reference import SpecStart, Yaml
from dqcontrol.references.sample import as_pose
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
        timings = [key for key in ("ramp", "corner_stops", "jerk_limits") if getattr(self, key) is not None]
        if len(timings) > 1:
            raise ValueRangeError(f"{where}: give only one of {', '.join(timings)}")
        start = self._start(hand, where)
        given = self._given("position"), self._given("orientation")
        with _within(f"{where}."):
            reference = self._shape(SpecStart(start, folder, where, *given))
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
            moved = algebra.pose(_NO_TURN if turn is None else turn, position)
            reference = shapes.Transformed(reference, moved)
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
        if angle.any():
            turn = algebra.exp_body(np.concatenate([angle / 2, np.zeros(3)]))
            rotation = algebra.multiply(turn, np.concatenate([rotation, np.zeros(4)]))[:4]
        moved = position + as_array(f"{where}.offset.translation", self.offset.translation, (3,))
        return algebra.pose(rotation, moved)

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


__all__ = ["AnyReference", "Part"]


class SequenceSpec(ReferenceSpec, frozen=True, kw_only=True, tag="sequence"):
    """References one after the other; each starts where the one before it ends, unless it says otherwise."""

    references: Annotated[list[AnyReference], Meta(min_length=1)]

    @property
    def plans_around(self) -> bool:  # type: ignore[override] — of its parts
        """Whether one of its parts does."""
        return any(each.plans_around for each in self.references)

    def _shape(self, start: SpecStart) -> shapes.Reference:
        if self.plans_around:
            place = f"{start.place}.references".removeprefix("reference.")
            return _Unplanned(start.pose, 1.0, folder=start.folder, place=place)
        parts, hand = [], start.pose
        for i, each in enumerate(self.references):
            if parts and not math.isfinite(parts[-1].duration):
                raise ValueRangeError(
                    f"references[{i - 1}]: never ends, so nothing can follow it: give its duration"
                )
            parts.append(each.build(hand, start.folder, f"{start.place}.references[{i}]"))
            if math.isfinite(parts[-1].duration):
                hand = parts[-1].samples([parts[-1].duration])[0, :8]
        return shapes.Sequence(parts)

    def of_robot(
        self,
        reference: shapes.Reference,
        robot: Robot,
        start: Array,
        world: World | None,
        kept: PreparedConstraints | None = None,
    ) -> shapes.Reference:
        """Return all of it planned, each step from where the one before it ends, with what is in the hand then."""
        if not self.plans_around:
            return reference
        if not isinstance(reference, _Unplanned):
            raise ShapeError(
                "reference: what changes a motion belongs to steps of a sequence that is planned"
            )
        if kept is None:
            raise ValueRangeError("plan-to: is the reference of a law, and no further task's")
        turn = StepsInTurn(robot, kept, world, start)
        plans = [i for i, each in enumerate(self.references) if each.plans_around and i]
        for begin, end in pairwise([0, *plans, len(self.references)]):
            makes = [
                partial(_planned_step, each, reference.folder, f"{reference.place}[{i}]")
                for i, each in enumerate(self.references[begin:end], begin)
            ]
            turn.go(makes)
        return turn.way


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class _Unplanned(shapes.SetPoint):
    """A sequence before it is planned: its first pose, for any time."""

    folder: Path = Path()
    place: str = ""


def _planned_step(
    spec: ReferenceSpec,
    folder: Path,
    place: str,
    robot: Robot,
    q: Array,
    world: World | None,
    kept: PreparedConstraints,
) -> PlannedWay:
    """Return a step of a sequence from a configuration, (n,), on."""
    reference = spec.build(robot.fkm(q), folder, place)
    with _within(f"{place}: "):
        made = spec.of_robot(reference, robot, q, world, kept)
    return made if isinstance(made, PlannedWay) else followed(made, kept, q, place)


_Time = Annotated[float, Meta(ge=0, description="s; the last measurement counts from then on")]


class FollowSpec(ReferenceSpec, frozen=True, kw_only=True, tag="follow"):
    """A motion for where a body of the world stands, carried along to where that is measured; see `references.Follow`.

    Without ``reference`` the end effector stays at ``start`` with its ``offset``, relative to the body. ``taught`` is
    where the body was to be, its place in the world if omitted.
    """

    body: Annotated[str, Meta(min_length=1, description="of the world, with 'watch'")]
    reference: AnyReference | None = None
    duration: Annotated[float, Meta(gt=0, description="s, without 'reference'")] | None = None
    taught: Annotated[Vector | None, Meta(description="its position, m")] = None
    until: _Time | None = None  # pyright: ignore[reportIncompatibleVariableOverride]

    def _shape(self, start: SpecStart) -> shapes.Reference:
        if (self.reference is None) == (self.duration is None):
            raise ShapeError(
                "give either 'reference', the motion for the body, or 'duration' of staying at 'start'"
            )
        if self.reference is not None:
            inner = self.reference.build(start.pose, start.folder, f"{start.place}.reference")
        else:
            assert self.duration is not None
            inner = shapes.SetPoint(start.pose, duration=self.duration)
        return shapes.Follow(inner, self.body, _NOWHERE)

    def of_robot(
        self,
        reference: shapes.Reference,
        robot: Robot,
        start: Array,
        world: World | None,
        kept: PreparedConstraints | None = None,
    ) -> shapes.Reference:
        if not isinstance(reference, shapes.Follow):
            raise ShapeError("reference: what changes a motion belongs to that inside of 'follow'")
        bodies = {} if world is None else world.bodies
        if self.body not in bodies:
            raise unknown_name("reference.body", self.body, tuple(bodies))
        body = bodies[self.body]
        if body.watch is None:
            raise ValueRangeError(f"reference.body: nothing measures where '{self.body}' is; give it 'watch'")
        taught = body.pose if self.taught is None else pose(body.pose[:4], self.taught)
        inner = reference.reference
        if self.reference is not None:
            inner = self.reference.of_robot(inner, robot, start, world, kept)
        return shapes.Follow(inner, self.body, taught, math.inf if self.until is None else self.until)


_NOWHERE = (1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)  # until the world says where the body is


class OwnSpec(ReferenceSpec, frozen=True, kw_only=True, tag="own"):
    """A motion that a user's function makes: it takes the start pose, shape (8,), and the parameters by name."""

    function: Annotated[str, Meta(min_length=3, description="FILE.py:NAME or MODULE:NAME")]
    parameters: dict[str, Any] = {}

    def _shape(self, start: SpecStart) -> shapes.Reference:
        make = function_at("function", place_from(self.function, start.folder))
        try:
            made = make(start.pose, **self.parameters)
        except Error:
            raise
        except Exception as error:
            raise ValueRangeError(
                f"function: {self.function} raised {type(error).__name__}: {error}"
            ) from None
        if not isinstance(made, shapes.Reference):
            raise ShapeError(f"function: {self.function} must return a reference, got {made!r:.80}")
        return made


class ObjectSpec(ReferenceSpec, frozen=True, kw_only=True, tag="object"):
    """A reference that a Python program gave as an object: it cannot be made again from a file."""

    name: str
    token: str

    def _shape(self, start: SpecStart) -> shapes.Reference:
        if self.token not in _OBJECTS:
            raise ValueRangeError(
                f"reference: {self.name} was an object of the program that ran this; run that program again, or name "
                "a function that makes it: kind: own, function: FILE.py:NAME"
            )
        return _OBJECTS[self.token]


_OBJECTS: dict[str, shapes.Reference] = {}  # those of this process, by token


def reference_data(reference: shapes.Reference) -> dict[str, Any]:
    """Return what a spec says of a reference: its kind and parameters where it has a YAML form, else a token for it."""
    if (keys := reference.to_spec()) is not None:
        return {"kind": reference.kind, **keys, "start": _start_data(keys["start"])}
    token = f"{id(reference):x}"
    _OBJECTS[token] = reference
    return {"kind": "object", "name": repr(reference)[:200], "token": token}


def _start_data(pose: ArrayLike) -> dict[str, Any]:
    start = as_pose("start", pose)
    return {"position": translation(start), "quaternion": rotation(start)}


def _written(shape: type[shapes.Reference]) -> type[ReferenceSpec]:
    """Return the YAML form of a shape: the parameters of `Reference.from_spec`, beside what all references have."""
    makes = shape.from_spec.__func__
    is_constructor = makes is shapes.Reference.from_spec.__func__
    made_by: Any = shape if is_constructor else makes
    said = (made_by.__doc__ or "").partition("    Examples\n")[0]
    hints = get_type_hints(made_by, include_extras=True)
    # Of a constructor all parameters but the start, which all references have.
    fields = [
        each
        for each in inspect.signature(made_by).parameters.values()
        if (each.name != "start" if is_constructor else each.kind is each.KEYWORD_ONLY)
    ]
    names = [each.name for each in fields]

    def _shape(self: ReferenceSpec, start: SpecStart) -> shapes.Reference:
        return shape.from_spec(start, **{name: getattr(self, name) for name in names})

    def of_robot(self: Any, *given: Any) -> shapes.Reference:
        return shape.of_robot(*given, **{name: getattr(self, name) for name in names})

    contents = {
        "__doc__": said,
        "__module__": __name__,
        "__annotations__": {name: _form(hints[name]) for name in names},
        "_shape": _shape,
        "of_robot": of_robot,
        "plans_around": shape.plans_around,
        **{each.name: each.default for each in fields if each.default is not each.empty},
    }
    options = {"frozen": True, "kw_only": True, "forbid_unknown_fields": True, "tag": shape.kind}
    return types.new_class(
        f"{shape.__name__}Spec", (ReferenceSpec,), options, lambda body: body.update(contents)
    )


def _form(hint: Any) -> Any:
    """Return what a YAML file may hold for a type that takes more than that in Python."""
    return next((each.form for each in getattr(hint, "__metadata__", ()) if isinstance(each, Yaml)), hint)


def gripped_by_steps(reference: ReferenceSpec) -> set[str]:
    """Return the bodies that steps of a sequence grip."""
    if isinstance(reference, SequenceSpec):
        return set().union(*(gripped_by_steps(each) for each in reference.references))
    body = getattr(reference, "body", None)
    return {body} if body and reference.__struct_config__.tag == shapes.Grip.kind else set()


_PLANNED = PlanTo  # stands above the package of references: known by being imported here
for _shape in registered(shapes.Reference, "dqcontrol.references"):
    if vars(_shape).get("kind"):
        globals()[f"{_shape.__name__}Spec"] = _written(_shape)  # by this name, so that workers find it

if TYPE_CHECKING:
    AnyReference: TypeAlias = ReferenceSpec
else:
    AnyReference = union_of(ReferenceSpec)

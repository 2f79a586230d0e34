"""References as a spec describes them: one structure a kind."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias, get_type_hints

import msgspec
from msgspec import Meta
from numpy.typing import ArrayLike

from dqcontrol import references as shapes
from dqcontrol.algebra import rotation, translation
from dqcontrol.arrays import Array
from dqcontrol.errors import Error, ShapeError, ValueRangeError
from dqcontrol.experiments.spec.reference_base import Part, ReferenceSpec
from dqcontrol.extensions.registry import registered, union_of
from dqcontrol.extensions.user_code import function_at, place_from
from dqcontrol.files.text_file import read_text
from dqcontrol.references.sample import as_pose
from dqcontrol.references.yaml_form import Yaml
from dqcontrol.robots import Robot

__all__ = ["AnyReference", "Part"]


class SetPointSpec(ReferenceSpec, frozen=True, kw_only=True, tag="set-point"):
    """Rest at the start pose, without end or for a given duration."""

    duration: Annotated[float, Meta(gt=0, description="s")] | None = None

    def _shape(self, start: Array, folder: Path, where: str) -> shapes.Reference:
        return shapes.SetPoint(start, math.inf if self.duration is None else self.duration)


class DriveToSpec(ReferenceSpec, frozen=True, kw_only=True, tag="drive-to"):
    """Go with the whole robot to the pose that ``start`` and ``offset`` say; see `dqcontrol.references.DriveTo`."""

    speed_fraction: Annotated[float, Meta(gt=0, le=1, description="of the velocity limits")] = 0.5

    def of_robot(self, reference: shapes.Reference, robot: Robot, start: Array) -> shapes.Reference:
        """Return the way from the start configuration to the reference's pose."""
        return shapes.DriveTo.pose(robot, start, reference.at(0.0).pose, self.speed_fraction)

    def _shape(self, start: Array, folder: Path, where: str) -> shapes.Reference:
        if where != "reference":
            raise ValueRangeError(
                f"{where}: drive-to starts where the robot does, so it is no part of a sequence"
            )
        return shapes.SetPoint(start)


class DrawingSpec(ReferenceSpec, frozen=True, kw_only=True, tag="drawing"):
    """Follow a drawing file; see `dqcontrol.references.load_drawing`."""

    file: Annotated[str, Meta(min_length=1, description="path, relative to the spec")]

    def _shape(self, start: Array, folder: Path, where: str) -> shapes.Reference:
        file = shapes.parse_drawing(read_text(folder / self.file), str(folder / self.file))
        if file.position is not None:
            self._refuse(0, where, folder / self.file, "where it starts")
        if file.rotation is not None:
            self._refuse(1, where, folder / self.file, "how the hand is turned")
        return file.drawing(start)


class PointsSpec(ReferenceSpec, frozen=True, kw_only=True, tag="points"):
    """Run from pose to pose of a file; see `dqcontrol.references.load_points`."""

    file: Annotated[str, Meta(min_length=1, description="path, relative to the spec")]
    duration: Annotated[float, Meta(gt=0, description="s")] | None = None

    def _shape(self, start: Array, folder: Path, where: str) -> shapes.Reference:
        return self._points(start, folder, where)

    def _points(self, start: Array, folder: Path, where: str) -> shapes.Points:
        file = folder / self.file
        self._refuse(0, where, file, "where it starts")
        if self._moves(1):
            try:
                shapes.load_points(file, duration=self.duration)
            except ValueRangeError:  # it has no orientations: those of the start are needed
                return shapes.load_points(file, start, self.duration)
            self._refuse(1, where, file, "how the hand is turned")
        return shapes.load_points(file, start, self.duration)


class ViaPointsSpec(PointsSpec, frozen=True, kw_only=True, tag="via-points"):
    """Run smoothly through the poses of a file; see `dqcontrol.references.ViaPoints`."""

    def _shape(self, start: Array, folder: Path, where: str) -> shapes.Reference:
        points = self._points(start, folder, where)
        return shapes.ViaPoints(points.times, points.poses)


class SequenceSpec(ReferenceSpec, frozen=True, kw_only=True, tag="sequence"):
    """References one after the other; each starts where the one before it ends, unless it says otherwise."""

    references: Annotated[list[AnyReference], Meta(min_length=1)]

    def _shape(self, start: Array, folder: Path, where: str) -> shapes.Reference:
        parts, hand = [], start
        for i, each in enumerate(self.references):
            if parts and not math.isfinite(parts[-1].duration):
                raise ValueRangeError(
                    f"references[{i - 1}]: never ends, so nothing can follow it: give its duration"
                )
            parts.append(each.build(hand, folder, f"{where}.references[{i}]"))
            if math.isfinite(parts[-1].duration):
                hand = parts[-1].samples([parts[-1].duration])[0, :8]
        return shapes.Sequence(parts)


class OwnSpec(ReferenceSpec, frozen=True, kw_only=True, tag="own"):
    """A motion that a user's function makes: it takes the start pose, shape (8,), and the parameters by name."""

    function: Annotated[str, Meta(min_length=3, description="FILE.py:NAME or MODULE:NAME")]
    parameters: dict[str, Any] = {}

    def _shape(self, start: Array, folder: Path, where: str) -> shapes.Reference:
        make = function_at("function", place_from(self.function, folder))
        try:
            made = make(start, **self.parameters)
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

    def _shape(self, start: Array, folder: Path, where: str) -> shapes.Reference:
        if self.token not in _OBJECTS:
            raise ValueRangeError(
                f"reference: {self.name} was an object of the program that ran this; run that program again, or name "
                "a function that makes it: kind: own, function: FILE.py:NAME"
            )
        return _OBJECTS[self.token]


_OBJECTS: dict[str, shapes.Reference] = {}  # those of this process, by token


def reference_data(reference: shapes.Reference) -> dict[str, Any]:
    """Return what a spec says of a reference: its kind and parameters where it has a YAML form, else a token for it."""
    if isinstance(reference, shapes.SetPoint):
        lasts = {"duration": reference.duration} if math.isfinite(reference.duration) else {}
        return {"kind": "set-point", "start": _start_data(reference.pose), **lasts}
    if reference.kind:  # a dataclass whose fields are the keys
        names = [each.name for each in dataclasses.fields(reference) if each.init]  # type: ignore[arg-type]
        values = {name: getattr(reference, name) for name in names}
        return {"kind": reference.kind, **values, "start": _start_data(values["start"])}
    token = f"{id(reference):x}"
    _OBJECTS[token] = reference
    return {"kind": "object", "name": repr(reference)[:200], "token": token}


def _start_data(pose: ArrayLike) -> dict[str, Any]:
    start = as_pose("start", pose)
    return {"position": translation(start), "quaternion": rotation(start)}


def _written(shape: type[shapes.Reference]) -> type[ReferenceSpec]:
    """Return the YAML form of a shape that is its constructor: its fields but ``start``, which all references have."""
    hints = get_type_hints(shape, include_extras=True)
    fields = [
        (each.name, _form(hints[each.name]))
        if each.default is dataclasses.MISSING
        else (each.name, _form(hints[each.name]), each.default)
        for each in dataclasses.fields(shape)  # type: ignore[arg-type]
        if each.init and each.name != "start"
    ]

    def _shape(self: ReferenceSpec, start: Array, folder: Path, where: str) -> shapes.Reference:
        return shape(start, **{name[0]: getattr(self, name[0]) for name in fields})  # type: ignore[call-arg]

    return msgspec.defstruct(  # type: ignore[return-value] — a subclass of its bases
        f"{shape.__name__}Spec",
        fields,
        bases=(ReferenceSpec,),
        module=__name__,
        namespace={"__doc__": f"See `dqcontrol.references.{shape.__name__}`.", "_shape": _shape},
        frozen=True,
        kw_only=True,
        forbid_unknown_fields=True,
        tag=shape.kind,
    )


def _form(hint: Any) -> Any:
    """Return what a YAML file may hold for a type that takes more than that in Python."""
    return next((each.form for each in getattr(hint, "__metadata__", ()) if isinstance(each, Yaml)), hint)


for _shape in registered(shapes.Reference, "dqcontrol.references"):
    if _shape.kind:
        globals()[f"{_shape.__name__}Spec"] = _written(_shape)  # by this name, so that workers find it

if TYPE_CHECKING:
    AnyReference: TypeAlias = ReferenceSpec
else:
    AnyReference = union_of(ReferenceSpec)

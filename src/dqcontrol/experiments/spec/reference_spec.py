"""References as a spec describes them: one structure a kind."""

from __future__ import annotations

import dataclasses
import inspect
import math
import types
from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias, get_type_hints

from msgspec import Meta
from numpy.typing import ArrayLike

from dqcontrol import references as shapes
from dqcontrol.algebra import pose, rotation, translation
from dqcontrol.arrays import Array
from dqcontrol.constraints.prepared_constraints import PreparedConstraints
from dqcontrol.errors import Error, ShapeError, ValueRangeError, unknown_name
from dqcontrol.experiments.spec.reference_base import Part, ReferenceSpec, Vector
from dqcontrol.extensions.registry import registered, union_of
from dqcontrol.extensions.user_code import function_at, place_from
from dqcontrol.planning import PlanTo
from dqcontrol.references.sample import as_pose
from dqcontrol.references.yaml_form import SpecStart, Yaml
from dqcontrol.robots import Robot
from dqcontrol.world import World

__all__ = ["AnyReference", "Part"]


class SequenceSpec(ReferenceSpec, frozen=True, kw_only=True, tag="sequence"):
    """References one after the other; each starts where the one before it ends, unless it says otherwise."""

    references: Annotated[list[AnyReference], Meta(min_length=1)]

    def _shape(self, start: SpecStart) -> shapes.Reference:
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
    fields = _fields_of_constructor(shape) if is_constructor else _fields_of_function(makes)
    names = [name for name, *_ in fields]
    said = ((shape if is_constructor else makes).__doc__ or "").partition("    Examples\n")[0]

    def _shape(self: ReferenceSpec, start: SpecStart) -> shapes.Reference:
        return shape.from_spec(start, **{name: getattr(self, name) for name in names})

    def of_robot(
        self: Any,
        reference: shapes.Reference,
        robot: Robot,
        start: Array,
        world: World | None,
        kept: PreparedConstraints | None = None,
    ) -> shapes.Reference:
        given = {name: getattr(self, name) for name in names}
        return shape.of_robot(reference, robot, start, world, kept, **given)

    contents = {
        "__doc__": said,
        "__module__": __name__,
        "__annotations__": {name: kind for name, kind, *_ in fields},
        "_shape": _shape,
        "of_robot": of_robot,
        "plans_around": shape.plans_around,
        **{name: default for name, _, *rest in fields for default in rest},
    }
    options = {"frozen": True, "kw_only": True, "forbid_unknown_fields": True, "tag": shape.kind}
    return types.new_class(
        f"{shape.__name__}Spec", (ReferenceSpec,), options, lambda body: body.update(contents)
    )


def _fields_of_constructor(shape: type[shapes.Reference]) -> list[tuple[Any, ...]]:
    """Return names, types and defaults of a dataclass, but ``start``, which all references have."""
    hints = get_type_hints(shape, include_extras=True)
    return [
        (each.name, _form(hints[each.name]), *([] if each.default is dataclasses.MISSING else [each.default]))
        for each in dataclasses.fields(shape)  # type: ignore[arg-type]
        if each.init and each.name != "start"
    ]


def _fields_of_function(makes: Callable[..., Any]) -> list[tuple[Any, ...]]:
    """Return names, types and defaults of a function's keyword-only parameters."""
    hints = get_type_hints(makes, include_extras=True)
    return [
        (name, _form(hints[name]), *([] if each.default is each.empty else [each.default]))
        for name, each in inspect.signature(makes).parameters.items()
        if each.kind is each.KEYWORD_ONLY
    ]


def _form(hint: Any) -> Any:
    """Return what a YAML file may hold for a type that takes more than that in Python."""
    return next((each.form for each in getattr(hint, "__metadata__", ()) if isinstance(each, Yaml)), hint)


_PLANNED = PlanTo  # stands above the package of references: known by being imported here
for _shape in registered(shapes.Reference, "dqcontrol.references"):
    if vars(_shape).get("kind"):
        globals()[f"{_shape.__name__}Spec"] = _written(_shape)  # by this name, so that workers find it

if TYPE_CHECKING:
    AnyReference: TypeAlias = ReferenceSpec
else:
    AnyReference = union_of(ReferenceSpec)

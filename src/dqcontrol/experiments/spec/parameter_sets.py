"""Laws with the parameters of named sets and of grids."""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any, Generic, TypeVar

import msgspec
from msgspec import Meta

from dqcontrol.errors import FileFormatError, ShapeError, ValueRangeError, suggest, unknown_name
from dqcontrol.files.yaml_file import convert
from dqcontrol.laws import Law

L = TypeVar("L", bound=Law)

Label = Annotated[
    str,
    Meta(
        pattern=r"^(?![._])[^/\\$\x00-\x1f]{1,60}\Z",  # figures would take $…$ for a formula, and hide _…
        description="labels of at most 60 characters without /, \\ and $, not beginning with a dot or _",
    ),
]
Changes = dict[str, Any]

_MOST = 100_000  # sets of one law


@dataclass(frozen=True)
class Variant(Generic[L]):
    """A law with one set of parameters.

    Attributes
    ----------
    label
        Of the law.
    set
        Label of the parameter set; empty if there is only one.
    law
        With the set's parameters.
    point
        Where a grid of this law has its keys: numbers, or texts in JSON. None for those of other laws' grids.
    """

    label: str
    set: str
    law: L
    point: dict[str, float | str | None] = field(default_factory=dict)


def variants(
    laws: Mapping[str, L],
    sets: Mapping[str, Mapping[str, Changes]] | None,
    grids: Mapping[str, Mapping[str, Sequence[Any]]] | None,
) -> list[Variant[L]]:
    """Return every law with every set of parameters that it runs with.

    Parameters
    ----------
    laws
        By label.
    sets
        By the set's label the laws that run in it, each with the keys that differ from ``laws``. Without it there is
        one set with all laws that have no grid.
    grids
        By law and key the values to combine.

    Raises
    ------
    UnknownNameError
        If a set or grid names a law that does not exist.
    ShapeError
        If a law has both sets and a grid, or two values of a grid the same label.
    FileFormatError
        If a law has no such key, or the value does not fit it.
    ValueRangeError
        If a grid has too many combinations.
    """
    grids = grids or {}
    for law in grids:
        _check_law(f"grids.{law}", law, laws)
    if sets is None:
        sets = {"": {law: {} for law in laws if law not in grids}}
    found = []
    for name, chosen in sets.items():
        for law, changes in chosen.items():
            _check_law(f"parameter_sets.{name}", law, laws)
            if law in grids:
                raise ShapeError(
                    f"parameter_sets.{name}.{law}: the law has a grid too; give it sets or a grid"
                )
            found.append(Variant(law, name, _changed(f"parameter_sets.{name}.{law}", laws[law], changes)))
    for law, grid in grids.items():
        found += _grid(law, laws[law], grid)
    return _with_points(found, grids)


def _check_law(where: str, law: str, laws: Mapping[str, Any]) -> None:
    if law not in laws:
        raise unknown_name(where, law, laws)


def _changed(where: str, law: L, changes: Changes) -> L:
    if not changes:
        return law
    data = msgspec.to_builtins(law)
    for key, value in changes.items():
        inner, names = data, key.split(".")
        for name in names[:-1]:
            inner = inner.get(name) if isinstance(inner, dict) else None
        if not isinstance(inner, dict) or (len(names) > 1 and names[-1] not in inner):
            near = suggest(names[-1], inner) if isinstance(inner, dict) else ""
            raise FileFormatError(f"{where}: the law has no '{key}' to change{near}")
        inner[names[-1]] = value
    return convert(where, data, type(law))


def _value(law: Law, key: str) -> Any:
    """Return a law's key, with dots for those inside others, as plain data."""
    value = msgspec.to_builtins(law)
    for name in key.split("."):
        value = value[name]
    return value


def _grid(label: str, law: L, grid: Mapping[str, Sequence[Any]]) -> list[Variant[L]]:
    count = math.prod(map(len, grid.values()))
    if count > _MOST:
        raise ValueRangeError(f"grids.{label}: makes {count:,} parameter sets; at most {_MOST:,}")
    named = [
        [(f"{key}={_short(value, i)}", key, value) for i, value in enumerate(values)]
        for key, values in grid.items()
    ]
    for key, values in zip(grid, named, strict=True):
        names = [name for name, _, _ in values]
        if twin := next((name for name in names if names.count(name) > 1), None):
            raise ShapeError(f"grids.{label}.{key}: two values are called '{twin}'")
    return [
        Variant(
            label,
            " ".join(name for name, _, _ in point),
            _changed(f"grids.{label}", law, {key: value for _, key, value in point}),
        )
        for point in itertools.product(*named)
    ]


def _short(value: Any, index: int) -> str:
    """Return a value as part of a label; what is no number or word is named by its place in the list."""
    if isinstance(value, int | float):
        return f"{value:.12g}"
    return value if isinstance(value, str) else f"#{index + 1}"


def _with_points(
    found: list[Variant[L]], grids: Mapping[str, Mapping[str, Sequence[Any]]]
) -> list[Variant[L]]:
    """Return the variants with their places in the grids; a key has either numbers or texts in all of them."""
    points: list[dict[str, float | str | None]] = [{} for _ in found]
    for key in dict.fromkeys(key for grid in grids.values() for key in grid):
        values = [_value(each.law, key) if key in grids.get(each.label, ()) else None for each in found]
        numeric = all(value is None or isinstance(value, int | float) for value in values)
        for point, value in zip(points, values, strict=True):
            if value is not None and not numeric:
                value = json.dumps(value, ensure_ascii=False)
            point[key] = float(value) if numeric and value is not None else value
    return [Variant(each.label, each.set, each.law, point) for each, point in zip(found, points, strict=True)]

"""The types and units of a spec's keys, as their descriptions say, and numbers written with a unit."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from functools import cache
from typing import Any

from msgspec import inspect

from dqcontrol.errors import FileFormatError
from dqcontrol.files.units import as_quantity, unsaid_unit

_UNIT = re.compile(r"(1/)?(s|m|rad|kg|Hz|N|N·m)[²³]?(/(s|m|rad)[²³]?)?( or (m|N)(/(s|m)[²³]?)?)?")

Kinds = list[inspect.Type]


def kinds_below(kinds: Kinds, path: str) -> Kinds:
    """Return the types that a key with dots, as ``law.gain`` or ``laws.*.gain``, leads to from some types."""
    for part in path.split("."):
        kinds = [inner for kind in kinds for inner in _below(kind, part)]
    return kinds


def unit_in(kinds: Kinds) -> str:
    """Return the unit that the descriptions of types give; empty where there is none, or they disagree."""
    descriptions = (text for kind in kinds for text in _descriptions(kind))
    units = {text.partition(";")[0].rpartition(", ")[2] for text in descriptions}
    if any(" … " in unit for unit in units):  # a share: no unit, whatever others of that name have
        return ""
    widest = max((unit for unit in units if _UNIT.fullmatch(unit)), key=len, default="")
    return widest if all(unit in widest for unit in units if _UNIT.fullmatch(unit)) else ""


@cache
def kinds_of(schema: Any) -> tuple[inspect.Type, ...]:
    """Return the type of a structure, as what `kinds_below` starts from."""
    return (inspect.type_info(schema),)


def numbers_for_quantities(where: str, data: Any, kinds: Kinds, field: str = "") -> Any:
    """Return plain data with a number in SI units for each text like ``-88.6 deg`` where a number is expected.

    Parameters
    ----------
    where
        File, for messages.
    data
        Plain data.
    kinds
        The types that it may have.
    field
        Its key in the file, for messages.

    Raises
    ------
    FileFormatError
        If a key has another unit, or a number without one needs it, as angles of more than a turn do.
    """

    def number(value: Any, inner: list[tuple[inspect.Type, str]], kinds: Kinds, field: str) -> Any:
        if not isinstance(value, str):
            if asked := unsaid_unit(_name(field), value, unit_in(kinds)):
                raise FileFormatError(f"{where}: {field}: {asked}")
            return value
        takes_text = (inspect.StrType, inspect.AnyType, inspect.LiteralType)
        if any(isinstance(kind, takes_text) for kind, _ in inner):
            return value
        quantity, unit = as_quantity(value) or (0.0, "")
        expected = unit_in(kinds)
        if unit == "Hz" and quantity > 0 and _name(field) == "period":
            quantity, unit = 1 / quantity, "s"
        if unit not in expected.split(" or "):
            wanted = f"a number in {expected}" if expected else "a number without a unit"
            raise FileFormatError(f"{where}: {field}: expected {wanted}, got '{value}'")
        return quantity

    return _with_numbers(data, kinds, field, number)


def quantities_for_numbers(data: Any, kinds: Kinds, field: str = "") -> Any:
    """Return plain data with a unit where `numbers_for_quantities` asks for one, so that it can be read again."""

    def quantity(value: Any, _: list[tuple[inspect.Type, str]], kinds: Kinds, field: str) -> Any:
        if isinstance(value, str) or not unsaid_unit(_name(field), value, unit := unit_in(kinds)):
            return value
        return f"{value!r} {unit.partition(' or ')[0]}"

    return _with_numbers(data, kinds, field, quantity)


def _with_numbers(data: Any, kinds: Kinds, field: str, replaced: Callable[..., Any]) -> Any:
    """Return plain data with another value for each number, and each text like ``60 mm``, where one is expected."""
    if not _has_number(data):
        return data
    inner = [each for kind in kinds for each in _alternatives(kind, "")]
    if isinstance(data, dict):
        structs = [kind for kind, _ in inner if isinstance(kind, inspect.StructType)]
        named = [kind for kind in structs if kind.tag_field and data.get(kind.tag_field) == kind.tag]
        out = {}
        for key, value in data.items():
            fields = [f.type for s in named or structs for f in s.fields if f.encode_name == key]
            fields += [kind.value_type for kind, _ in inner if isinstance(kind, inspect.DictType)]
            out[key] = _with_numbers(value, fields, f"{field}.{key}" if field else str(key), replaced)
        return out
    if isinstance(data, list):
        return [
            _with_numbers(
                value, [e for kind, unit in inner for e in _items(kind, unit, i)], f"{field}[{i}]", replaced
            )
            for i, value in enumerate(data)
        ]
    wants_number = any(isinstance(kind, inspect.FloatType | inspect.IntType) for kind, _ in inner)
    return replaced(data, inner, list(kinds), field) if wants_number else data


def _has_number(data: Any) -> bool:
    """Whether there is a text like ``60 mm``, or a number that is not small, in plain data."""
    if isinstance(data, dict):
        return any(map(_has_number, data.values()))
    if isinstance(data, list):
        return any(map(_has_number, data))
    if isinstance(data, str):
        return as_quantity(data) is not None
    return isinstance(data, float | int) and not isinstance(data, bool) and abs(data) > 1


def _name(field: str) -> str:
    """Return the last key of a field, as ``rpy`` of ``start.rpy[2]`` and of a range's ``start.rpy.2.low``."""
    names = [name.partition("[")[0] for name in field.split(".")]
    return next(
        (name for name in reversed(names) if not name.isdecimal() and name not in ("low", "high")), ""
    )


def _alternatives(kind: inspect.Type, unit: str) -> Iterator[tuple[inspect.Type, str]]:
    """Give the plain types that a type allows, each with the description around it."""
    if isinstance(kind, inspect.Metadata):
        yield from _alternatives(kind.type, str((kind.extra_json_schema or {}).get("description", unit)))
    elif isinstance(kind, inspect.UnionType):
        for each in kind.types:
            yield from _alternatives(each, unit)
    else:
        yield kind, unit


def _items(kind: inspect.Type, description: str, i: int) -> Iterator[inspect.Type]:
    """Give the types of a list's entry; what describes the list describes it too."""
    if isinstance(kind, inspect.TupleType):
        inner = kind.item_types[i] if i < len(kind.item_types) else None
    else:
        inner = getattr(kind, "item_type", None)
    if inner is not None:
        schema = {"description": description} if description else None
        yield inspect.Metadata(inner, extra_json_schema=schema) if schema else inner


def _below(kind: inspect.Type, part: str) -> Iterator[inspect.Type]:
    """Give the types of what a key, or the number of an entry, leads to."""
    for plain, description in _alternatives(kind, ""):
        if isinstance(plain, inspect.DictType):
            yield plain.value_type
        elif isinstance(plain, inspect.StructType):
            yield from (field.type for field in plain.fields if field.encode_name == part)
        elif part.isdecimal():
            yield from _items(plain, description, int(part))


def _descriptions(kind: inspect.Type) -> Iterator[str]:
    """Give the descriptions of a type and of those that it unites."""
    if isinstance(kind, inspect.Metadata):
        if kind.extra_json_schema:
            yield str(kind.extra_json_schema.get("description", ""))
        yield from _descriptions(kind.type)
    elif isinstance(kind, inspect.UnionType):
        for each in kind.types:
            yield from _descriptions(each)

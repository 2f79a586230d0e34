"""The types and units of a spec's keys, as their descriptions say, and numbers written with a unit."""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import cache
from typing import Any

from msgspec import inspect

from dqcontrol.errors import FileFormatError
from dqcontrol.files.units import as_quantity

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
        If a key has another unit.
    """
    if not _has_quantity(data):
        return data
    inner = [each for kind in kinds for each in _alternatives(kind, "")]
    if isinstance(data, dict):
        structs = [kind for kind, _ in inner if isinstance(kind, inspect.StructType)]
        named = [kind for kind in structs if kind.tag_field and data.get(kind.tag_field) == kind.tag]
        out = {}
        for key, value in data.items():
            fields = [f.type for s in named or structs for f in s.fields if f.encode_name == key]
            fields += [kind.value_type for kind, _ in inner if isinstance(kind, inspect.DictType)]
            out[key] = numbers_for_quantities(where, value, fields, f"{field}.{key}" if field else str(key))
        return out
    if isinstance(data, list):
        return [
            numbers_for_quantities(
                where, value, [e for kind, unit in inner for e in _items(kind, unit, i)], f"{field}[{i}]"
            )
            for i, value in enumerate(data)
        ]
    wants_number = any(isinstance(kind, inspect.FloatType | inspect.IntType) for kind, _ in inner)
    takes_text = any(
        isinstance(kind, inspect.StrType | inspect.AnyType | inspect.LiteralType) for kind, _ in inner
    )
    if not wants_number or takes_text:
        return data
    value, unit = as_quantity(data) or (0.0, "")
    expected = unit_in(list(kinds))
    if unit == "Hz" and value > 0 and field.rpartition(".")[2] == "period":
        value, unit = 1 / value, "s"
    if unit not in expected.split(" or "):
        wanted = f"a number in {expected}" if expected else "a number without a unit"
        raise FileFormatError(f"{where}: {field}: expected {wanted}, got '{data}'")
    return value


def _has_quantity(data: Any) -> bool:
    if isinstance(data, dict):
        return any(map(_has_quantity, data.values()))
    if isinstance(data, list):
        return any(map(_has_quantity, data))
    return isinstance(data, str) and as_quantity(data) is not None


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

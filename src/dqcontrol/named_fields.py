"""A `msgspec.Struct` that checks what it is made of, and whose fields are given by name.

msgspec checks types and bounds only of what it reads; a constructor takes anything. These check the same declarations
in Python, with the messages that a spec gets.
"""

from __future__ import annotations

import functools
import math
import re
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any, get_args, get_type_hints

import msgspec
import numpy as np

from dqcontrol.errors import ShapeError, UnknownNameError, ValueRangeError, suggest

Three = tuple[float, float, float]  # along x, y and z

if TYPE_CHECKING:
    from msgspec import Struct as CheckedFields, Struct as NamedFields
else:

    class _CheckedFieldsType(type(msgspec.Struct)):
        def __call__(cls, *positional: Any, **named: Any) -> Any:
            """Make an object; a value of another type or beyond its bounds is a `ValueRangeError` that names it."""
            check_fields(cls, dict(zip(cls.__struct_fields__, positional, strict=False)) | named)
            return super().__call__(*positional, **named)

    class _NamedFieldsType(_CheckedFieldsType):
        def __call__(cls, *positional: Any, **named: Any) -> Any:
            """Make an object; a wrong, missing or nameless field is a `TypeError` that lists those there are."""
            if fault := _fault(cls, positional, named):
                raise TypeError(fault)
            return super().__call__(*positional, **named)

    def _fault(cls: Any, positional: tuple[Any, ...], named: dict[str, Any]) -> str:
        """Say what is wrong with how fields are given; nothing if that is not it."""
        names, required = _names(cls)
        if not positional and named.keys() <= set(names) and all(name in named for name in required):
            return ""
        listed = f" ({cls.__name__} has: {', '.join(names) or 'none'})"
        if positional:
            given = f"{cls.__name__}({names[0]}={positional[0]!r:.40})" if names else f"{cls.__name__}()"
            return f"{cls.__name__}({positional[0]!r:.40}): give parameters by name, as {given}{listed}"
        for name in named:
            if name not in names:
                return f"{cls.__name__}: unknown parameter '{name}'{suggest(name, names)}{listed}"
        missing = [name for name in required if name not in named]
        return f"{cls.__name__}: give {' and '.join(missing)}{listed}"

    @functools.cache
    def _names(cls: Any) -> tuple[list[str], list[str]]:
        """Return the names of all fields, required ones first, and of those."""
        required = [each.name for each in msgspec.structs.fields(cls) if each.required]
        return sorted(cls.__struct_fields__, key=required.__contains__, reverse=True), required

    class CheckedFields(msgspec.Struct, metaclass=_CheckedFieldsType):
        """Base of the public data classes whose fields may be given by place."""

    class NamedFields(msgspec.Struct, metaclass=_NamedFieldsType):
        """Base of the public data classes whose fields have names only."""


_hints = functools.cache(functools.partial(get_type_hints, include_extras=True))


def check_fields(cls: Any, values: Mapping[str, Any]) -> None:
    """Raise unless values fit the types and bounds that a class declares for them.

    Raises
    ------
    ValueRangeError
        If a number is beyond its bounds or not finite.
    UnknownNameError
        If a name is none of those declared.
    ShapeError
        If a value is of another type or length.
    """
    hints = _hints(cls)
    for name, value in values.items():
        if hints.get(name) in (None, type(None)):
            continue  # who prepares it says why it takes none
        if value is msgspec.UNSET and msgspec.UnsetType in get_args(hints[name]):
            continue  # a default, which a copy in another process is made of; msgspec itself reads it from no value
        plain = _plain(value)
        for place, number in _numbers(plain):
            if not math.isfinite(number):
                raise ValueRangeError(f"{_key(cls)}{name}{place}: must be finite, got {number}")
        try:
            msgspec.convert(plain, hints[name])
        except msgspec.ValidationError as error:
            _refuse(cls, name, plain, str(error))


def _refuse(cls: Any, name: str, value: Any, message: str) -> None:
    """Raise msgspec's error as ours."""
    from dqcontrol.files.yaml_file import reworded, structs_in  # in errors alone: they take yaml

    names = dict.fromkeys(each.__name__ for each in structs_in([_hints(cls)[name]]))
    kinds = " or ".join(names) or "a mapping"
    expected, got, given = reworded(message, {name: value}, cls, name).partition(", got ")
    text = f"{_key(cls)}{expected.replace('a mapping', kinds)}{got}{given}"
    if "unknown name" in text or "unknown key" in text:
        raise UnknownNameError(text) from None
    if bound := re.search(r"expected a (?:whole )?number ([<>]=?) ([-+.e\d]+), got (.*)", text):
        sign = {">=": "≥", "<=": "≤"}.get(bound[1], bound[1])
        wrong = f"must be {sign} {float(bound[2]):g}, got {bound[3].removesuffix('.0')}"
        raise ValueRangeError(text[: bound.start()] + wrong) from None
    raise ShapeError(text) from None


def _key(cls: Any) -> str:
    """Return where a class's fields stand in a spec, as ``plant.``, by which messages name them."""
    return f"{cls.spec_key}." if hasattr(cls, "spec_key") else ""


def _numbers(value: Any, place: str = "") -> Iterator[tuple[str, float]]:
    """Find all numbers in lists of lists, and where they stand."""
    if isinstance(value, float):
        yield place, value
    elif isinstance(value, list):
        for i, each in enumerate(value):
            yield from _numbers(each, f"{place}[{i}]")


def _plain(value: Any) -> Any:
    """Return a value without NumPy's types, which msgspec does not take for numbers and lists."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value]
    return {key: _plain(each) for key, each in value.items()} if isinstance(value, dict) else value

"""YAML files read strictly into typed structures, with errors that name the file and the field."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, TypeVar, get_args, get_type_hints

import msgspec
import yaml
from yaml.composer import ComposerError
from yaml.constructor import ConstructorError

from dqcontrol.errors import FileFormatError, suggest

T = TypeVar("T")

_MERGED = "aliases are not read here; write the value out"


def read_yaml(path: str | Path, schema: type[T]) -> T:
    """Read a YAML file into a structure.

    Parameters
    ----------
    path
        UTF-8 file.
    schema
        A `msgspec.Struct` class; give it ``forbid_unknown_fields=True``.

    Raises
    ------
    FileFormatError
        If the file is missing, is no YAML, repeats a key, or does not fit the schema: ``path: field: …``.
    """
    return convert(path, parse_yaml(path, read_text(path)), schema)


def read_text(path: str | Path) -> str:
    """Return the text of a UTF-8 file."""
    try:
        return Path(path).read_bytes().decode("utf-8-sig")
    except OSError as error:
        raise FileFormatError(f"{path}: cannot be read: {error.strerror or error}") from None
    except UnicodeDecodeError as error:
        raise FileFormatError(f"{path}: is not UTF-8 text ({error.reason} at byte {error.start})") from None


def parse_yaml(path: str | Path, text: str) -> Any:
    """Return the plain data of one YAML document; ``path`` is for the messages.

    Only finite numbers are allowed, keys may not repeat, and ``1e-3`` is a number (YAML 1.1 calls it text).
    """
    try:
        data = yaml.load(text, Loader=_StrictLoader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = f":{mark.line + 1}" if mark else ""
        raise FileFormatError(f"{path}{line}: {error.problem or error.context}") from None
    except yaml.YAMLError as error:  # a character that YAML excludes
        raise FileFormatError(f"{path}: {' '.join(str(error).split())}") from None
    except RecursionError:
        raise FileFormatError(f"{path}: is nested too deeply") from None
    except ValueError as error:  # a date or integer that Python cannot hold
        raise FileFormatError(f"{path}: {error}") from None
    for field, number in _numbers(data):
        if not math.isfinite(number):
            raise FileFormatError(f"{path}: {field}: must be finite, got {number}")
    return data


def convert(path: str | Path, data: Any, schema: type[T]) -> T:
    """Return plain data as a structure; ``path`` is for the messages."""
    try:
        return msgspec.convert(data, schema)
    except msgspec.ValidationError as error:
        raise FileFormatError(f"{path}: {_reworded(str(error), data, schema)}") from None


class _StrictLoader(yaml.SafeLoader):
    """Safe loading without repeated keys and without aliases, which can grow a small file to any size."""

    def compose_node(self, parent: Any, index: Any) -> Any:
        if self.check_event(yaml.AliasEvent):
            raise ComposerError(None, None, _MERGED, self.peek_event().start_mark)
        return super().compose_node(parent, index)

    def construct_mapping(self, node: Any, deep: bool = False) -> Any:
        seen = set()
        for key_node, _ in node.value:
            key = key_node.value if isinstance(key_node, yaml.ScalarNode) else None
            if key in seen:
                raise ConstructorError(None, None, f"key '{key}' appears twice", key_node.start_mark)
            seen.add(key)
        return super().construct_mapping(node, deep)


_StrictLoader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"^[-+]?[0-9][0-9_]*(\.[0-9_]*)?[eE][-+]?[0-9]+$"),
    list("-+0123456789"),
)


def _numbers(data: Any, field: str = "") -> Iterator[tuple[str, float]]:
    if isinstance(data, dict):
        for key, value in data.items():
            yield from _numbers(value, f"{field}.{key}" if field else str(key))
    elif isinstance(data, list):
        for i, value in enumerate(data):
            yield from _numbers(value, f"{field}[{i}]")
    elif isinstance(data, float):
        yield field, data


def _reworded(message: str, data: Any, schema: Any) -> str:
    """Turn msgspec's "text - at `$.a[0].b`" into "a[0].b: text, got value; did you mean …?"."""
    text, _, place = message.partition(" - at ")
    steps = re.findall(r"\.([^.\[\]]+)|\[(\d+|\.\.\.)\]", place.strip("`"))
    field = "".join(f".{key}" if key else f"[{index}]" for key, index in steps).lstrip(".")
    prefix = f"{field}: " if field else ""
    text = text.replace("`", "'")
    names = _field_names(schema, [key for key, _ in steps if key])
    if match := re.fullmatch(r"Object contains unknown field '(.*)'", text):
        return f"{prefix}unknown key '{match[1]}'{suggest(match[1], names)} (allowed: {', '.join(names)})"
    if match := re.fullmatch(r"Object missing required field '(.*)'", text):
        return f"{prefix}missing key '{match[1]}'"
    text = text[:1].lower() + text[1:]
    if ", got " in text:
        return prefix + text
    for key, index in steps:
        try:
            data = data[key] if key else data[int(index)]
        except (TypeError, KeyError, IndexError, ValueError):
            return prefix + text
    return f"{prefix}{text}, got {data!r:.80}"


def _field_names(schema: Any, keys: list[str]) -> list[str]:
    """Return the keys that are allowed in the structure at the end of a path of keys."""
    structs = list(_structs(schema))
    for key in keys:
        hints = [get_type_hints(s, include_extras=True) for s in structs]
        structs = [inner for h in hints if key in h for inner in _structs(h[key])]
    return [field.encode_name for s in structs for field in msgspec.structs.fields(s)]


def _structs(kind: Any) -> Iterator[Any]:
    if isinstance(kind, type) and issubclass(kind, msgspec.Struct):
        yield kind
    for inner in get_args(kind):
        yield from _structs(inner)

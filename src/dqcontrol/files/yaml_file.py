"""YAML files read strictly into typed structures, with errors that name the file and the field."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from contextlib import suppress
from itertools import compress
from pathlib import Path
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

import msgspec
import yaml
from yaml.composer import ComposerError
from yaml.constructor import ConstructorError

try:
    from yaml._yaml import CParser
except ImportError:  # PyYAML was built without libyaml, which reads several times as fast
    CParser = None

from dqcontrol.errors import FileFormatError, suggest
from dqcontrol.files.input_file import read_text
from dqcontrol.files.units import UNITS, as_quantity

T = TypeVar("T")

# characters; the largest that people write have some thousand, and reading takes 10 s for each million
LARGEST_YAML = 2_000_000
_LARGEST = 1e12  # in any unit: neighbouring numbers in m, rad or s are 0.1 mm, mrad or ms apart from there on
_ANY_SIZE = re.compile("seed|gain")  # a run says itself that a gain is too high
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


def parse_yaml(path: str | Path, text: str) -> Any:
    """Return the plain data of one YAML document; ``path`` is for the messages.

    Only finite numbers, up to 1e12 but for gains, are allowed and keys may not repeat. As in YAML 1.2, ``1e-3`` is a
    number and ``OFF``, ``no`` and the like are text; YAML 1.1 has it the other way round.
    """
    if len(text) > LARGEST_YAML:
        raise FileFormatError(
            f"{path}: has {len(text) / 1e6:,.1f} MB; at most {LARGEST_YAML / 1e6:g} MB are read"
        )
    try:
        data = _load(text)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = f":{mark.line + 1}" if mark else ""
        tab = "; indent with spaces, not with tabs" if "'\\t'" in str(error.problem) else ""
        raise FileFormatError(f"{path}{line}: {error.problem or error.context}{tab}") from None
    except yaml.YAMLError as error:  # a character that YAML excludes
        raise FileFormatError(f"{path}: {' '.join(str(error).split())}") from None
    except RecursionError:
        raise FileFormatError(f"{path}: is nested too deeply") from None
    except ValueError as error:  # a date or integer that Python cannot hold
        raise FileFormatError(f"{path}: {error}") from None
    for field, number in _numbers(data):
        if not math.isfinite(number):
            raise FileFormatError(f"{path}: {field}: must be finite, got {number}")
        if abs(number) > _LARGEST and not _ANY_SIZE.search(field):
            raise FileFormatError(f"{path}: {field}: must be at most {_LARGEST:.0e}, got {number:.13g}")
    return data


def convert(path: str | Path, data: Any, schema: type[T]) -> T:
    """Return plain data as a structure; ``path`` is for the messages."""
    try:
        return msgspec.convert(data, schema)
    except msgspec.ValidationError as error:
        raise FileFormatError(f"{path}: {reworded(str(error), data, schema)}") from None


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


_BOOL = "tag:yaml.org,2002:bool"
_StrictLoader.yaml_implicit_resolvers = {
    first: [(tag, pattern) for tag, pattern in found if tag != _BOOL]
    for first, found in yaml.SafeLoader.yaml_implicit_resolvers.items()
}
_StrictLoader.add_implicit_resolver(_BOOL, re.compile(r"^(true|True|TRUE|false|False|FALSE)$"), list("tTfF"))
_StrictLoader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"^[-+]?[0-9][0-9_]*(\.[0-9_]*)?[eE][-+]?[0-9]+$"),
    list("-+0123456789"),
)


class _FastLoader(_StrictLoader):
    """The same, of the events that libyaml finds."""

    def __init__(self, text: str, parser: Any) -> None:
        super().__init__("")
        self.events = parser(text)

    def check_event(self, *choices: Any) -> bool:
        return self.events.check_event(*choices)

    def peek_event(self) -> Any:
        return self.events.peek_event()

    def get_event(self) -> Any:
        return self.events.get_event()


def _load(text: str) -> Any:
    """Return the data of a document; what libyaml refuses, the parser in Python refuses with the better message."""
    if CParser is not None:
        with suppress(yaml.YAMLError, RecursionError, ValueError):
            return _FastLoader(text, CParser).get_single_data()
    return yaml.load(text, Loader=_StrictLoader)


def _numbers(data: Any, field: str = "") -> Iterator[tuple[str, float]]:
    if isinstance(data, dict):
        for key, value in data.items():
            yield from _numbers(value, f"{field}.{key}" if field else str(key))
    elif isinstance(data, list):
        for i, value in enumerate(data):
            yield from _numbers(value, f"{field}[{i}]")
    elif isinstance(data, int | float) and not isinstance(data, bool):
        yield field, data
    elif isinstance(data, str) and (found := as_quantity(data)) is not None:
        yield field, found[0]


def reworded(message: str, data: Any, schema: Any, below: str = "") -> str:
    """Turn msgspec's "text - at `$.a[0].b`" into "a[0].b: text, got value; did you mean …?".

    Parameters
    ----------
    message
        Of the error that conversion raised.
    data
        What was converted.
    schema
        To which type.
    below
        The key of the data that alone was converted, if not all of them were.
    """
    text, _, place = message.partition(" - at ")
    if below:
        place = f"`$.{below}{place.strip('`').removeprefix('$')}`"
    text = text.replace("`", "'")
    field, kinds, around = "", [schema], []
    for key, index in re.findall(r"\.([^.\[\]]+)|\[(\d+|\.\.\.)\]", place.strip("`")):
        if index and index != "...":
            field, data = f"{field}[{index}]", data[int(index)]
            continue
        if index:
            kinds = [inner for kind in kinds for inner in _values(kind)]
            step = _unfit(kinds, data)
        else:
            step, around = key, list(structs_in(kinds))
            hints = [get_type_hints(struct, include_extras=True) for struct in _chosen(around, data)]
            kinds = [hint[key] for hint in hints if key in hint]
        field = f"{field}.{step}" if field else str(step)
        data = data.get(step) if isinstance(data, dict) else None
    prefix = f"{field}: " if field and not text.startswith(f"{field}.") else ""
    if place.startswith("`key` in") and text.startswith("Expected 'str', got"):
        odd = next(key for key in data if not isinstance(key, str))
        return f"{prefix}names are text; put {odd!r} in quotes"
    if text == "Expected 'bool', got 'str'":
        return f"{prefix}expected true or false, got {data!r:.80}"
    if match := re.fullmatch(r"Object contains unknown field '(.*)'", text):
        allowed = _keys(_chosen(list(structs_in(kinds)), data))
        return f"{prefix}unknown key '{match[1]}'{_instead(match[1], allowed)}"
    if match := re.fullmatch(r"Object missing required field '(.*)'", text):
        return f"{prefix}missing key '{match[1]}'{_chosen_by(match[1], kinds, data)}"
    if match := re.fullmatch(r"Invalid value '(.*)'", text):
        tags = [str(struct.__struct_config__.tag) for struct in around]
        return f"{prefix}unknown name '{match[1]}'{_instead(match[1], tags)}"
    if match := re.fullmatch(r"Invalid enum value '(.*)'", text):
        return f"{prefix}unknown name '{match[1]}'{_instead(match[1], list(_literals(kinds)))}"
    if " matching regex " in text:
        text = f"Expected {next(_patterns(kinds), text)}"
        data = _unfit_label(kinds, data) if place.startswith("`key`") else data
    text = _in_words(text[:1].lower() + text[1:], data)
    hint = _hint(kinds, data) if text.startswith("expected a mapping") else ""
    return prefix + (text if ", got " in text else f"{text}, got {data!r:.80}") + hint


_WORDS = {
    "float": "a number",
    "int": "a whole number",
    "str": "text",
    "bool": "true or false",
    "object": "a mapping",
    "array": "a list",
    "null": "nothing",
}


def _in_words(text: str, data: Any) -> str:
    """Name types as YAML does: ``'float | object'`` is a number or a mapping; with what there is in their place."""

    def plain(match: re.Match[str]) -> str:
        return " or ".join(_WORDS.get(name, name) for name in match[1].split(" | "))

    text = re.sub(r"'((?:\w+)(?: \| \w+)*)'", plain, text)
    if isinstance(data, str) and text.endswith(", got text"):
        units = (
            f"; units: {', '.join(UNITS)}"
            if "a number" in text and re.match(r"[-+.\d]+ *[^\W\d]", data)
            else ""
        )
        return f"{text} {data!r:.80}{units}"
    if isinstance(data, bool | int | float):
        return re.sub(", got (true or false|a whole number|a number)$", f", got {str(data).lower()}", text)
    return text


def _hint(kinds: list[Any], data: Any) -> str:
    """Say how a mapping is written, to those who wrote a name or a list in its place."""
    tags = [str(s.__struct_config__.tag) for s in structs_in(kinds) if s.__struct_config__.tag]
    if isinstance(data, str) and data in tags:
        return f"; write {{kind: {data}}}, with its other keys in it"
    if isinstance(data, list) and any(True for kind in kinds for _ in _values(kind)):
        return "; give each a name, as in {A: …, B: …}"
    return ""


def _chosen_by(key: str, kinds: list[Any], data: Any) -> str:
    """Say what a missing key chooses between, if it is a tag, and what was written in its place."""
    tags = [str(s.__struct_config__.tag) for s in structs_in(kinds) if s.__struct_config__.tag_field == key]
    if not tags:
        return ""
    given = next(
        (name for name in ("type", "name", "law", "plant") if isinstance(data, dict) and name in data), ""
    )
    return f"{f'; write {key} for {given!r}' if given else ''} (allowed: {', '.join(dict.fromkeys(tags))})"


_ELSEWHERE = {  # what other programs, and other people, call our keys
    "period": "frequency rate control_rate sample_rate hz fs ts dt timestep time_step sample_time sampling_time step",
    "start": "q0 q_init initial initial_configuration home joints configuration joint_positions",
    "robot": "arm urdf model manipulator robot_file",
    "law": "controller control control_law",
    "reference": "trajectory path motion target desired",
    "plant": "simulator simulation actuator dynamics",
    "duration": "time end_time tf length_of_time seconds",
    "gain": "k kp p gains proportional_gain",
    "integral_gain": "ki i",
    "quaternion": "orientation rotation quat wxyz",
    "rpy": "euler roll_pitch_yaw euler_angles",
    "position": "translation xyz pos",
    "time_constant": "lag tau",
    "delay": "latency dead_time",
    "radius": "r diameter",
    "turns": "revolutions laps rounds",
    "source": "file path urdf name",
    "repeats": "runs trials repetitions",
}
_WITH_HINT = {"frequency": "1/frequency", "diameter": "half of it"} | dict.fromkeys(
    ("rate", "control_rate", "sample_rate", "hz", "fs"), "1/rate"
)


def _instead(name: str, allowed: list[str]) -> str:
    allowed = list(dict.fromkeys(allowed))
    for ours in allowed:
        if name.casefold() in _ELSEWHERE.get(ours, "").split():
            how = f", {_WITH_HINT[name.casefold()]}" if name.casefold() in _WITH_HINT else ""
            return f"; did you mean '{ours}'{how}? (allowed: {', '.join(allowed)})"
    return f"{suggest(name, allowed)} (allowed: {', '.join(allowed)})"


def _chosen(structs: list[Any], data: Any) -> list[Any]:
    """Return those structures that the data's tag names, or all."""
    tagged = [s.__struct_config__ for s in structs]
    fits = (isinstance(data, dict) and data.get(c.tag_field) == c.tag for c in tagged)
    return list(compress(structs, fits)) or structs


def _keys(structs: list[Any]) -> list[str]:
    tags = [s.__struct_config__.tag_field for s in structs if s.__struct_config__.tag_field]
    return tags + [field.encode_name for s in structs for field in msgspec.structs.fields(s)]


def _unfit(kinds: list[Any], data: Any) -> Any:
    """Return the key of the first entry that cannot be converted, because msgspec does not name it."""
    for key, value in data.items():
        try:
            msgspec.convert(value, Union[tuple(kinds)])  # noqa: UP007
        except msgspec.ValidationError:
            return key
    return "…"


def _unfit_label(kinds: list[Any], data: Any) -> Any:
    """Return the first label that its pattern does not allow."""
    patterns = [meta.pattern for meta in _metas(kinds) if meta.pattern]
    return next((label for label in data if not any(re.search(p, str(label)) for p in patterns)), data)


def _values(kind: Any) -> Iterator[Any]:
    """Find the types of the values of all dictionaries in a type."""
    if get_origin(kind) is dict:
        yield get_args(kind)[1]
    else:
        for inner in get_args(kind):
            yield from _values(inner)


def structs_in(kinds: Any) -> Iterator[Any]:
    """Find all structures in types."""
    for kind in kinds:
        if isinstance(kind, type) and issubclass(kind, msgspec.Struct):
            yield kind
        yield from structs_in(get_args(kind))


def _literals(kinds: Any) -> Iterator[str]:
    """Find all allowed texts in types."""
    for kind in kinds:
        if get_origin(kind) is Literal:
            yield from (value for value in get_args(kind) if isinstance(value, str))
        else:
            yield from _literals(get_args(kind))


def _patterns(kinds: Any) -> Iterator[str]:
    """Find what the patterns of texts in types mean."""
    yield from (meta.description for meta in _metas(kinds) if meta.pattern and meta.description)


def _metas(kinds: Any) -> Iterator[Any]:
    for kind in kinds:
        yield from getattr(kind, "__metadata__", ())
        yield from _metas(get_args(kind))

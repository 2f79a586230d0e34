"""Units of the parameters of specs, as the descriptions of their keys say."""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import cache

from msgspec import inspect

from dqcontrol.experiments.spec import Spec

_UNIT = re.compile(r"(1/)?(s|m|rad|kg|Hz|N|N·m)[²³]?(/(s|m|rad)[²³]?)?( or (m|N)(/(s|m)[²³]?)?)?")


@cache
def parameter_unit(key: str) -> str:
    """Return the unit of a parameter; empty where it has none, or laws and plants disagree on it.

    Parameters
    ----------
    key
        Path in a spec, as ``"plant.time_constant"`` or ``"laws.*.gain"``, or the name of a law's parameter.

    Examples
    --------
    >>> parameter_unit("laws.*.gain"), parameter_unit("plant.encoder_noise"), parameter_unit("seed")
    ('1/s', 'rad or m', '')
    """
    kinds = [inspect.type_info(Spec)]
    for part in key.split(".") if key.partition(".")[0] in Spec.__struct_fields__ else ("law", key):
        kinds = [inner for kind in kinds for inner in _below(kind, part)]
    descriptions = (text for kind in kinds for text in _descriptions(kind))
    units = {text.partition(";")[0].rpartition(", ")[2] for text in descriptions}
    if any(" … " in unit for unit in units):  # a share: no unit, whatever others of that name have
        return ""
    widest = max((unit for unit in units if _UNIT.fullmatch(unit)), key=len, default="")
    return widest if all(unit in widest for unit in units if _UNIT.fullmatch(unit)) else ""


def with_unit(key: str) -> str:
    """Return a parameter's name with its unit, as ``"plant.time_constant [s]"``."""
    unit = parameter_unit(key)
    return f"{key} [{unit}]" if unit else key


def _below(kind: inspect.Type, part: str) -> Iterator[inspect.Type]:
    """Give the types of what a key leads to."""
    if isinstance(kind, inspect.Metadata):
        yield from _below(kind.type, part)
    elif isinstance(kind, inspect.UnionType):
        for each in kind.types:
            yield from _below(each, part)
    elif isinstance(kind, inspect.DictType):
        yield kind.value_type
    elif isinstance(kind, inspect.StructType):
        yield from (field.type for field in kind.fields if field.encode_name == part)


def _descriptions(kind: inspect.Type) -> Iterator[str]:
    """Give the descriptions of a type and of those that it unites."""
    if isinstance(kind, inspect.Metadata):
        if kind.extra_json_schema:
            yield str(kind.extra_json_schema.get("description", ""))
        yield from _descriptions(kind.type)
    elif isinstance(kind, inspect.UnionType):
        for each in kind.types:
            yield from _descriptions(each)

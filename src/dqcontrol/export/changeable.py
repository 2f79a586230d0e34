"""Numbers of a controller that may be changed while it exists, found by trying.

Each number of the law's and the supervisor's parameters is changed a little, and both are prepared again: where what
compiled code reads changes in proportion, C can do the same; where it does not (gains of Riccati equations, windows of
smoothing), the number stays as it was exported.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, get_args, get_type_hints

import msgspec
import numpy as np
from msgspec import Meta, Struct

from dqcontrol.arrays import Array
from dqcontrol.controller.command_kernel import prepared_memory
from dqcontrol.errors import Error
from dqcontrol.export.controller_parts import ControllerParts
from dqcontrol.supervisor import supervisor_layout as layout

_MOST_GAIN = 1e6  # 1/s; at a period of 1 µs it is unstable already
_TRIED = (1.0, 0.75, 0.5)  # times the value, which the structure allows where it allows the value
_PROPORTIONAL = 1e-12  # rounding of a product of some factors
_ROWS = {  # of a supervisor, as the spec and as its `Bounds` name them
    "velocity": "velocity",
    "acceleration": "acceleration",
    "tracking_error": "tracking",
}


@dataclass(frozen=True)
class ChangedNumber:
    """A number that compiled code reads: offset + slope · value."""

    index: int
    offset: float
    slope: float


@dataclass(frozen=True)
class Changeable:
    """A parameter.

    Attributes
    ----------
    name
        As the spec has it.
    value
        As exported.
    least, most
        Bounds: of gains those of their keys; limits may only become tighter.
    of_supervisor
        Whether its numbers are the supervisor's, and so change only at rest.
    places
        What it changes.
    """

    name: str
    value: float
    least: float
    most: float
    of_supervisor: bool
    places: list[ChangedNumber]


def changeable_parameters(parts: ControllerParts) -> list[Changeable]:
    """Return all parameters of a controller that may be changed."""
    return [*_of_law(parts), *_of_supervisor(parts)]


def _of_law(parts: ControllerParts) -> Iterator[Changeable]:
    if not parts.takes_streams:  # its parameters depend on time
        return
    law, robot = parts.law_spec, parts.robot
    sizes = [int(parts.plan_field(name)) for name in prepared_memory.sizes]
    at = prepared_memory.place("parameters", *sizes)

    def rows(changed: Struct) -> Array:
        return np.ravel(changed.rows(robot, parts.case.scene.reference, parts.period))  # type: ignore[attr-defined]

    yield from _fields("law", law, rows, at, parts.period)
    if law.null_space is not None:
        at = prepared_memory.place("preferring", *sizes)

        def preferring(changed: Any) -> Array:
            return changed.parameters(robot)

        yield from _fields("law.null_space", law.null_space, preferring, at, parts.period)


def _fields(
    prefix: str, struct: Struct, numbers: Callable[[Any], Array], at: int, period: float
) -> Iterator[Changeable]:
    """Yield the numbers of a structure that stand alone in it and change what is prepared in proportion.

    A gain k (1/s) may be so large that k T = 1, where errors on ideal joints are gone after a period.
    """
    hints = get_type_hints(type(struct), include_extras=True)
    for field in struct.__struct_fields__:
        value = getattr(struct, field)
        if type(value) not in (float, int) or not value:
            continue
        places = _places(struct, field, float(value), numbers, at)
        if places:
            least, most = _bounds(hints[field])
            if field == "gain":
                most = max(min(most, 1.0 / period), float(value))
            yield Changeable(f"{prefix}.{field}", float(value), least, most, False, places)


def _places(
    struct: Struct, field: str, value: float, numbers: Callable[[Any], Array], at: int
) -> list[ChangedNumber]:
    try:
        tried = [numbers(msgspec.structs.replace(struct, **{field: share * value})) for share in _TRIED]
    except Error:
        return []
    first, second, third = tried
    if len({each.size for each in tried}) > 1:
        return []
    places = []
    for i in np.flatnonzero((first != second) | (first != third)):
        slope = (first[i] - second[i]) / (value * (_TRIED[0] - _TRIED[1]))
        foreseen = first[i] + slope * value * (_TRIED[2] - _TRIED[0])
        if not abs(foreseen - third[i]) <= _PROPORTIONAL * abs(first[i]):
            return []
        ratio = first[i] / value
        is_ratio = abs(slope - ratio) <= _PROPORTIONAL * abs(ratio)
        offset, slope = (0.0, ratio) if is_ratio else (first[i] - slope * value, slope)
        places.append(ChangedNumber(at + int(i), float(offset), float(slope)))
    return places


def _bounds(hint: Any) -> tuple[float, float]:
    """Return the bounds that a key of a spec has by its type."""
    least, most = 0.0, _MOST_GAIN
    for meta in _metas(hint):
        least = max(least, meta.ge if meta.ge is not None else 0.0)
        most = min(most, meta.le if meta.le is not None else most)
    return float(least), float(most)


def _metas(hint: Any) -> Iterator[Meta]:
    yield from (meta for meta in getattr(hint, "__metadata__", ()) if isinstance(meta, Meta))
    for part in get_args(hint):
        yield from _metas(part)


def _of_supervisor(parts: ControllerParts) -> Iterator[Changeable]:
    """Yield the limits that each input has; they may become tighter than exported, and back."""
    if parts.supervisor is None or len(parts.robot.drives):
        return
    spec, prepared = parts.supervisor
    m = parts.robot.input_size
    for field, row in _ROWS.items():
        if field == "acceleration" and spec.jerk is not None:
            continue  # the window of smoothing depends on it
        for i, name in enumerate(parts.robot.input_names):
            index = layout.bounds_layout.place(row, m, 0, 0, 0, 0) + i
            value = float(prepared.memory[index])
            places = [ChangedNumber(index, 0.0, 1.0)]
            yield Changeable(f"supervisor.{field}.{name}", value, 1e-3 * value, value, True, places)

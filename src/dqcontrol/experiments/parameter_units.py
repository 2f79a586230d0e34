"""Units of the parameters of specs, as the descriptions of their keys say."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from functools import cache
from typing import Any

import msgspec
import numpy as np
from msgspec import inspect
from numpy.typing import NDArray

from dqcontrol.errors import NoteWarning
from dqcontrol.experiments.spec import Spec
from dqcontrol.experiments.spec.key_types import kinds_below, kinds_of, unit_in
from dqcontrol.experiments.spec.reference_spec import ReferenceSpec
from dqcontrol.robots import Robot, describe

_TOO_LONG = 3.0  # reaches


def suspected_degrees(start: NDArray[np.float64], robot: Robot) -> str:
    """Return a hint if a start configuration outside the limits lies within them when its angles are degrees."""
    turning = np.array([kind == "revolute" for kind in robot.joint_types])
    turned = np.where(turning, np.radians(start), start)
    inside = ((turned >= robot.limits.lower) & (turned <= robot.limits.upper)).all()
    large = start[turning & (np.abs(start) > 2 * np.pi)]
    if not inside or not len(large):
        return ""
    return f"; degrees? Angles are in rad; write {large[0]:g} deg"


def note_turns(field: str, q: NDArray[np.float64], robot: Robot) -> None:
    """Say which joint of a configuration is more than a turn from 0: limits do not refuse what is in degrees there."""
    turning = np.array([kind == "revolute" for kind in robot.joint_types])
    for i in np.flatnonzero(turning & (np.abs(q) > 2 * np.pi))[:1]:
        warnings.warn(
            f"{field}: {robot.joint_names[i]} is {q[i]:g} rad, {abs(q[i]) / (2 * np.pi):.3g} turns; for degrees write "
            f"{q[i]:g} deg",
            NoteWarning,
            stacklevel=2,
        )


def suspected_millimetres(reference: ReferenceSpec, robot: Robot) -> str:
    """Return a hint if a length of a reference is far beyond the robot, but not as millimetres."""
    reach = describe(robot).reach
    lengths = dict(_lengths(msgspec.to_builtins(reference), list(kinds_of(type(reference))), "reference"))
    field = max(lengths, key=lambda key: abs(lengths[key]), default="")
    if not field or not _TOO_LONG * reach < abs(lengths[field]) < 1e3 * _TOO_LONG * reach:
        return ""
    return f"; {field} is {lengths[field]:g} m: metres? Write {lengths[field]:g} mm for millimetres"


def _lengths(data: Any, kinds: list[inspect.Type], field: str) -> Iterator[tuple[str, float]]:
    """Give the numbers of plain data that are in m, by their keys."""
    if isinstance(data, dict):
        for key, value in data.items():
            yield from _lengths(value, kinds_below(kinds, key), f"{field}.{key}")
    elif isinstance(data, list):
        for i, value in enumerate(data):
            yield from _lengths(value, kinds_below(kinds, str(i)), f"{field}[{i}]")
    elif isinstance(data, float) and unit_in(kinds) == "m":
        yield field, data


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
    path = key if key.partition(".")[0] in Spec.__struct_fields__ else f"law.{key}"
    return unit_in(kinds_below(list(kinds_of(Spec)), path))


def with_unit(key: str) -> str:
    """Return a parameter's name with its unit, as ``"plant.time_constant [s]"``."""
    unit = parameter_unit(key)
    return f"{key} [{unit}]" if unit else key

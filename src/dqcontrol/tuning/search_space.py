"""From points of the unit cube to laws: which parameters are free, and where."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import msgspec
import numpy as np
from msgspec.structs import replace

from dqcontrol.errors import ShapeError, ValueRangeError, unknown_name
from dqcontrol.laws import Law
from dqcontrol.tuning.robustness import Slack
from dqcontrol.tuning.tune_spec import SearchRange

LOOP_GAIN, INTEGRAL_SHARE = "loop_gain", "integral_share"
_SLOWEST = 50.0  # times the gain at the side where the margin ends
_SHARES = SearchRange(low=2e-3, high=0.25)
_INTEGRAL = "integral_gain"
_MARGIN_TOLERANCE = 1e-3  # relative error of a margin that is asked for
_MOST_STEPS = 4  # rescalings; they end by themselves within `_MARGIN_TOLERANCE`

Judge = Callable[[Law], Slack]


class SearchSpace:
    """The free parameters of one law.

    A free loop gain without a range goes from the 50th part of the gain at which the margin ends up to that gain,
    whatever the other parameters are: the hard constraint is a side of the cube, and no point is lost to it.

    Parameters
    ----------
    label
        Of the law, for messages.
    law
        As the spec has it; what is not free stays so.
    ranges
        By name what is free; None for the defaults.
    judge
        Returns the gain and slack of a law.

    Raises
    ------
    UnknownNameError, ShapeError, ValueRangeError
        If the law has no such parameter, or it cannot be stable.
    """

    def __init__(self, label: str, law: Law, ranges: Mapping[str, SearchRange] | None, judge: Judge) -> None:
        self.label = label
        self.law = law
        self._judge = judge
        self._known: dict[str, Slack] = {}
        self.ranges: dict[str, SearchRange | None] = dict(ranges) if ranges else self._defaults()
        for key in self.ranges:
            self._check_key(key)
        if LOOP_GAIN in self.ranges and (taken := set(law.gain_powers) & set(self.ranges)) == {"gain"}:
            raise ShapeError(f"{self._field('gain')}: {taken.pop()} and loop_gain are one; leave one out")
        self._check_stable()

    def _field(self, key: str) -> str:
        return f"tune.free.{self.label}.{key}"

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the free parameters, in the order of coordinates."""
        return tuple(self.ranges)

    def _defaults(self) -> dict[str, SearchRange | None]:
        if not self.law.gain_powers:
            raise ShapeError(
                f"tune.free.{self.label}: the law's loop gain is unknown; say which of its keys are free"
            )
        found: dict[str, SearchRange | None] = {LOOP_GAIN: None}
        if getattr(self.law, _INTEGRAL, 0.0):
            found[INTEGRAL_SHARE] = _SHARES
        return found

    def _check_key(self, key: str) -> None:
        if key in (LOOP_GAIN, INTEGRAL_SHARE):
            needed = self.law.gain_powers if key == LOOP_GAIN else _INTEGRAL in self.law.gain_powers
            if not needed:
                raise ShapeError(f"{self._field(key)}: {type(self.law).__struct_config__.tag} has none")
            return
        inner: Any = self.law
        *path, last = key.split(".")
        for name in path:
            inner = (
                getattr(inner, name) if isinstance(inner, msgspec.Struct) and name in _fields(inner) else None
            )
        if not isinstance(inner, msgspec.Struct) or last not in _fields(inner):
            known = [LOOP_GAIN, *([INTEGRAL_SHARE] if _INTEGRAL in self.law.gain_powers else [])]
            raise unknown_name(f"tune.free.{self.label}", key, [*known, *_fields(self.law)])
        if not isinstance(getattr(inner, last), int | float | None):
            raise ShapeError(f"{self._field(key)}: is no single number in this law; give it as one")

    def _check_stable(self) -> None:
        """Raise if no gain of the range is stable enough."""
        size = len(self.ranges)
        corners = [np.zeros(size), *(np.eye(size)), np.ones(size), np.full(size, 0.5)]
        if any(self.slack(self.law_at(corner)).share >= 1 - _MARGIN_TOLERANCE for corner in corners):
            return
        slowest = self.slack(self.law_at(corners[0]))
        if slowest.of_null_space < 1 - _MARGIN_TOLERANCE:
            raise ValueRangeError(
                f"null_space.gain: too high for any law: margin and damping as asked allow "
                f"{slowest.of_null_space:.3g} times as much"
            )
        spans = [
            f"{key} in {span.low:g} … {span.high:g}" for key, span in self.ranges.items() if span is not None
        ]
        at = (
            f"; it ends at kT = {slowest.share * slowest.product:.3g}, and the slowest law has "
            f"{slowest.product:.3g}"
        )
        raise ValueRangeError(
            f"tune.free.{self.label}: no law with {' and '.join(spans) or 'any loop_gain'} keeps margin and damping as "
            f"asked{at if slowest.product else ''}"
        )

    def slack(self, law: Law) -> Slack:
        """Return gain and slack of a law, found once."""
        key = repr(law)
        if key not in self._known:
            self._known[key] = self._judge(law)
        return self._known[key]

    def law_at(self, shares: Sequence[float] | np.ndarray) -> Law:
        """Return the law at a point of the unit cube."""
        law, at = self.law, dict(zip(self.ranges, map(float, shares), strict=True))
        for key, span in self.ranges.items():
            if key not in (LOOP_GAIN, INTEGRAL_SHARE) and span is not None:
                law = _with_value(law, key.split("."), span.at(at[key]))
        share = self.ranges.get(INTEGRAL_SHARE)
        if share is not None:
            gain = self._gain(law)
            law = replace(law, **{_INTEGRAL: share.at(at[INTEGRAL_SHARE]) * gain * gain})
        if LOOP_GAIN not in self.ranges:
            return law
        span = self.ranges[LOOP_GAIN]
        if span is not None:
            return law.scaled(span.at(at[LOOP_GAIN]) / (self.slack(law).product or 1.0))
        return self._at_slack(law, _SLOWEST ** (1 - at[LOOP_GAIN]))

    def _gain(self, law: Law) -> float:
        """Return the gain of which the integral is a share, 1/s."""
        gain = getattr(law, "gain", None)
        if not isinstance(gain, int | float):
            raise ShapeError(f"{self._field(INTEGRAL_SHARE)}: needs a law whose gain is one number")
        return float(gain)

    def _at_slack(self, law: Law, wanted: float) -> Law:
        """Return a law scaled so that its margin is so many times what is asked for."""
        found, scaled, factor = self.slack(law).share, law, 1.0
        if not 0 < found < math.inf:
            return law
        for _ in range(_MOST_STEPS):
            factor *= found / wanted
            scaled = law.scaled(factor)
            if _scales(law):
                break
            found = self.slack(scaled).share
            if not 0 < found < math.inf or abs(found / wanted - 1) < _MARGIN_TOLERANCE:
                break
        return scaled

    def parameters(self, law: Law) -> dict[str, Any]:
        """Return those of its keys that differ from the spec's law."""
        before, after = msgspec.to_builtins(self.law), msgspec.to_builtins(law)
        changed = {key: value for key, value in after.items() if value != before.get(key) and key != "kind"}
        searched = set(self.law.gain_powers) & set(before) | {key.partition(".")[0] for key in self.ranges}
        return {key: value for key, value in after.items() if key in changed or (key in searched and value)}


def _scales(law: Law) -> bool:
    """Return whether its margin goes exactly with one over the gain: not with lags of its own, nor over a horizon."""
    return set(law.gain_powers) <= {"gain", "integral_gain", "orientation_gain", "translation_gain"} | {
        "orientation_gamma",
        "translation_gamma",
    }


def _fields(part: msgspec.Struct) -> tuple[str, ...]:
    return type(part).__struct_fields__


def _with_value(part: Any, path: Sequence[str], value: float) -> Any:
    if len(path) == 1:
        return replace(part, **{path[0]: value})
    return replace(part, **{path[0]: _with_value(getattr(part, path[0]), path[1:], value)})

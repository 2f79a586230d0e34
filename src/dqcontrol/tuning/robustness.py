"""Distance of tuned parameters from instability, over a family of plants that the true one may be of."""

from __future__ import annotations

import json
import math
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, NamedTuple

from msgspec import Meta

from dqcontrol.controller import Controller
from dqcontrol.errors import DivergedError, ShapeError, ValueRangeError
from dqcontrol.experiments.check import driven_model, with_observer
from dqcontrol.experiments.prepared_experiment import PreparedRobot
from dqcontrol.experiments.spec import Spec
from dqcontrol.experiments.spec.reference_spec import Part
from dqcontrol.laws import Law
from dqcontrol.limits import CommandLimits
from dqcontrol.measures.stability import (
    MOST_STATES,
    LoopGain,
    NumericLoop,
    damping_limit,
    linearise_law,
    loop_gains,
    stability_limit,
    with_lag,
)
from dqcontrol.plants.linear_model import LinearModel
from dqcontrol.plants.plant import Plant

_LAG = 0.2  # of itself, where `identify` has not said by how much it may be wrong
_INTERVALS = "identification.json"  # beside a plant file


class Robustness(Part, frozen=True, kw_only=True):
    """How much of a plant is uncertain, and the margin that all of its family keep.

    Parameters
    ----------
    lag
        Share of the time constants; default: 0.2, or more where the intervals of an identified plant are wider.
    delay
        s; default: one period, or more where the intervals are wider.
    margin
        By how much the gain could at least be multiplied with each plant of the family.
    """

    lag: Annotated[float, Meta(ge=0, lt=1)] | None = None
    delay: Annotated[float, Meta(ge=0, description="s")] | None = None
    margin: Annotated[float, Meta(ge=1, le=1000)] = 1.5


@dataclass(frozen=True)
class PlantFamily:
    """A plant, others that it may be as well, and the stability margin that each must keep.

    Attributes
    ----------
    plants
        The nominal one first.
    margins
        Of each.
    lag, delay
        How far they differ: share of the time constants, and s; 0 with one plant.
    """

    plants: tuple[Plant, ...]
    margins: tuple[float, ...]
    lag: float = 0.0
    delay: float = 0.0

    def __len__(self) -> int:
        return len(self.plants)


def plant_family(
    plant: Plant,
    given: Robustness | bool | None,
    margin: float,
    period: float,
    identified: Path | None,
    field: str = "tune.robust",
) -> PlantFamily:
    """Return the family of a plant.

    Parameters
    ----------
    plant
        The nominal one.
    given
        What the spec says; None: a family if the plant was identified.
    margin
        Of the nominal plant.
    period
        T, s.
    identified
        The plant file that ``dqcontrol identify`` wrote, if the plant is from one.
    field
        For messages.

    Raises
    ------
    ValueRangeError
        If a family is asked for of a plant without lag and delay.
    """
    if given is False or (given is None and identified is None):
        return PlantFamily((plant,), (margin,))
    asked = given if isinstance(given, Robustness) else Robustness()
    known_lag, known_delay = _intervals(identified) if identified else (0.0, 0.0)
    lag = max(_LAG, known_lag) if asked.lag is None else asked.lag
    delay = max(period, known_delay) if asked.delay is None else asked.delay
    corners = [(lag, delay), (lag, -delay), (-lag, delay), (-lag, -delay)]
    others = [other for each in corners if (other := plant.varied(*each)) is not None]
    if not others:
        raise ValueRangeError(
            f"{field}: {type(plant).__name__} has no lag and delay that could vary; leave it out"
        )
    least = min(asked.margin, margin) if margin else 0.0
    return PlantFamily((plant, *others), (margin, *[least] * len(others)), lag, delay)


def identified_file(data: dict[str, Any], folder: Path) -> Path | None:
    """Return the plant file of a spec's plain data, if an identification lies beside it or in it."""
    for plant in [data.get("plant"), *((data.get("plants") or {}).values())]:
        if isinstance(plant, dict) and isinstance(plant.get("file"), str):
            return folder / plant["file"]
    return None


def _intervals(file: Path) -> tuple[float, float]:
    """Return the widest half intervals of lags, as shares, and of delays, s, of an identification beside a file."""
    lag = delay = 0.0
    with suppress(OSError, ValueError, KeyError, TypeError):
        for joint in json.loads((file.parent / _INTERVALS).read_text(encoding="utf-8"))["joints"]:
            if joint["status"] != "fitted":
                continue
            low, high = joint["lag_interval"]
            lag = max(lag, (high - low) / 2 / joint["lag"]) if joint["lag"] else lag
            low, high = joint["delay_interval"]
            delay = max(delay, (high - low) / 2)
    return (lag if math.isfinite(lag) else 0.0), (delay if math.isfinite(delay) else 0.0)


_GRID = 0.02  # of the logarithm of integral shares and lags that limits are found for


class Slack(NamedTuple):
    """Of a law.

    Attributes
    ----------
    product
        k T of its fastest loop of position or orientation; 0 if it is unknown.
    share
        By how much its gain could be multiplied with margin and damping as asked for; infinite if neither is.
    of_margin
        The same with the margins alone.
    of_null_space
        By how much the gain in the null space, which is not the law's, could be multiplied likewise.
    """

    product: float
    share: float
    of_margin: float
    of_null_space: float = math.inf


class StabilityJudge:
    """Judges laws on a family of plants: as ``check`` does, each limit once.

    Parameters
    ----------
    spec, scene, family
        Whose period, supervisor and compensation, at which start, on which plants.
    damping
        Least damping ratio of the slowest poles with the nominal plant.

    Raises
    ------
    ShapeError
        If a margin is asked for, and a plant has no linear model.
    """

    def __init__(self, spec: Spec, scene: PreparedRobot, family: PlantFamily, damping: float) -> None:
        self._damping = damping
        self._period, self._scene = spec.period, scene
        self._margins = family.margins
        self._models = [self._model(spec, plant) for plant in family.plants] if any(family.margins) else []
        self._damped_limits: dict[tuple[int | None, int | None], float] = {}
        self._limits: dict[tuple[int, complex, int | None, int | None], float] = {}

    def _model(self, spec: Spec, plant: Plant) -> LinearModel:
        model, _ = driven_model(spec, plant, self._scene.robot, self._scene.start)
        if model is None or len(model.transition) > MOST_STATES:
            reason = "no linear model" if model is None else f"more than {MOST_STATES} states"
            raise ShapeError(
                f"tune.margin: cannot be judged, as the plant has {reason}; give margin: 0 to search without it"
            )
        if spec.limits.compensation is not None:
            return with_observer(model, spec.limits.compensation, self._scene.robot, spec.period)
        return model

    def slack(self, law: Law, prepared: Controller) -> Slack:
        """Return how far a prepared law is from its limits."""
        gains = loop_gains(law, prepared)
        product = max(
            (abs(gain.value) * self._period for gain in gains or () if gain.loop != "null space"), default=0.0
        )
        if not self._models:
            return Slack(product, math.inf, math.inf)
        if gains is None:
            numeric = self._numeric(prepared)
            return Slack(product, numeric, numeric)
        of_margin, share, of_null_space = math.inf, math.inf, math.inf
        for gain in gains:
            if not gain.value:
                continue
            own = abs(gain.value) * self._period
            margin = min(self._limit(i, gain) / own / asked for i, asked in enumerate(self._margins))
            damped = min(margin, self._damped(gain) / own)
            of_margin, share = min(of_margin, margin), min(share, damped)
            if gain.loop == "null space":
                of_null_space = damped
        return Slack(product, share, of_margin, of_null_space)

    def _limit(self, plant: int, gain: LoopGain) -> float:
        direction = gain.value / abs(gain.value) if gain.value.imag else 1.0
        share, lag = _on_grid(gain.integral_share), _on_grid(gain.lag)
        key = plant, direction, share, lag
        if key not in self._limits:
            behind = with_lag(self._models[plant], _off_grid(lag), self._period)
            self._limits[key] = stability_limit(behind, self._period, direction, _off_grid(share))
        return self._limits[key]

    def _damped(self, gain: LoopGain) -> float:
        """Return the product from which on the nominal plant is not damped as asked; complex gains oscillate anyway."""
        if not self._damping or gain.value.imag:
            return math.inf
        key = _on_grid(gain.integral_share), _on_grid(gain.lag)
        if key not in self._damped_limits:
            share, lag = map(_off_grid, key)
            behind = with_lag(self._models[0], lag, self._period)
            self._damped_limits[key] = damping_limit(behind, self._period, self._damping, share)
        return self._damped_limits[key]

    def _numeric(self, prepared: Controller) -> float:
        """Return the slack of a law whose loop gains are unknown, as it is at the start."""
        try:
            law = linearise_law(prepared.with_limits(CommandLimits(velocity=False)), self._scene.start)
        except DivergedError:
            return 0.0
        if law is None:
            return 0.0
        loops = [NumericLoop(law, model) for model in self._models]
        return min(loop.margin / margin for loop, margin in zip(loops, self._margins, strict=True))


def _on_grid(value: float) -> int | None:
    return round(math.log(value) / _GRID) if value > 0 else None


def _off_grid(place: int | None) -> float:
    return 0.0 if place is None else math.exp(place * _GRID)

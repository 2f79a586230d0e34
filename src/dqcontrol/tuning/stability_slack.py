"""How far a law is from the stability margins that it must keep, with each plant of a family."""

from __future__ import annotations

import math
from typing import NamedTuple

from dqcontrol.controller import Controller
from dqcontrol.errors import DivergedError, ShapeError
from dqcontrol.experiments.check import driven_model, with_observer
from dqcontrol.experiments.prepared_experiment import PreparedRobot
from dqcontrol.experiments.spec import Spec
from dqcontrol.laws import Law
from dqcontrol.limits import CommandLimits
from dqcontrol.measures.linearised_law import NumericLoop, linearise_law
from dqcontrol.measures.stability import (
    MOST_STATES,
    LoopGain,
    damping_limit,
    loop_gains,
    stability_limit,
    with_lag,
)
from dqcontrol.plants.linear_model import LinearModel
from dqcontrol.plants.plant import Plant
from dqcontrol.tuning.plant_family import PlantFamily

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

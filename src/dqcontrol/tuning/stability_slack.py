"""How far a law is from the stability margins that it must keep, with each plant of a family."""

from __future__ import annotations

import math
from typing import NamedTuple

from dqcontrol.errors import DivergedError, ShapeError
from dqcontrol.experiments.check import driven_model, with_observer
from dqcontrol.experiments.prepared_experiment import PreparedRobot
from dqcontrol.experiments.spec import Spec
from dqcontrol.laws import Law, PreparedLaw
from dqcontrol.limits import CommandLimits
from dqcontrol.measures.linearised_law import NumericLoop, linearise_law
from dqcontrol.measures.stability import MOST_STATES, LoopGain, loop_gains, stability_limit, with_lag
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
        Least of its margins with the plants, each over what is asked for; infinite if no margin is asked for.
    """

    product: float
    share: float


class StabilityJudge:
    """Judges laws on a family of plants: as ``check`` does, but only the margin, and each limit once.

    Raises
    ------
    ShapeError
        If a margin is asked for, and a plant has no linear model.
    """

    def __init__(self, spec: Spec, scene: PreparedRobot, family: PlantFamily) -> None:
        self._period, self._scene = spec.period, scene
        self._margins = family.margins
        self._models = [self._model(spec, plant) for plant in family.plants] if any(family.margins) else []
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

    def slack(self, law: Law, prepared: PreparedLaw) -> Slack:
        """Return how far a prepared law is from its limits."""
        gains = loop_gains(law, prepared)
        product = max(
            (abs(gain.value) * self._period for gain in gains or () if gain.loop != "null space"), default=0.0
        )
        if not self._models:
            return Slack(product, math.inf)
        if gains is None:
            return Slack(product, self._numeric(prepared))
        shares = [
            self._limit(i, gain) / (abs(gain.value) * self._period) / self._margins[i]
            for i in range(len(self._models))
            for gain in gains
            if gain.value
        ]
        return Slack(product, min(shares, default=math.inf))

    def _limit(self, plant: int, gain: LoopGain) -> float:
        direction = gain.value / abs(gain.value) if gain.value.imag else 1.0
        share, lag = _on_grid(gain.integral_share), _on_grid(gain.lag)
        key = plant, direction, share, lag
        if key not in self._limits:
            behind = with_lag(self._models[plant], _off_grid(lag), self._period)
            self._limits[key] = stability_limit(behind, self._period, direction, _off_grid(share))
        return self._limits[key]

    def _numeric(self, prepared: PreparedLaw) -> float:
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

"""What may be true of a plant whose numbers are not exactly known: a family of plants around it."""

from __future__ import annotations

import json
import math
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from msgspec import Meta

from dqcontrol.errors import ValueRangeError
from dqcontrol.experiments.spec.reference_base import Part
from dqcontrol.plants.plant import Plant

_LAG = 0.2
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

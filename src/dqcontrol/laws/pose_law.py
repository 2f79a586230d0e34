"""What the laws of the pose error have in common: gain, inverse, the sign of x_d."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import numpy as np
from msgspec import Meta

from dqcontrol.errors import ValueRangeError, as_array
from dqcontrol.laws.gains import Schedule, gain_matrix_rows
from dqcontrol.laws.inverses import HEAD, FilteredInverse, Inverse
from dqcontrol.laws.law import Law
from dqcontrol.laws.loop_rates import LoopRates
from dqcontrol.robots.robot import Robot

if TYPE_CHECKING:
    from dqcontrol.references import Reference

HYSTERESIS = HEAD
GAIN = HEAD + 1  # parameters: inverse (3), hysteresis, gains (8)


def parameter_head(inverse: Inverse, hysteresis: float) -> list[float]:
    """Return the parameters that a law of an error with a sign puts first."""
    delta = float(as_array("hysteresis", hysteresis, ()))
    if not 0 <= delta < 1:
        raise ValueRangeError(f"hysteresis: must be in [0, 1), got {delta:g}")
    return [*inverse.parameters(), delta]


class PoseLaw(Law, frozen=True, kw_only=True):
    """A law that feeds back a pose error of eight numbers with a gain each."""

    gain: Annotated[
        float | list[float] | Schedule, Meta(description="K in 1/s: k, its diagonal (8), or k over time")
    ]
    inverse: Inverse = FilteredInverse()
    hysteresis: Annotated[
        float, Meta(ge=0, lt=1, description="how far Re(x_e) must pass 0 before the sign of x_d flips")
    ] = 0.2

    def parameter_rows(self, robot: Robot, times: np.ndarray) -> np.ndarray:
        """Return inverse, hysteresis and gain diagonal at each time."""
        head = parameter_head(self.inverse, self.hysteresis)
        gains = gain_matrix_rows("gain", self.gain, 8, times)
        return np.hstack([np.tile(head, (len(gains), 1)), gains])

    def loop_rates(self, parameters: np.ndarray) -> LoopRates:
        """Return the largest of K's entries for the dual and the primary imaginary parts."""
        gains = parameters[:, GAIN : GAIN + 8]
        return LoopRates(position=gains[:, 5:8].max(axis=1), orientation=gains[:, 1:4].max(axis=1))

    def horizon(self, reference: Reference | None) -> float:
        """Return the end of the gain schedule, s."""
        return self.gain.end if isinstance(self.gain, Schedule) else 0.0

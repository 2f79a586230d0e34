"""The base of the laws of the pose error: gain, inverse, the sign of x_d."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, ClassVar, NamedTuple

import numpy as np
from msgspec import Meta

from dqcontrol.arrays import Array
from dqcontrol.compiled.memory_layout import MemoryLayout
from dqcontrol.errors import ValueRangeError, as_array
from dqcontrol.laws.gains import Positive, Schedule, gain_matrix_rows
from dqcontrol.laws.inverses import FilteredInverse, Inverse, inverse_parameters
from dqcontrol.laws.law import Law
from dqcontrol.laws.loop_rates import LoopRates
from dqcontrol.robots.robot import Robot

if TYPE_CHECKING:
    from dqcontrol.references import Reference


class PoseParameters(NamedTuple):
    """What compiled code knows of a `PoseLaw`."""

    inverse: Annotated[Array, inverse_parameters.size()]
    hysteresis: float
    gain: Annotated[Array, 8]


pose_parameters: MemoryLayout[PoseParameters] = MemoryLayout(PoseParameters)


def checked_hysteresis(hysteresis: float) -> float:
    """Return the hysteresis of the sign of an error, or raise a `ValueRangeError`."""
    delta = float(as_array("hysteresis", hysteresis, ()))
    if not 0 <= delta < 1:
        raise ValueRangeError(f"hysteresis: must be in [0, 1), got {delta:g}")
    return delta


class PoseLaw(Law, frozen=True, kw_only=True):
    """A law that feeds back a pose error of eight numbers with a gain each."""

    gain_powers: ClassVar[Mapping[str, float]] = {"gain": 1}
    gain: Annotated[
        Positive | list[Positive] | Schedule,
        Meta(description="K in 1/s: k, its diagonal (8), or k over time"),
    ]
    inverse: Inverse = FilteredInverse()
    hysteresis: Annotated[
        float, Meta(ge=0, lt=1, description="how far Re(x_e) must pass 0 before the sign of x_d flips")
    ] = 0.2

    def parameter_rows(self, robot: Robot, times: np.ndarray) -> np.ndarray:
        """Return inverse, hysteresis and gain diagonal at each time."""
        return pose_parameters.pack(
            inverse=self.inverse.parameters(),
            hysteresis=checked_hysteresis(self.hysteresis),
            gain=gain_matrix_rows("gain", self.gain, 8, times),
        )

    def loop_rates(self, parameters: np.ndarray) -> LoopRates:
        """Return the largest of K's entries for the dual and the primary imaginary parts."""
        gains = pose_parameters(parameters).gain
        return LoopRates(position=gains[:, 5:8].max(axis=1), orientation=gains[:, 1:4].max(axis=1))

    def horizon(self, reference: Reference | None) -> float:
        """Return the end of the gain schedule, s."""
        return self.gain.end if isinstance(self.gain, Schedule) else 0.0

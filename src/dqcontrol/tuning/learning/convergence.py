"""Whether learning converges: from the model, before anything moves."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dqcontrol.arrays import Array
from dqcontrol.plants.linear_model import LinearModel
from dqcontrol.tuning.learning.loop_response import LoopShape

_FREQUENCIES = 240
_EVEN = 513  # frequencies, equally far apart
_LOWEST = 0.02  # Hz
_LEAST = 0.1  # Hz, of a cut-off
HIGHEST = 8.0  # Hz; bands above it were never tried
_GROWTH = 1.02  # of what is hardly learnt a repeat, at most: the guard on growing errors does the rest
_STEP = 1.05  # between cut-offs that are tried


@dataclass(frozen=True)
class Convergence:
    """The learning operator of a loop, and how errors change from repeat to repeat.

    w⁺ = w + Q L Q e with L = T̄*/(|T̄|² + ρ mean|T̄|²), T̄ from a shift of the reference to the end effector, the mean
    over the joints, and the low pass Q = 1/(1 + (f/f_c)⁴). With another plant's T the error of a frequency is
    multiplied by I − Q²LT: it shrinks where all eigenvalues lie inside the unit circle. The mean over frequencies is
    that without preview, with which all of them pass, and learning would be slower for nothing.

    Attributes
    ----------
    shape
        The law.
    models
        Of plants, the nominal one first.
    caution
        ρ.
    cutoff
        f_c, Hz.
    others
        Shapes that the loop may have as well.
    """

    shape: LoopShape
    models: tuple[LinearModel, ...]
    caution: float
    cutoff: float
    others: tuple[LoopShape, ...] = ()
    _known: dict[str, Any] = field(default_factory=dict, repr=False, compare=False)  # shared by all cut-offs

    def _once(self, name: str, make: Callable[[], Any]) -> Any:
        if name not in self._known:
            self._known[name] = make()
        return self._known[name]

    def low_pass(self, frequencies: Array) -> Array:
        """Return Q."""
        return 1 / (1 + (frequencies / self.cutoff) ** 4)

    def operator(self, frequencies: Array) -> NDArray[np.complex128]:
        """Return L at each frequency, Hz."""
        mean = self._mean(frequencies)
        return np.asarray(np.conj(mean) / (np.abs(mean) ** 2 + self.caution * self._power), np.complex128)

    def _mean(self, frequencies: Array) -> NDArray[np.complex128]:
        return self._mean_of(self.shape, frequencies)

    def _mean_of(self, shape: LoopShape, frequencies: Array) -> NDArray[np.complex128]:
        responses = shape.response(self.models[0], frequencies)
        return np.diagonal(responses, axis1=1, axis2=2).mean(axis=1)

    @property
    def _power(self) -> float:
        """Mean of |T̄|² over all frequencies up to half a sample rate, without preview."""
        shape = replace(self.shape, ahead=0, share=0.0)
        return self._once("power", lambda: float(np.mean(np.abs(self._mean_of(shape, self._even)) ** 2)))

    @property
    def _even(self) -> Array:
        return np.linspace(0, 0.5 / self.shape.period, _EVEN)

    def frequencies(self) -> Array:
        """Return where it is judged, Hz."""
        return np.geomspace(_LOWEST, 0.5 / self.shape.period, _FREQUENCIES)

    def factors(self) -> tuple[Array, Array]:
        """Return frequencies, Hz, and by what the error of each is multiplied in a repeat, of the worst plant."""
        frequencies = self.frequencies()
        operator = self._once("operator", lambda: self.operator(frequencies))
        responses = self._once(
            "responses",
            lambda: [
                shape.response(model, frequencies)
                for shape in (self.shape, *self.others)
                for model in self.models
            ],
        )
        weight = self.low_pass(frequencies) ** 2 * operator
        worst = np.zeros(len(frequencies))
        for response in responses:
            answer = weight[:, None, None] * response
            left = np.eye(answer.shape[1]) - answer
            worst = np.maximum(worst, np.abs(np.linalg.eigvals(left)).max(axis=1))
        return frequencies, worst

    @property
    def worst(self) -> tuple[float, float]:
        """The largest factor, and its frequency, Hz."""
        frequencies, factors = self.factors()
        place = int(factors.argmax())
        return float(factors[place]), float(frequencies[place])

    @property
    def breaks_at(self) -> float | None:
        """The lowest frequency at which errors grow, Hz; None if they do nowhere."""
        frequencies, factors = self.factors()
        grown = np.flatnonzero(factors > _GROWTH)
        return float(frequencies[grown[0]]) if len(grown) else None

    @property
    def noise_factor(self) -> float:
        """Standard deviation that white noise of a repeat's measurement adds to the next motion, over the noise's."""
        even = self._even
        answer = self.low_pass(even) ** 2 * self.operator(even) * self._mean(even)
        return float(np.sqrt(np.mean(np.abs(answer) ** 2)))


def widest(
    shape: LoopShape,
    models: Sequence[LinearModel],
    caution: float,
    *,
    highest: float,
    others: tuple[LoopShape, ...] = (),
) -> Convergence | None:
    """Return the operator with the highest cut-off at which no error grows; None if there is none from 0.1 Hz on."""
    found = Convergence(shape, tuple(models), caution, min(highest, 0.4 / shape.period), others)
    while found.cutoff >= _LEAST:
        if found.breaks_at is None:
            return found
        found = replace(found, cutoff=found.cutoff / _STEP)
    return None

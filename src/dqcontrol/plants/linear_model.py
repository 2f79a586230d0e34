"""A plant as its control loop sees it near a configuration: linear, in steps of a period."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class LinearModel:
    """x⁺ = A x + B u with the measured joint positions y as the first entries of x.

    One joint stands for all where they do not move each other; then u and y are single numbers.

    Attributes
    ----------
    transition
        A, shape (s, s).
    inputs
        B, shape (s, m), u in rad/s or m/s.

    Examples
    --------
    >>> import numpy as np
    >>> from dqcontrol.plants.linear_model import LinearModel
    >>> ideal = LinearModel(np.ones((1, 1)), np.full((1, 1), 0.01))
    >>> ideal.poles(150.0).real.round(6).tolist()
    [-0.5]
    """

    transition: Array
    inputs: Array

    def poles(self, gains: ArrayLike) -> NDArray[np.complex128]:
        """Return the poles of the loop u = −k y for each gain k (1/s, may be complex), shape (…, s)."""
        feedback = np.zeros_like(self.transition)
        feedback[:, : self.inputs.shape[1]] = self.inputs
        closed = self.transition - np.asarray(gains)[..., None, None] * feedback
        return np.linalg.eigvals(closed).astype(np.complex128)

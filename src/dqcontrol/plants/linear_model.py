"""A plant as its control loop sees it near a configuration: linear, in steps of a period."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dqcontrol.arrays import Array

_EACH = 24  # periods of a horizon that are looked at one by one, and again as many spread over the rest
_LEAST = 1e-10  # of the largest Hankel singular value

_STEP = 1e-4  # of an argument: slopes of this step and its double leave errors of the fourth order, 1e-16
_SMOOTH = 0.01  # of the largest slope: as much may slopes to both sides, or of different steps, differ
_ROUNDING = 1e-12  # of differences over `_STEP`: 1e-8 of a slope of 1


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
        if not np.isfinite(closed).all():  # no such loop keeps still
            return np.full(closed.shape[:-1], np.inf, np.complex128)
        return np.linalg.eigvals(closed).astype(np.complex128)

    def reduced(self, horizon: int) -> LinearModel | None:
        """Return a model that answers inputs in the same way with as few states as that takes.

        None if some measurements stay where they are whatever the inputs. The states that inputs hardly reach, or
        measurements hardly see, within a horizon are left out: those of small singular values of the Hankel matrix (Ho
        and Kalman 1966, Kung 1978).

        Parameters
        ----------
        horizon
            Number of periods in which what matters of a state is seen.
        """
        outputs = self.inputs.shape[1]
        # Discounted, lest an unstable state hide all others.
        transition = self.transition / max(1.0, np.abs(np.linalg.eigvals(self.transition)).max())
        seen, reached = [np.eye(outputs, len(self.transition))], [self.inputs]
        later = np.geomspace(_EACH, max(_EACH, horizon), _EACH).round().astype(int)
        times = np.union1d(np.arange(_EACH), later[later < horizon])
        for passed in np.diff(times):
            step = np.linalg.matrix_power(transition, passed)
            seen.append(seen[-1] @ step)
            reached.append(step @ reached[-1])
        observed, driven = np.vstack(seen), np.hstack(reached)
        left, sizes, right = np.linalg.svd(observed @ driven)
        count = int(np.count_nonzero(sizes > _LEAST * sizes[0]))
        root = np.sqrt(sizes[:count])
        into, out_of = left[:, :count].T @ observed / root[:, None], driven @ right[:count].T / root
        measured = out_of[:outputs]
        if count < outputs or np.linalg.matrix_rank(measured) < outputs:
            return None
        unseen = np.linalg.svd(measured)[2][outputs:]
        basis = np.vstack([measured, unseen])  # so that the measurements are the first entries
        into, out_of = basis @ into, np.linalg.solve(basis.T, out_of.T).T
        return LinearModel(into @ self.transition @ out_of, into @ self.inputs)


def smooth_slopes(function: Callable[[Array], Array], scale: Array) -> Array | None:
    """Return the derivatives of a function at zero by finite differences; None where it jumps or bends there.

    Parameters
    ----------
    function
        Of an array as ``scale``, to any array.
    scale
        Size of each argument, about 1.

    Examples
    --------
    >>> import numpy as np
    >>> from dqcontrol.plants.linear_model import smooth_slopes
    >>> smooth_slopes(lambda x: np.sin(3 * x), np.ones(1)).round(9).tolist(), smooth_slopes(np.abs, np.ones(1))
    ([[3.0]], None)
    """
    here, changes = function(np.zeros_like(scale)), _STEP * np.diag(scale)

    def moved(count: int, sign: int) -> Array:
        return np.column_stack([(function(sign * count * each) - here) / count for each in changes])

    ahead, behind, far_ahead, far_behind = (moved(count, sign) for count in (1, 2) for sign in (1, -1))
    slope, wide = (ahead - behind) / 2, (far_ahead - far_behind) / 2
    allowed = _SMOOTH * np.abs(slope).max(axis=1, keepdims=True) + _ROUNDING
    if (np.abs(ahead + behind) > allowed).any() or (np.abs(wide - slope) > allowed).any():
        return None
    return (4 * slope - wide) / 3 / (_STEP * scale)

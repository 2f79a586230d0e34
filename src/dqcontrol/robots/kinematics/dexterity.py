"""Dexterity of an end effector: manipulability, condition and singular directions of a configuration."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from dqcontrol.arrays import Array
from dqcontrol.errors import ShapeError, as_positive
from dqcontrol.robots.chain_robot import ChainRobot


class Dexterity(ChainRobot):
    """Measures of the end effector's Jacobian [ω ; ṗ], in rad and m: they change with the unit of length."""

    def manipulability(self, q: ArrayLike) -> Array:
        """Return m = √det(J Jᵀ), or √det(JᵀJ) with fewer than six joints, shape (…). [Yoshikawa 1985].

        It is the product of the singular values, zero where the arm is singular; with six joints or more J_w gives the
        same.

        Examples
        --------
        >>> import dqcontrol as dqc
        >>> bool(dqc.load_robot("iiwa7").manipulability([0] * 7) < 1e-9)  # stretched
        True
        """
        return np.prod(self._singular_values(q), axis=-1)

    def condition_number(self, q: ArrayLike) -> Array:
        """Return the largest singular value over the smallest, shape (…); inf where the smallest is zero."""
        values = self._singular_values(q)
        with np.errstate(divide="ignore"):
            return values[..., 0] / values[..., -1]

    def singular_directions(self, q: ArrayLike, threshold: float = 0.02) -> tuple[Array, Array]:
        """Return the directions in which the end effector can hardly move.

        Parameters
        ----------
        q
            One configuration, shape (n,), rad or m.
        threshold
            Singular values below it count, in units of the end effector's Jacobian (rad and m).

        Returns
        -------
        directions, singular_values
            Unit vectors [ω ; ṗ], inertial axes, shape (k, 6), and their singular values, shape (k,), smallest first.
            An arm of n < 6 joints has 6 − n directions of value zero anywhere.

        Raises
        ------
        ShapeError, ValueRangeError
            If q is not one configuration, or the threshold not positive.

        Examples
        --------
        >>> import dqcontrol as dqc
        >>> directions, values = dqc.load_robot("iiwa7").singular_directions([0] * 7)
        >>> len(values)  # stretched along z: no motion along z, none about x and y apart from moving sideways
        3
        """
        bound = as_positive("threshold", threshold)
        jacobian = self.hand_jacobian(q)
        if jacobian.ndim != 2:
            raise ShapeError(f"q: expected one configuration, got shape {np.shape(q)}")
        vectors, found, _ = np.linalg.svd(jacobian)
        values = np.zeros(6)
        values[: len(found)] = found
        chosen = np.flatnonzero(values < bound)[::-1]
        return vectors.T[chosen], values[chosen]

    def _singular_values(self, q: ArrayLike) -> Array:
        return np.asarray(np.linalg.svd(self.hand_jacobian(q), compute_uv=False), dtype=np.float64)

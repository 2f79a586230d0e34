"""Logarithms, exponentials, the group power and screw interpolation.

Three pairs exist and must not be mixed. The screw pair is the group's own: powers, interpolation, integration
of twists. The body pair decouples rotation and body-frame position, as feedback linearisation needs it. The
inertial pair is the one that DQ Robotics calls ``log`` and ``exp``.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dqcontrol.algebra import dual_quaternion_kernels as kernels
from dqcontrol.algebra.batch import apply, as_unit, index_of
from dqcontrol.arrays import Array
from dqcontrol.errors import ValueRangeError, as_array


def log_screw(x: ArrayLike) -> Array:
    """Return the group logarithm [a ; ½V⁻¹(2a)p] of poses: half the twist that reaches x in one second.

    Parameters
    ----------
    x
        Unit dual quaternions, shape (…, 8), m. x and −x have different logarithms; see `short`.

    Returns
    -------
    Array
        Shape (…, 6): half-angle vector a (|a| ≤ π, rad) and dual part (m).

    Raises
    ------
    ShapeError, ValueRangeError
        If x is not (…, 8), not finite, not unit, or has rotation −1, where every axis would do.

    Examples
    --------
    >>> log_screw([1.0, 0, 0, 0, 0, 0.5, 0, 0]).tolist()
    [0.0, 0.0, 0.0, 0.5, 0.0, 0.0]
    """
    return _log(kernels.log_screw, x)


def exp_screw(g: ArrayLike) -> Array:
    """Return the group exponential, shape (…, 8), of g, shape (…, 6), where the twist 2g leads in 1 s.

    Raises `ShapeError` or `ValueRangeError` if g is not (…, 6) or not finite.
    """
    return _exp(kernels.exp_screw, g)


def log_body(x: ArrayLike) -> Array:
    """Return the decoupled logarithm [a ; ½p_b], shape (…, 6), of poses (…, 8) [S17 3.13, with p_b for p].

    Raises the errors of `log_screw`.
    """
    return _log(kernels.log_body, x)


def exp_body(g: ArrayLike) -> Array:
    """Return P + εP g_D with P = exp(g_P), shape (…, 8), for g of shape (…, 6): the inverse of `log_body`.

    Raises `ShapeError` or `ValueRangeError` if g is not (…, 6) or not finite.
    """
    return _exp(kernels.exp_body, g)


def log_inertial(x: ArrayLike) -> Array:
    """Return the decoupled logarithm [a ; ½p], shape (…, 6), of poses (…, 8) [S17 3.13].

    Raises the errors of `log_screw`.
    """
    return _log(kernels.log_inertial, x)


def exp_inertial(g: ArrayLike) -> Array:
    """Return P + εg_D P with P = exp(g_P), shape (…, 8), of g, shape (…, 6): the inverse of `log_inertial`.

    Raises `ShapeError` or `ValueRangeError` if g is not (…, 6) or not finite.
    """
    return _exp(kernels.exp_inertial, g)


def power(x: ArrayLike, t: ArrayLike) -> Array:
    """Return the group power x^t = exp_screw(t log_screw x); power(x, 2) = x x.

    Parameters
    ----------
    x
        Unit dual quaternions, shape (…, 8), m.
    t
        Exponents, a number or shape (…); broadcast against the leading axes of x.

    Returns
    -------
    Array
        Shape (…, 8).

    Raises
    ------
    ShapeError, ValueRangeError
        As for `log_screw`; or if t is not finite or does not broadcast.

    Examples
    --------
    >>> power([1.0, 0, 0, 0, 0, 0.5, 0, 0], [0.0, 3.0])[:, 5].tolist()
    [0.0, 1.5]
    """
    out = apply(kernels.power, 8, x=as_unit("x", x), t=as_array("t", t)[..., None])
    return _defined(out)


def sclerp(x1: ArrayLike, x2: ArrayLike, t: ArrayLike) -> Array:
    """Return x1 short(x1* x2)^t: screw interpolation with constant twist, the short way round.

    Parameters
    ----------
    x1, x2
        Unit dual quaternions at t = 0 and t = 1, shape (…, 8), m.
    t
        A number or shape (…); broadcast against the leading axes. Beyond [0, 1] the screw continues.

    Returns
    -------
    Array
        Shape (…, 8). At t = 1 this is x2 or −x2, the same pose.

    Raises
    ------
    ShapeError, ValueRangeError
        If a shape is wrong, a value not finite, or x1 or x2 not unit.

    Examples
    --------
    >>> sclerp([1.0, 0, 0, 0, 0, 0, 0, 0], [1.0, 0, 0, 0, 0, 0.5, 0, 0], 0.5)[5].item()
    0.25
    """
    return apply(kernels.sclerp, 8, x1=as_unit("x1", x1), x2=as_unit("x2", x2), t=as_array("t", t)[..., None])


def _log(operation: Any, x: ArrayLike) -> Array:
    return _defined(apply(operation, 6, x=as_unit("x", x)))


def _exp(operation: Any, g: ArrayLike) -> Array:
    return apply(operation, 8, g=as_array("g", g, (6,)))


def _defined(out: Array) -> Array:
    """Raise where the logarithm does not exist."""
    bad = np.isnan(out[..., 0])
    if bad.any():
        raise ValueRangeError(
            f"x: rotation −1 (a full turn){index_of(bad)} has no logarithm, since every axis would do; "
            "use short(x), the same pose"
        )
    return out

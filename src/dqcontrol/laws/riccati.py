"""Weights of quadratic costs, and the solutions of their Riccati equations over time."""

from __future__ import annotations

import math
from typing import Annotated, Any

import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import OK, READ2, STATUS, WRITE, WRITE2, inline, kernel, types
from dqcontrol.errors import ShapeError, ValueRangeError, as_array
from dqcontrol.named_fields import CheckedFields

_LARGEST_WEIGHT = 1e100  # its square is finite
_SMALLEST_WEIGHT = 1e-100  # its inverse's square is finite
_LARGEST_PHASE = 0.25  # κh of a Runge–Kutta step; at 0.5 its decay factor is still right to 1e-4 of itself


class Steps(CheckedFields, frozen=True, forbid_unknown_fields=True):
    """A weight that is constant between given times: ``values[i]`` holds from ``times[i]`` on, the first before too.

    Parameters
    ----------
    times
        s, increasing.
    values
        A weight for each: number, diagonal or matrix.
    """

    times: Annotated[list[float], Meta(min_length=1, description="s, increasing")]
    values: Annotated[
        list[Any], Meta(min_length=1, description="number, diagonal or matrix from each time on")
    ]


def weight_matrix(field: str, value: Any, size: int, *, definite: bool) -> Array:
    """Return a symmetric weight matrix of a number, a diagonal or a matrix.

    Raises
    ------
    ShapeError, ValueRangeError
        If it has another shape, is not symmetric, or not positive (semi)definite.
    """
    array = as_array(field, value)
    if array.shape == ():
        array = float(array) * np.eye(size)
    elif array.shape == (size,):
        array = np.diag(array)
    elif array.shape != (size, size):
        raise ShapeError(
            f"{field}: expected a number, {size} diagonal entries or {size} × {size}, got {array.shape}"
        )
    if np.abs(array - array.T).max() > 1e-12 * max(np.abs(array).max(), 1e-300):
        raise ValueRangeError(
            f"{field}: must be symmetric; it differs from its transpose by {np.abs(array - array.T).max():g}"
        )
    if np.abs(array).max() > _LARGEST_WEIGHT:
        raise ValueRangeError(f"{field}: must be ≤ {_LARGEST_WEIGHT:g}, got {np.abs(array).max():g}")
    least = float(np.linalg.eigvalsh(array)[0])
    largest = float(np.abs(array).max())
    if least < -1e-12 * largest or (definite and least <= max(1e-12 * largest, _SMALLEST_WEIGHT)):
        raise ValueRangeError(
            f"{field}: must be positive {'' if definite else 'semi'}definite, got an eigenvalue of {least:g}"
        )
    return array


def weight_pieces(field: str, weight: Any, size: int, *, definite: bool) -> tuple[Array, Array]:
    """Return the times from which pieces hold, the first 0, and their matrices.

    Raises
    ------
    ShapeError, ValueRangeError
        As `weight_matrix`, and if times do not increase or match the values.
    """
    if not isinstance(weight, Steps):
        return np.zeros(1), weight_matrix(field, weight, size, definite=definite)[None]
    times = as_array(f"{field}.times", weight.times, (None,)).copy()
    if len(times) != len(weight.values):
        raise ShapeError(
            f"{field}: expected as many values as times, got {len(weight.values)} and {len(times)}"
        )
    if (np.diff(times) <= 0).any():
        raise ValueRangeError(f"{field}.times: must increase, got {weight.times}")
    times[0] = 0.0 if times[0] > 0 else times[0]
    matrices = [
        weight_matrix(f"{field}.values[{i}]", v, size, definite=definite) for i, v in enumerate(weight.values)
    ]
    return times, np.array(matrices)


def at_times(pieces: tuple[NDArray[Any], NDArray[Any]], times: Array) -> Array:
    """Return the matrix that holds at each time."""
    starts, matrices = pieces
    return matrices[np.clip(np.searchsorted(starts, times + 1e-9, side="right") - 1, 0, None)]


def steady_solution(weight: Array, control: Array) -> Array:
    """Return the positive definite P of P R⁻¹ P = Q: the infinite horizon without drift.

    Raises
    ------
    ValueRangeError
        If Q is singular: then some error is free of cost and nothing brings it back.
    """
    if np.linalg.eigvalsh(weight)[0] <= 1e-12 * np.abs(weight).max():
        raise ValueRangeError(
            "error_weight: must be positive definite where the horizon is infinite; 0 stabilises nothing"
        )
    root = _power(control, 0.5)
    inverse_root = _power(control, -0.5)
    return root @ _power(inverse_root @ weight @ inverse_root, 0.5) @ root


def backward_solution(weight: Array, control: Array, final: Array, to_go: Array) -> Array:
    """Return P of Ṗ = P R⁻¹ P − Q, P(t_f) = S, at times to go τ, shape (N, m, m): closed form, stable for any τ.

    With W = (R^-½ Q R^-½)^½, E = exp(−Wτ), G = W⁻¹(1 − exp(−2Wτ))/2, D = R^-½ S R^-½ − W:
    P = R^½ [W + E D (1 + G D)⁻¹ E] R^½.
    """
    root, inverse_root = _power(control, 0.5), _power(control, -0.5)
    values, vectors = np.linalg.eigh(inverse_root @ weight @ inverse_root)
    rates = np.sqrt(np.clip(values, 0.0, None))
    start = vectors.T @ inverse_root @ final @ inverse_root @ vectors - np.diag(rates)
    decay = np.exp(-rates * to_go[:, None])
    moving = rates > 1e-12
    safe = np.where(moving, rates, 1.0)
    gap = np.where(moving, -np.expm1(-2 * rates * to_go[:, None]) / (2 * safe), to_go[:, None])
    middle = start @ np.linalg.inv(np.eye(len(rates)) + gap[:, :, None] * start)
    inner = np.diag(rates) + decay[:, :, None] * middle * decay[:, None, :]
    basis = root @ vectors
    return basis @ inner @ basis.T


def piecewise_solution(
    weights: tuple[Array, Array], controls: tuple[Array, Array], final: Array, times: Array, horizon: float
) -> Array:
    """Return P at each time for piecewise constant Q and R: the closed form chained backwards."""
    edges = np.unique(np.concatenate([weights[0], controls[0], [horizon]]))
    edges = edges[(edges > 0) & (edges <= horizon)]
    out = np.empty((len(times), *final.shape))
    begin_of = np.concatenate([[0.0], edges[:-1]])
    for begin, end in zip(begin_of[::-1], edges[::-1], strict=True):
        q, r = (at_times(pieces, np.array([begin]))[0] for pieces in (weights, controls))
        inside = (times >= begin - 1e-9) & ((times < end - 1e-9) | (end == horizon))
        out[inside] = backward_solution(q, r, final, np.clip(end - times[inside], 0.0, None))
        final = backward_solution(q, r, final, np.array([end - begin]))[0]
    return out


def _power(matrix: Array, exponent: float) -> Array:
    values, vectors = np.linalg.eigh(matrix)
    return (vectors * np.clip(values, 0.0, None) ** exponent) @ vectors.T


SIZE = 8  # of the tracking problem; fixed, so that the compiler unrolls its sweep
WORK_SIZE = 7 * SIZE * SIZE + 6 * SIZE


@inline
def riccati_slope(p, xi, a, c, q, r_inverse, scratch, dp, dxi):
    """Write −Ṗ and −ξ̇ of the tracking problem ė = A e + u + c: backwards in time both decay.

    P is symmetric, so −Ṗ = B + Bᵀ + Q with B = P (A − ½R⁻¹P), and −ξ̇ = (A − R⁻¹P)ᵀ ξ + P c.
    """
    for i in range(SIZE):
        for j in range(SIZE):
            value = 0.0
            for k in range(SIZE):
                value += r_inverse[i, k] * p[k, j]
            scratch[i, j] = a[i, j] - 0.5 * value
    for i in range(SIZE):
        rate = 0.0
        for j in range(SIZE):
            value = 0.0
            for k in range(SIZE):
                value += p[i, k] * scratch[k, j]
            dp[i, j] = value
            rate += (2.0 * scratch[j, i] - a[j, i]) * xi[j] + p[i, j] * c[j]
        dxi[i] = rate
    for i in range(SIZE):
        for j in range(i + 1):
            dp[i, j] += dp[j, i] + q[i, j]
            dp[j, i] = dp[i, j]


MATRICES = types.Array(types.float64, 3, "C", readonly=True)
MATRICES_OUT = types.Array(types.float64, 3, "C")


@kernel(
    STATUS(MATRICES, READ2, MATRICES, MATRICES, READ2, types.float64, types.intp, MATRICES_OUT, WRITE2, WRITE)
)
def sweep(drifts, offsets, weights, control_inverses, final, period, substeps, out_p, out_xi, work):
    """Integrate the tracking Riccati equations backwards by fourth-order Runge–Kutta steps.

    Drifts A and offsets c are given at 2 · substeps points a period, so that every stage meets its own; weights at
    every period.
    """
    square = SIZE * SIZE
    p, trial = work[0:square].reshape(SIZE, SIZE), work[square : 2 * square].reshape(SIZE, SIZE)
    scratch = work[2 * square : 3 * square].reshape(SIZE, SIZE)
    slopes = work[3 * square : 7 * square].reshape(4, SIZE, SIZE)
    rest = work[7 * square :]
    xi, trial_xi, slopes_xi = rest[0:SIZE], rest[SIZE : 2 * SIZE], rest[2 * SIZE : 6 * SIZE].reshape(4, SIZE)
    count = out_p.shape[0]
    h = period / substeps
    for i in range(SIZE):
        xi[i] = 0.0
        for j in range(SIZE):
            p[i, j] = final[i, j]
            out_p[count - 1, i, j] = final[i, j]
        out_xi[count - 1, i] = 0.0
    for sample in range(count - 2, -1, -1):
        q, r_inverse = weights[sample], control_inverses[sample]
        for sub in range(substeps, 0, -1):
            late = 2 * (sample * substeps + sub)
            for stage in range(4):
                point = late if stage == 0 else (late - 2 if stage == 3 else late - 1)
                part = 0.0 if stage == 0 else (h if stage == 3 else 0.5 * h)
                before = max(stage - 1, 0)
                for i in range(SIZE):
                    trial_xi[i] = xi[i] + part * slopes_xi[before, i]
                    for j in range(SIZE):
                        trial[i, j] = p[i, j] + part * slopes[before, i, j]
                riccati_slope(
                    trial,
                    trial_xi,
                    drifts[point],
                    offsets[point],
                    q,
                    r_inverse,
                    scratch,
                    slopes[stage],
                    slopes_xi[stage],
                )
            for i in range(SIZE):
                xi[i] += (
                    h
                    / 6.0
                    * (slopes_xi[0, i] + 2.0 * slopes_xi[1, i] + 2.0 * slopes_xi[2, i] + slopes_xi[3, i])
                )
                for j in range(SIZE):
                    p[i, j] += (
                        h
                        / 6.0
                        * (slopes[0, i, j] + 2.0 * slopes[1, i, j] + 2.0 * slopes[2, i, j] + slopes[3, i, j])
                    )
        for i in range(SIZE):
            out_xi[sample, i] = xi[i]
            for j in range(SIZE):
                out_p[sample, i, j] = p[i, j]
    return OK


def substeps_for(weights: Array, controls: Array, final: Array, period: float) -> int:
    """Return how many Runge–Kutta steps a period needs: κh stays below its largest phase, κ² the top of R⁻¹Q."""
    fastest = 0.0
    for q, r in zip(weights, controls, strict=True):
        fastest = max(fastest, float(np.abs(np.linalg.eigvals(np.linalg.solve(r, q))).max()) ** 0.5)
        fastest = max(fastest, float(np.abs(np.linalg.eigvals(np.linalg.solve(r, final))).max()))
    return max(1, math.ceil(fastest * period / _LARGEST_PHASE))

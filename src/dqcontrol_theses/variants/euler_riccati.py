"""LQR in R⁸ whose Riccati equation is taken for a difference equation, as P16's program seems to have done."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numba import types

from dqcontrol.arrays import Array
from dqcontrol.compiled import OK, kernel
from dqcontrol.errors import ValueRangeError
from dqcontrol.laws import LinearQuadraticR8
from dqcontrol.laws.parts import at_times, moving_target, riccati_slope

if TYPE_CHECKING:
    from dqcontrol.references import Reference

SIZE = 8


def _floats(dimensions: int, *, written: bool = False) -> types.Array:
    return types.Array(types.float64, dimensions, "C", readonly=not written)


# drifts, offsets, weights, control inverses, final weight, period, P, ξ, work
SWEEP = types.intp(
    _floats(3),
    _floats(2),
    _floats(3),
    _floats(3),
    _floats(2),
    types.float64,
    _floats(3, written=True),
    _floats(2, written=True),
    _floats(1, written=True),
)


@kernel(SWEEP)
def sweep_by_euler(drifts, offsets, weights, control_inverses, final, period, out_p, out_xi, work):
    """Integrate the tracking Riccati equations backwards by one explicit Euler step a period, from its late end.

    So does a program that writes the equation as a difference; drifts, offsets and weights are given at every period.
    """
    square = SIZE * SIZE
    scratch, slope = work[0:square].reshape(SIZE, SIZE), work[square : 2 * square].reshape(SIZE, SIZE)
    slope_xi = work[2 * square : 2 * square + SIZE]
    count = out_p.shape[0]
    for i in range(SIZE):
        out_xi[count - 1, i] = 0.0
        for j in range(SIZE):
            out_p[count - 1, i, j] = final[i, j]
    for sample in range(count - 2, -1, -1):
        late = sample + 1
        riccati_slope(
            out_p[late],
            out_xi[late],
            drifts[late],
            offsets[late],
            weights[late],
            control_inverses[late],
            scratch,
            slope,
            slope_xi,
        )
        for i in range(SIZE):
            out_xi[sample, i] = out_xi[late, i] + period * slope_xi[i]
            for j in range(SIZE):
                out_p[sample, i, j] = out_p[late, i, j] + period * slope[i, j]
    return OK


class EulerLinearQuadraticR8(LinearQuadraticR8, frozen=True, kw_only=True, tag="linear-quadratic-r8-euler"):
    """LQR in R⁸ with one explicit Euler step of its Riccati equation a period, as P16 seems to solve it. [P16 3.44]

    It swings where √(q/r) T > 1, so that the gain is another one in every period, and diverges from 1.5 on. Without a
    horizon it is `LinearQuadraticR8`, whose steady solution it takes.

    Sampling limits, choice and parameters: those of `LinearQuadraticR8`.
    """

    def riccati_solution(
        self,
        weights: tuple[Array, Array],
        controls: tuple[Array, Array],
        final: Array,
        times: Array,
        end: float,
        reference: Reference | None,
    ) -> tuple[Array, Array]:
        """Return P and ξ at each time.

        Raises
        ------
        ValueRangeError
            If they diverge.
        """
        period = float(times[1] - times[0])
        inverses = at_times((controls[0], np.linalg.inv(controls[1])), times)
        solution, offset = np.empty((len(times), SIZE, SIZE)), np.empty((len(times), SIZE))
        drifts, offsets = moving_target(reference, times.copy())
        work = np.zeros(2 * SIZE * SIZE + SIZE)
        sweep_by_euler(
            drifts, offsets, at_times(weights, times), inverses, final, period, solution, offset, work
        )
        if not (np.isfinite(solution).all() and np.isfinite(offset).all()):
            raise ValueRangeError(
                "error_weight, control_weight: one explicit Euler step in each period diverges with these; "
                f"√(q/r) T must stay below 1.5 (T = {period:g} s), or take linear-quadratic-r8"
            )
        return solution, offset

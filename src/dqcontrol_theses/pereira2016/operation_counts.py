"""Cost of rigid motions as dual quaternions and as matrices, counted and timed. [P16 1.2.2, 2, 2.1.3]

The operations on dual quaternions are those of `dqcontrol.algebra`. A matrix is taken as its twelve free numbers, row
by row, or whole with its last row of 0, 0, 0, 1, as libraries of linear algebra multiply it.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from dqcontrol.algebra import apply
from dqcontrol.algebra.dual_quaternion_kernels import (
    conjugate,
    conjugate_multiply,
    multiply,
    position,
    rotated,
)
from dqcontrol.compiled import inline
from dqcontrol.tables import Cell, Column, Table

Operation = Callable[[Any, Any, Any], None]

_BATCH, _ROUNDS = 20_000, 15
DUAL_QUATERNION, WHOLE, TWELVE = "dual quaternion", "4 × 4", "twelve numbers"
_SIZES = {DUAL_QUATERNION: 8, WHOLE: 16, TWELVE: 12}


def _conjugate(a, b, out):
    conjugate(a, out)


def _moved(x, v, out):
    turned, here = rotated(x, v), position(x)
    for i in range(3):
        out[i] = turned[i] + here[i]


def _position(x, b, out):
    out[0], out[1], out[2] = position(x)


def _quaternion(x, b, out):
    for i in range(4):
        out[i] = x[i]


def _twelve_product(a, b, out):
    for i in range(0, 12, 4):
        for j in range(4):
            out[i + j] = a[i] * b[j] + a[i + 1] * b[4 + j] + a[i + 2] * b[8 + j]
        out[i + 3] += a[i + 3]


@inline
def _twelve_inverse(a, b, out):
    for i in range(3):
        for j in range(3):
            out[4 * i + j] = a[4 * j + i]
        out[4 * i + 3] = -(a[i] * a[3] + a[4 + i] * a[7] + a[8 + i] * a[11])


def _twelve_relative(a, b, out):
    x, y, z = b[3] - a[3], b[7] - a[7], b[11] - a[11]
    for i in range(3):
        for j in range(3):
            out[4 * i + j] = a[i] * b[j] + a[4 + i] * b[4 + j] + a[8 + i] * b[8 + j]
        out[4 * i + 3] = a[i] * x + a[4 + i] * y + a[8 + i] * z


def _twelve_moved(a, v, out):
    for i in range(3):
        k = 4 * i
        out[i] = a[k] * v[0] + a[k + 1] * v[1] + a[k + 2] * v[2] + a[k + 3]


def _matrix_position(a, b, out):
    out[0], out[1], out[2] = a[3], a[7], a[11]


def _matrix_quaternion(a, b, out):
    """Write the quaternion of a rotation of less than half a turn. [P16 B.2, and B.3 without its signs]"""
    out[0] = 0.5 * (a[0] + a[5] + a[10] + 1.0) ** 0.5
    scale = 0.25 / out[0]
    out[1], out[2], out[3] = scale * (a[9] - a[6]), scale * (a[2] - a[8]), scale * (a[4] - a[1])


def _whole_product(a, b, out):
    for i in range(0, 16, 4):
        for j in range(4):
            out[i + j] = a[i] * b[j] + a[i + 1] * b[4 + j] + a[i + 2] * b[8 + j] + a[i + 3] * b[12 + j]


def _whole_inverse(a, b, out):
    _twelve_inverse(a, b, out)
    out[12], out[13], out[14], out[15] = a[12], a[13], a[14], a[15]


def _whole_relative(a, b, out):
    """Write A⁻¹B, the product as that of all other matrices."""
    for i in range(3):
        last = -(a[i] * a[3] + a[4 + i] * a[7] + a[8 + i] * a[11])
        for j in range(4):
            out[4 * i + j] = a[i] * b[j] + a[4 + i] * b[4 + j] + a[8 + i] * b[8 + j] + last * b[12 + j]
    for j in range(4):
        out[12 + j] = a[12] * b[j] + a[13] * b[4 + j] + a[14] * b[8 + j] + a[15] * b[12 + j]


def _whole_moved(a, v, out):
    for i in range(0, 12, 4):
        out[i // 4] = a[i] * v[0] + a[i + 1] * v[1] + a[i + 2] * v[2] + a[i + 3] * v[3]
    out[3] = a[12] * v[0] + a[13] * v[1] + a[14] * v[2] + a[15] * v[3]


OPERATIONS: dict[str, dict[str, Operation]] = {
    "one motion after another": {
        DUAL_QUATERNION: multiply,
        WHOLE: _whole_product,
        TWELVE: _twelve_product,
    },
    "inverse": {DUAL_QUATERNION: _conjugate, WHOLE: _whole_inverse, TWELVE: _twelve_inverse},
    "difference of two poses": {
        DUAL_QUATERNION: conjugate_multiply,
        WHOLE: _whole_relative,
        TWELVE: _twelve_relative,
    },
    "a point moved": {DUAL_QUATERNION: _moved, WHOLE: _whole_moved, TWELVE: _twelve_moved},
    "position": {DUAL_QUATERNION: _position, WHOLE: _matrix_position, TWELVE: _matrix_position},
    "rotation as a quaternion": {
        DUAL_QUATERNION: _quaternion,
        WHOLE: _matrix_quaternion,
        TWELVE: _matrix_quaternion,
    },
}


class Cost(NamedTuple):
    """What an operation costs: additions, multiplications, divisions and roots together, and ns of one in a batch."""

    calculations: int
    time: float


class _Counted:
    """A number that counts the calculations that it takes part in; changes of sign are none."""

    def __init__(self) -> None:
        self.count = 0

    def _calculated(self, _: Any) -> _Counted:
        self.count += 1
        return self

    __add__ = __radd__ = __sub__ = __rsub__ = __mul__ = __rmul__ = __pow__ = __rtruediv__ = _calculated

    def __neg__(self) -> _Counted:
        return self


def count(operation: Operation) -> int:
    """Return how many additions, multiplications, divisions and roots an operation takes.

    Examples
    --------
    >>> count(multiply)  # 48 products and 40 sums
    88
    """
    one = _Counted()
    operation([one] * 16, [one] * 16, [one] * 16)
    return one.count


def measured(operation: Operation, size: int) -> float:
    """Return how long one operation takes in a compiled batch, ns: the least of some rounds."""
    rng = np.random.default_rng(0)
    a, b = rng.uniform(0.1, 1.0, (2, _BATCH, size))
    times = []
    for _ in range(_ROUNDS):
        start = time.perf_counter()
        apply(operation, 16, a=a, b=b)
        times.append(time.perf_counter() - start)
    return 1e9 * min(times) / _BATCH


def operation_costs() -> dict[str, dict[str, Cost]]:
    """Return the cost of each operation in each representation."""
    return {
        name: {
            kind: Cost(count(operation), measured(operation, _SIZES[kind]))
            for kind, operation in kinds.items()
        }
        for name, kinds in OPERATIONS.items()
    }


def operation_table(costs: dict[str, dict[str, Cost]]) -> Table:
    """Return one row an operation."""
    rows: list[list[Cell]] = [
        [name, *(kinds[kind].calculations for kind in _SIZES), *(kinds[kind].time for kind in _SIZES)]
        for name, kinds in costs.items()
    ]
    columns = [
        Column("Operation"),
        *(Column(f"{kind}, calculations") for kind in _SIZES),
        *(Column(kind, "ns", ".2g") for kind in _SIZES),
    ]
    return Table(columns, rows, "Rigid motions as dual quaternions and as matrices, on this machine")

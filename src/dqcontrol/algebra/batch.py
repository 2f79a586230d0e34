"""The inlined operations on batches: one compiled loop per number of operands."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import READ, READ2, WRITE, WRITE2, Kernel, kernel, types
from dqcontrol.compiled.intrinsics import ADDRESS, caller
from dqcontrol.errors import ShapeError, ValueRangeError, as_array

UNIT_TOLERANCE = 1e-6  # how far a value may be from unit norm where a pose is asked for
# the same of a quaternion written with four digits or more, which is then normalised
WRITTEN_TOLERANCE = 1e-3

_UNARY = types.void(READ, WRITE)
_BINARY = types.void(READ, READ, WRITE)
_TERNARY = types.void(READ, READ, READ, WRITE)
_call_unary, _call_binary, _call_ternary = caller(_UNARY), caller(_BINARY), caller(_TERNARY)


@kernel(types.void(ADDRESS, READ2, WRITE2))
def unary_batch(operation, a, out):
    """Apply an operation to every row."""
    for i in range(out.shape[0]):
        _call_unary(operation, a[i], out[i])


@kernel(types.void(ADDRESS, READ2, READ2, WRITE2))
def binary_batch(operation, a, b, out):
    """Apply an operation to every pair of rows; an operand of one row serves all."""
    step_a, step_b = int(a.shape[0] > 1), int(b.shape[0] > 1)
    for i in range(out.shape[0]):
        _call_binary(operation, a[i * step_a], b[i * step_b], out[i])


@kernel(types.void(ADDRESS, READ2, READ2, READ2, WRITE2))
def ternary_batch(operation, a, b, c, out):
    """Apply an operation to every triple of rows; an operand of one row serves all."""
    step_a, step_b, step_c = int(a.shape[0] > 1), int(b.shape[0] > 1), int(c.shape[0] > 1)
    for i in range(out.shape[0]):
        _call_ternary(operation, a[i * step_a], b[i * step_b], c[i * step_c], out[i])


@kernel(types.intp(READ2, types.float64))
def first_not_unit(x, tolerance):
    """Return the first row that is no unit dual quaternion, or −1."""
    for i in range(x.shape[0]):
        primary, dual, along = 0.0, 0.0, 0.0
        for k in range(4):
            primary += x[i, k] * x[i, k]
            dual += x[i, 4 + k] * x[i, 4 + k]
            along += x[i, k] * x[i, 4 + k]
        # For a large lever arm the round-off of ⟨P, D⟩ grows with |D|.
        if not (
            abs(math.sqrt(primary) - 1.0) <= tolerance and abs(along) <= tolerance * max(1.0, math.sqrt(dual))
        ):
            return i
    return -1


_SIGNATURES = {1: _UNARY, 2: _BINARY, 3: _TERNARY}
_BATCHES = {1: unary_batch, 2: binary_batch, 3: ternary_batch}


@cache
def _kernel(operation: Any, operands: int) -> Kernel:
    return Kernel(operation, _SIGNATURES[operands], strict=False)


def apply(operation: Any, size: int, **operands: Array) -> Array:
    """Return the operation on broadcast leading axes, shape (…, size); keywords name operands in errors."""
    compiled = _kernel(operation, len(operands))
    # one element: no need of a loop and a pointer
    if all(operand.ndim == 1 for operand in operands.values()):
        out = np.empty(size)
        compiled(*map(np.ascontiguousarray, operands.values()), out)
        return out
    batch_shape = broadcast_lead(**operands)
    rows = []
    for operand in operands.values():
        width = operand.shape[-1]
        if operand.size != width and operand.shape[:-1] != batch_shape:
            operand = np.broadcast_to(operand, (*batch_shape, width))
        rows.append(np.ascontiguousarray(operand).reshape(-1, width))
    out = np.empty((math.prod(batch_shape), size))
    _BATCHES[len(rows)](compiled.pointer, *rows, out)
    return out.reshape(*batch_shape, size)


def broadcast_lead(**operands: Array) -> tuple[int, ...]:
    """Return the common shape of the leading axes (all but the last), or an error naming the operands."""
    leads = [operand.shape[:-1] for operand in operands.values()]
    try:
        return np.broadcast_shapes(*leads)
    except ValueError:
        raise ShapeError(
            f"{', '.join(operands)}: batches of shapes {', '.join(map(str, leads))} do not broadcast"
        ) from None


def as_unit(field: str, value: ArrayLike) -> Array:
    """Return unit dual quaternions (…, 8), or raise an error naming the norm of the first that is not."""
    x = as_array(field, value, (8,))
    rows = np.ascontiguousarray(x).reshape(-1, 8)
    i = first_not_unit(rows, UNIT_TOLERANCE)
    if i >= 0:
        norm = float(np.linalg.norm(rows[i, :4]))
        dual = float(rows[i, :4] @ rows[i, 4:]) / norm if norm else 0.0
        where = index_of(np.arange(len(rows)).reshape(x.shape[:-1]) == i)
        raise ValueRangeError(
            f"{field}: expected a unit dual quaternion (norm 1), got norm {norm:.9g} + ε {dual:.6g}{where}"
        )
    return x


def index_of(bad: Any) -> str:
    """Return `` at index (…)`` of the first true element; nothing if there is but one."""
    return f" at index {tuple(map(int, np.argwhere(bad)[0]))}" if bad.ndim else ""

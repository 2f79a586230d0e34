"""Intrinsics that Numba's language lacks: calls by address, those of laws among them; matrices without checks."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

from numba import types

from dqcontrol.compiled.compile import INPUT, READ, READ2, STATUS, WRITE, WRITE2, numba_used

ADDRESS = types.intp  # of a kernel, as `Kernel.pointer` gives it


@cache
def caller(signature: Any) -> Callable[..., Any]:
    """Return what calls, in a kernel, the kernel of this signature at an `ADDRESS`, and in Python the kernel itself.

    To hand over a number from Python takes next to nothing, a value of Numba's function type 12 µs.
    """
    return numba_used.caller(signature)


@cache
def c_caller(signature: Any) -> Callable[..., Any]:
    """Return what calls, in a kernel, the C function at an `ADDRESS` that takes these numbers and returns nothing."""
    return numba_used.c_caller(signature)


def stack_array(count: int) -> Callable[[], Any]:
    """Return what makes, in a kernel, an array of so many numbers on the stack: kernels allocate no memory."""
    return numba_used.stack_array(count)


def as_matrix(array: Any, rows: int, columns: int) -> Any:
    """Return the numbers of an array, in C order, as rows and columns."""
    return array.reshape(rows, columns)


numba_used.define_as_matrix(as_matrix)


def as_row(array: Any, start: int, count: int) -> Any:
    """Return so many numbers of a contiguous array from ``start`` on; compiled, it trusts that there are as many."""
    return array[start : start + count]


numba_used.define_as_row(as_row)


# q, pose, room for a pose Jacobian, twist Jacobian, sample, parameters, state, work, out; work begins with the motion z
# that is preferred in the null space (m numbers), and the law answers u = z + J⁺(y − Jz). A law that needs the pose
# Jacobian fills its room by `fill_pose_jacobian`: most do not, and it is a tenth of a step.
LAW = STATUS(INPUT, WRITE, WRITE2, WRITE2, READ, READ, WRITE, WRITE, WRITE)

# kinematics, chain, q, sample, its number, twist Jacobian, what further tasks add to H (m × m numbers, or none), state
# (its end is the memory), parameters, work, command
CONSTRAINT = STATUS(ADDRESS, READ2, INPUT, READ, types.intp, READ2, READ, WRITE, READ, WRITE, WRITE)

call_law: Callable[..., Any] = caller(LAW)

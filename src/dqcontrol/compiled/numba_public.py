"""All of `numba_internals` by what Numba documents alone: slower, and compiled anew in each process.

Taken with ``DQCONTROL_NUMBA=plain`` in the environment, for a release of Numba that changed its internals.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from inspect import Parameter, Signature
from typing import Any

import numba
import numpy as np
from llvmlite.ir import FunctionType, VoidType
from numba import types
from numba.extending import intrinsic, overload

from dqcontrol.errors import Error

_OPTIONS = {"nogil": True, "error_model": "numpy"}
_c_functions: list[Any] = []  # whose addresses are in use


def jit(
    function: Callable[..., Any],
    fastmath: set[str] | bool,
    *,
    ours: bool,
    kept: bool = True,
    located: bool = False,
) -> Any:
    """Return a function's dispatcher."""
    return numba.njit(fastmath=fastmath, **_OPTIONS)(function)


def address_of(function: Callable[..., Any], dispatcher: Any, signature: Any) -> int:
    """Return the address of the function, compiled for C."""
    options = {name: dispatcher.targetoptions[name] for name in ("fastmath", "error_model")}
    _c_functions.append(numba.cfunc(signature, **options)(function))
    return _c_functions[-1].address


def bitcode_of(dispatcher: Any, signature: Any) -> tuple[bytes, str]:
    """Refuse: Numba documents no way to the code of a function."""
    raise Error("export: needs Numba's internals; unset DQCONTROL_NUMBA")


quick_compilation = scalar_code = nullcontext


def part_options(*, everywhere: bool, apart: bool = False, ours: bool = True) -> dict[str, Any]:
    """Return the options of a function that becomes part of kernels: none."""
    return {}


def caller(signature: Any) -> Callable[..., Any]:
    """Return what calls, in a kernel, the C function at an address, and in Python the kernel itself."""

    def call(function: Callable[..., Any], *arguments: Any) -> Any:
        return function(*arguments)

    def at(typing_context, address, *arguments):
        def generate(context, builder, call, arguments):
            is_void = signature.return_type is types.void
            result = VoidType() if is_void else context.get_value_type(signature.return_type)
            function = FunctionType(result, [context.get_value_type(each) for each in signature.args])
            found = builder.call(builder.inttoptr(arguments[0], function.as_pointer()), arguments[1:])
            return context.get_dummy_value() if is_void else found

        return signature.return_type(types.intp, *signature.args), generate

    names = ["typing_context", "address", *(f"argument{i}" for i in range(len(signature.args)))]
    at.__signature__ = Signature([Parameter(name, Parameter.POSITIONAL_ONLY) for name in names])
    called_at = intrinsic(at)

    @overload(call, strict=False)
    def _(address, *arguments):
        return lambda address, *arguments: called_at(address, *arguments)

    return call


c_caller = caller


def stack_array(count: int) -> Callable[[], Any]:
    """Return what makes an array of so many numbers."""

    def make() -> Any:
        return np.empty(count)

    @overload(make)
    def _():
        return lambda: np.empty(count)

    return make


def define_as_matrix(as_matrix: Callable[..., Any]) -> None:
    """Let kernels call this function."""

    @overload(as_matrix)
    def _(array, rows, columns):
        return lambda array, rows, columns: array.reshape(rows, columns)


def define_as_row(as_row: Callable[..., Any]) -> None:
    """Let kernels call this function."""

    @overload(as_row)
    def _(array, start, count):
        return lambda array, start, count: array[start : start + count]

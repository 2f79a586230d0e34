"""A plugin of pytest: all kernels run as plain Python, without a compiler, and call each other by address, too."""

from collections.abc import Callable
from functools import cached_property
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from dqcontrol.compiled.compile import numba_used

_kernels: list[Callable[..., Any]] = []


def _call_by_address(address: Any, *arguments: Any) -> Any:
    return _kernels[int(address) - 1](*arguments)


def _no_c_function(*_: Any) -> Any:
    pytest.skip("calls C by its address")


# Before the modules that ask for callers.
numba_used.caller = lambda signature: _call_by_address
numba_used.c_caller = lambda signature: _no_c_function

from dqcontrol.compiled import compile, intrinsics  # noqa: E402
from dqcontrol.compiled.compile import Kernel  # noqa: E402
from dqcontrol.compiled.memory_layout import MemoryLayout  # noqa: E402


def _quiet(kernel: Kernel) -> Callable[..., Any]:
    def call(*arguments: Any) -> Any:
        with np.errstate(all="ignore"):
            return kernel.function(*arguments)

    return call


def _address(kernel: Kernel) -> int:
    _kernels.append(kernel.function)
    return len(_kernels)


def _no_machine_code(*_: Any, **__: Any) -> Any:
    pytest.skip("looks at machine code")


for _name, _property in (("compiled", cached_property(_quiet)), ("pointer", cached_property(_address))):
    _property.__set_name__(Kernel, _name)
    setattr(Kernel, _name, _property)
Kernel.bitcode = _no_machine_code

_by_name = MemoryLayout.__call__


def _taken_apart(layout: MemoryLayout, memory: Any, *sizes: int) -> Any:
    """Take an array apart by what is written for kernels, which is quicker than the loop over fields."""
    return layout._taken_apart(memory, *sizes) if memory.ndim == 1 else _by_name(layout, memory, *sizes)


MemoryLayout.__call__ = _taken_apart


def _as_it_is(function: Callable[..., Any] | None = None, **_: Any) -> Any:
    return function or _as_it_is


# What a user wrote is not compiled either.
compile.numba = SimpleNamespace(njit=_as_it_is)


def _first_numbers(array: Any, rows: int, columns: int) -> Any:
    return array.reshape(-1)[: rows * columns].reshape(rows, columns)


# Kernels take a part of longer scratch without a look at its size.
intrinsics.as_matrix.__code__ = _first_numbers.__code__

"""A plugin of pytest: kernels of the packages that ``INTERPRETED`` names run as plain Python, without a compiler.

A test that needs the machine code of one of them, or of another kernel that is not in the cache, is skipped.
"""

import os
from functools import cached_property
from typing import Any

import pytest

from dqcontrol.compiled import kernel_cache
from dqcontrol.compiled.compile import Kernel
from dqcontrol.compiled.memory_layout import MemoryLayout

_PACKAGES = tuple(f"dqcontrol.{name}." for name in os.environ["INTERPRETED"].split(","))
_compiled, _pointer = Kernel.compiled.func, Kernel.pointer.func


class _Address(int):
    """An address that Python can call, as kernels do."""

    kernel: Kernel

    def __call__(self, *arguments: Any) -> Any:
        return self.kernel(*arguments)


def _is_interpreted(kernel: Kernel) -> bool:
    return kernel.function.__module__.startswith(_PACKAGES)


def _called(kernel: Kernel) -> Any:
    if _is_interpreted(kernel):
        return kernel.function
    if kernel._cached and not kernel_cache.is_kept(kernel.function):
        pytest.skip(f"{kernel.__name__} would be compiled")
    return _compiled(kernel)


def _address(kernel: Kernel) -> int:
    if _is_interpreted(kernel):
        pytest.skip(f"machine code of {kernel.__name__} is needed")
    address = _Address(_pointer(kernel))
    address.kernel = kernel
    return address


for _name, _property in (("compiled", cached_property(_called)), ("pointer", cached_property(_address))):
    _property.__set_name__(Kernel, _name)
    setattr(Kernel, _name, _property)

_by_name = MemoryLayout.__call__


def _taken_apart(layout: MemoryLayout, memory: Any, *sizes: int) -> Any:
    """Take an array apart by what is written for kernels, which is quicker than the loop over fields."""
    return layout._taken_apart(memory, *sizes) if memory.ndim == 1 else _by_name(layout, memory, *sizes)


MemoryLayout.__call__ = _taken_apart

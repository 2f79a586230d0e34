"""Numba's options, in one place.

A *kernel* is a function on plain float64 arrays with one declared signature. It is compiled on its first use,
not when it is imported, and its machine code is cached. From Python it is called like a function; other
compiled code receives it as a `pointer`, so that a loop is compiled once for all laws and plants, and the
interpreted loop runs the very same machine code. Small functions that kernels share are marked `inline`.
"""

from __future__ import annotations

import gc
import inspect
import os
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path
from traceback import extract_tb
from typing import Any

import numba
import numpy as np
from numba import types
from numba.extending import overload

from dqcontrol.compiled import kernel_cache
from dqcontrol.errors import DivergedError, Error, InterpretedWarning, ShapeError

# Internals that a new release of Numba lacks are not imported where its public part alone is asked for.
IS_PLAIN: bool = os.environ.get("DQCONTROL_NUMBA") == "plain"
if IS_PLAIN:
    from dqcontrol.compiled import numba_public as _used
else:
    from dqcontrol.compiled import numba_internals as _used

numba_used: Any = _used

FAST = {"contract", "reassoc", "nsz", "arcp"}  # NaN and infinity keep their meaning

INPUT = types.Array(types.float64, 1, "A", readonly=True)  # any layout, for arrays that users hand in
READ = types.Array(types.float64, 1, "C", readonly=True)
READ2 = types.Array(types.float64, 2, "C", readonly=True)
WRITE = types.Array(types.float64, 1, "C")
WRITE2 = types.Array(types.float64, 2, "C")
STATUS = types.intp

OK, WRONG_SIZE, NOT_FINITE, SINGULAR, RAISED = range(5)  # what a kernel returns


def inline(
    function: Callable[..., Any],
    fastmath: set[str] | bool = FAST,
    *,
    everywhere: bool = True,
    apart: bool = False,
) -> Any:
    """Mark a small function that kernels call; it becomes part of each of them, and stays plain Python in Python."""
    written_by(function, lambda: function, fastmath, everywhere=everywhere, apart=apart)
    return function


def written_by(
    called: Any,
    write: Callable[[], Callable[..., Any]],
    fastmath: set[str] | bool = FAST,
    *,
    everywhere: bool = True,
    apart: bool = False,
) -> None:
    """Let kernels call an object that has a name: the function that they call is written when they are compiled."""
    options: Any = {
        "fastmath": fastmath,
        "error_model": "numpy",
        **numba_used.part_options(everywhere=everywhere, apart=apart),
    }
    overload(called, jit_options=options, strict=False)(lambda *arguments, **named: write())


def shared(function: Callable[..., Any]) -> Any:
    """Mark a large function that kernels call seldom: each has it once, however often it calls, and compiles fast."""
    return inline(function, everywhere=False)


def apart(function: Callable[..., Any]) -> Any:
    """Mark a large function that kernels call on few samples: what it needs is not prepared on the others."""
    return inline(function, everywhere=False, apart=True)


def inline_ieee(function: Callable[..., Any]) -> Any:
    """Mark a small function whose sums may not be taken in another order, whatever its callers allow."""
    return inline(function, fastmath=False)


class Kernel:
    """A function with one signature, compiled on first use.

    Parameters
    ----------
    function
        The Python function.
    signature
        Its Numba signature.
    strict
        True for IEEE arithmetic without reassociation.
    cached
        False for functions whose changes would go unnoticed; those of a script or a notebook never are.

    Attributes
    ----------
    function, signature
        As given.
    plain
        The same of a user's function in Python, which says what it raises; None of others.
    """

    plain: InterpretedKernel | None = None

    def __init__(
        self, function: Callable[..., Any], signature: Any, *, strict: bool = False, cached: bool = True
    ) -> None:
        self.function = function
        self.signature = signature
        self._strict = strict
        self._cacheable = cached
        self._done = 0
        self.__doc__ = function.__doc__
        self.__name__: str = function.__name__

    def __call__(self, *arguments: Any) -> Any:
        """Call the compiled function."""
        return self.compiled(*arguments)

    @cached_property
    def _cached(self) -> bool:
        return self._cacheable and kernel_cache.has_source(self.function.__module__)

    @cached_property
    def compiled(self) -> Any:
        """The Numba dispatcher, compiled for the one signature; calling it saves 0.2 µs of calling the kernel."""
        fastmath = False if self._strict else FAST
        if self._cached:
            return _compile(self.function, self.signature, fastmath)
        return _compiled(self.function, self.signature, fastmath, cached=False)

    def worth_compiling(self, work: int, few: int) -> Callable[..., Any]:
        """Return the compiled function, or, as long as it is not and all its work was little, the one in Python.

        Parameters
        ----------
        work
            What it is to do now, in any unit.
        few
            How much Python does before the kernel is compiled, in the same.
        """
        self._done += work
        if self._done > few or "compiled" in vars(self) or self._is_kept:
            return self.compiled
        return _quiet(self.function)

    @cached_property
    def _is_kept(self) -> bool:
        return self._cached and kernel_cache.is_kept(self.function)

    @cached_property
    def pointer(self) -> int:
        """The address of the same machine code, for other kernels, which call it by ``caller``."""
        return numba_used.address_of(self.function, self.compiled, self.signature)

    def bitcode(self, *, portable: bool = False) -> tuple[bytes, str]:
        """Return LLVM's code of the kernel with all that it calls, and its name there.

        Parameters
        ----------
        portable
            False: what runs here, optimised for this processor. True: without vectors, for any processor.
        """
        if not portable:
            return numba_used.bitcode_of(self.compiled, self.signature)
        if not self._cached:
            return self._portable()
        with kernel_cache.one_process_at_a_time(self.function):
            if (found := kernel_cache.read_bitcode(self.function)) is None:
                found = self._portable()
                kernel_cache.keep_bitcode(self.function, found)
        return found

    def _portable(self) -> tuple[bytes, str]:
        fastmath = False if self._strict else FAST
        with numba_used.scalar_code(), numba_used.quick_compilation():
            dispatcher = numba_used.jit(self.function, fastmath, ours=self._cached, kept=False)
            dispatcher.compile(self.signature)
            return numba_used.bitcode_of(dispatcher, self.signature)


def _quiet(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return a function that warns of no division by zero, as its machine code does not."""

    def call(*arguments: Any) -> Any:
        with np.errstate(all="ignore"):
            return function(*arguments)

    return call


def kernel(signature: Any, *, strict: bool = False) -> Callable[[Callable[..., Any]], Kernel]:
    """Make a function a `Kernel` with this signature."""
    return lambda function: Kernel(function, signature, strict=strict)


def _compile(function: Callable[..., Any], signature: Any, fastmath: set[str] | bool) -> Any:
    kernel_cache.announce(function)
    try:
        if kernel_cache.is_kept(function):
            return _compiled(function, signature, fastmath)
        with kernel_cache.one_process_at_a_time(function):
            return _compiled(function, signature, fastmath)
    except Exception:
        if not kernel_cache.clear(function.__module__):
            raise
        # An index cut short by a full disk or a crash raises whatever unpickling it raises. If the fault is
        # not the cache's, the second attempt raises it again.
        return _compiled(function, signature, fastmath)


def _compiled(
    function: Callable[..., Any], signature: Any, fastmath: set[str] | bool, cached: bool = True
) -> Any:
    dispatcher = numba_used.jit(function, fastmath, ours=cached)
    with _without_collector(), numba_used.quick_compilation():
        dispatcher.compile(signature)
    dispatcher.disable_compile()
    return dispatcher


@contextmanager
def _without_collector() -> Iterator[None]:
    """Search for no garbage meanwhile: a compiler makes millions of objects, and keeps them."""
    collects = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collects:
            gc.enable()


class InterpretedKernel:
    """A user's function that does not compile, called in its place; it has no pointer.

    Attributes
    ----------
    reason
        Why it does not compile.
    of_spec
        Whether a spec named it: what it raises is then a user's mistake, told in a line, else that of a program.
    """

    def __init__(self, function: Callable[..., Any], reason: str, name: str, *, of_spec: bool) -> None:
        self.function = function
        self.reason = reason
        self.of_spec = of_spec
        self.__name__: str = name

    def __call__(self, *arguments: Any) -> int:
        """Call the function and return the status.

        Raises
        ------
        DivergedError
            If one that a spec named raises.
        """
        try:
            return self.function(*arguments)
        except Exception as error:
            if not self.of_spec or isinstance(error, Error):
                raise
            last = extract_tb(error.__traceback__)[-1]
            place = f"{Path(last.filename).name}, line {last.lineno}"
            raise DivergedError(
                f"function: {self.__name__} raised {type(error).__name__}: {error} ({place})"
            ) from error


def compile_own(
    function: Callable[..., Any],
    checked: Callable[[Callable[..., Any]], Callable[..., int]],
    guarded: Callable[[Callable[..., int]], Callable[..., int]],
    signature: Any,
    *,
    of_spec: bool,
) -> Kernel | InterpretedKernel:
    """Compile a user's function, or warn and wrap it to be interpreted.

    Parameters
    ----------
    function
        Plain Python.
    checked
        Makes of it (compiled or not) a function of the signature that also returns a status.
    guarded
        Makes of the compiled one a function that returns a status where that one raises: an exception does not pass
        through compiled loops.
    signature
        What to compile for.
    of_spec
        Whether a spec named it.

    Raises
    ------
    ShapeError
        If it takes other arguments.
    """
    name = str(getattr(function, "__name__", function))
    _check_arguments(function, name, list(inspect.signature(checked(function)).parameters))
    try:
        part = numba_used.part_options(everywhere=False, ours=False)
        compiled = numba.njit(**part)(
            checked(numba.njit(error_model="numpy", boundscheck=True, **part)(function))
        )
        compiled_kernel = Kernel(guarded(compiled), signature, strict=True, cached=False)
        _ = compiled_kernel.compiled
    except Exception as error:  # of bytecode that Numba does not know it raises what is no NumbaError
        lines = [line.strip() for line in str(error).splitlines() if line.strip()]
        reason = next((line for line in lines if "Failed in nopython" not in line), type(error).__name__)
        warnings.warn(
            f"{name}: does not compile ({reason[:160]}); the loop runs it interpreted",
            InterpretedWarning,
            stacklevel=4,
        )
        return InterpretedKernel(checked(function), reason, name, of_spec=of_spec)
    compiled_kernel.plain = InterpretedKernel(checked(function), "", name, of_spec=True)
    return compiled_kernel


def _check_arguments(function: Callable[..., Any], name: str, expected: list[str]) -> None:
    """Raise if a user's function cannot be called with these arguments."""
    try:
        taken = inspect.signature(function)
    except (TypeError, ValueError):  # of C code, which does not tell
        return
    try:
        taken.bind(*expected)
    except TypeError:
        raise ShapeError(
            f"function: {name}{taken} has to take {len(expected)} arguments: {', '.join(expected)}"
        ) from None

"""Numba's options and cache, in one place.

A *kernel* is a function on plain float64 arrays with one declared signature. It is compiled on its first use,
not when it is imported, and its machine code is cached. From Python it is called like a function; other
compiled code receives it as a `pointer`, so that a loop is compiled once for all laws and plants, and the
interpreted loop runs the very same machine code. Small functions that kernels share are marked `inlined`.

The cache folder is named after a hash of all package sources, of Numba's version and of the processor,
because Numba's own staleness check sees only the file of the function itself, not those of its callees.
"""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import sys
import tempfile
import warnings
from collections.abc import Callable
from functools import cached_property
from pathlib import Path
from typing import Any

import llvmlite.binding
import numba
from numba import types
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.errors import NumbaError
from numba.extending import register_jitable

from dqcontrol.errors import CacheWarning, InterpretedWarning

# Kernels allocate nothing, so they do without Numba's reference counts (`_nrt=False`), which would cost a third of
# their time; a user's own function may allocate.
FAST = {"contract", "reassoc", "nsz", "arcp"}  # NaN and infinity keep their meaning

INPUT = types.Array(types.float64, 1, "A", readonly=True)  # any layout, for arrays that users hand in
READ = types.Array(types.float64, 1, "C", readonly=True)
READ2 = types.Array(types.float64, 2, "C", readonly=True)
WRITE = types.Array(types.float64, 1, "C")
WRITE2 = types.Array(types.float64, 2, "C")
STATUS = types.intp

OK, WRONG_SIZE, NOT_FINITE, SINGULAR, RAISED = range(5)  # what a kernel returns

_KEPT_CACHES = 4


def _processor() -> str:
    """Return which processor's instructions machine code uses: this one's, or that of ``NUMBA_CPU_NAME``."""
    return numba.config.CPU_NAME or llvmlite.binding.get_host_cpu_name()  # type: ignore[attr-defined]


def source_hash() -> str:
    """Return a hash of all that machine code depends on: this package's sources, Numba, Python and the processor."""
    digest = hashlib.sha256(f"{numba.__version__} {sys.version} {_processor()}".encode())
    root = Path(__file__).parent
    for path in sorted(root.rglob("*.py")):
        digest.update(str(path.relative_to(root)).encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def _cache_root() -> Path:
    if chosen := os.environ.get("DQCONTROL_CACHE"):
        return Path(chosen)
    if sys.platform == "win32":
        base = Path(os.environ.get("LOCALAPPDATA", Path.home() / "AppData" / "Local"))
    elif sys.platform == "darwin":
        base = Path.home() / "Library" / "Caches"
    else:
        base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return base / "dqcontrol"


def _writable_cache() -> Path | None:
    root = _cache_root()
    folder = root / source_hash()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
        caches = (
            p for p in root.iterdir() if re.fullmatch("[0-9a-f]{16}", p.name) and p.is_dir() and p != folder
        )
        others = sorted(caches, key=lambda p: p.stat().st_mtime)  # names of hashes only: the rest is not ours
        for old in others[: -(_KEPT_CACHES - 1)]:
            shutil.rmtree(old, ignore_errors=True)
    except (OSError, RuntimeError):  # RuntimeError: no home folder
        return None
    return folder


def cache_state() -> tuple[Path, bool, int]:
    """Return the cache folder, whether it can be written, and how many kernels lie in it."""
    folder = _cache or _cache_root()
    return folder, _cache is not None, len(list(_cache.glob("*/*.nbi"))) if _cache else 0


_cache = _writable_cache()
_warned = False
_announced = False


def _jit(function: Callable[..., Any], fastmath: set[str] | bool, cached: bool) -> Any:
    previous = numba.config.CACHE_DIR  # type: ignore[attr-defined]
    numba.config.CACHE_DIR = str(_cache) if _cache else previous  # type: ignore[attr-defined]
    try:
        return numba.njit(  # type: ignore[call-overload] — the stubs lack `_nrt`
            cache=cached and _cache is not None,
            fastmath=fastmath,
            nogil=True,
            error_model="numpy",
            _nrt=not cached,
            no_cfunc_wrapper=True,
        )(function)
    finally:
        numba.config.CACHE_DIR = previous  # type: ignore[attr-defined]


class _Part(JITCodeLibrary):
    """Code that becomes part of kernels: by itself it is neither optimised nor made into machine code."""

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        """Hand the engine no code, only the variable that Numba sets for each function."""
        code = self._final_module
        names = (variable.name for variable in code.global_variables)
        variables = [f'@"{name}" = common global i8* null' for name in names if "NumbaEnv" in name]
        self._final_module = llvmlite.binding.parse_assembly("\n".join(variables))
        super()._finalize_final_module()
        self._final_module = code


class _PartCompiler(Compiler):
    """Compile a function into a `_Part`; otherwise every caller would optimise all below it again."""

    def define_pipelines(self) -> list[Any]:
        self.state.library = _Part(self.state.targetctx.codegen(), self.state.func_id.func_qualname)
        return super().define_pipelines()


def inlined(
    function: Callable[..., Any], fastmath: set[str] | bool = FAST, *, everywhere: bool = True
) -> Any:
    """Mark a small function that kernels call; it becomes part of each of them, and stays plain Python in Python."""
    return register_jitable(
        fastmath=fastmath,
        error_model="numpy",
        _nrt=False,
        pipeline_class=_PartCompiler,
        no_cfunc_wrapper=True,
        forceinline=everywhere,  # between functions every array is seven numbers on the stack
    )(function)


def attached(function: Callable[..., Any]) -> Any:
    """Mark a large function that kernels call seldom: each has it once, however often it calls, and compiles fast."""
    return inlined(function, everywhere=False)


def strictly_inlined(function: Callable[..., Any]) -> Any:
    """Mark a small function whose sums may not be taken in another order, whatever its callers allow."""
    return inlined(function, fastmath=False)


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
        False for functions that are not this package's: their changes would go unnoticed.
    """

    def __init__(
        self, function: Callable[..., Any], signature: Any, *, strict: bool = False, cached: bool = True
    ) -> None:
        self.function = function
        self._signature = signature
        self._strict = strict
        self._cached = cached
        self.__doc__ = function.__doc__
        self.__name__ = function.__name__

    def __call__(self, *arguments: Any) -> Any:
        """Call the compiled function."""
        return self.compiled(*arguments)

    @cached_property
    def compiled(self) -> Any:
        """The Numba dispatcher, compiled for the one signature; calling it saves 0.2 µs of calling the kernel."""
        fastmath = False if self._strict else FAST
        if self._cached:
            return _compile(self.function, self._signature, fastmath)
        return _compiled(self.function, self._signature, fastmath, cached=False)

    @cached_property
    def pointer(self) -> int:
        """The address of the same machine code, for other kernels, which call it by `caller`."""
        result = self.compiled.get_compile_result(self._signature)
        return result.library.get_pointer_to_function(result.fndesc.llvm_func_name)


def kernel(signature: Any, *, strict: bool = False) -> Callable[[Callable[..., Any]], Kernel]:
    """Make a function a `Kernel` with this signature."""
    return lambda function: Kernel(function, signature, strict=strict)


def _compile(function: Callable[..., Any], signature: Any, fastmath: set[str] | bool) -> Any:
    _announce(function)
    try:
        return _compiled(function, signature, fastmath)
    except Exception:
        if _cache is None:
            raise
        # An index cut short by a full disk or a crash raises whatever unpickling it raises. If the fault is
        # not the cache's, the second attempt raises it again.
        shutil.rmtree(_cache, ignore_errors=True)
        _cache.mkdir(parents=True, exist_ok=True)
        return _compiled(function, signature, fastmath)


def _compiled(
    function: Callable[..., Any], signature: Any, fastmath: set[str] | bool, cached: bool = True
) -> Any:
    dispatcher = _jit(function, fastmath, cached)
    dispatcher.compile(signature)
    dispatcher.disable_compile()
    return dispatcher


class InterpretedKernel:
    """A user's function that does not compile, called in its place; it has no pointer.

    Attributes
    ----------
    reason
        Why it does not compile.
    """

    def __init__(self, function: Callable[..., Any], reason: str) -> None:
        self.function = function
        self.reason = reason
        self.__name__ = function.__name__

    def __call__(self, *arguments: Any) -> int:
        """Call the function and return the status."""
        return self.function(*arguments)


def compile_own(
    function: Callable[..., Any],
    checked: Callable[[Callable[..., Any]], Callable[..., int]],
    guarded: Callable[[Callable[..., int]], Callable[..., int]],
    signature: Any,
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
    """
    try:
        compiled = numba.njit(checked(numba.njit(error_model="numpy")(function)))
        own = Kernel(guarded(compiled), signature, strict=True, cached=False)
        _ = own.compiled
    except NumbaError as error:
        lines = [line.strip() for line in str(error).splitlines() if line.strip()]
        reason = next((line for line in lines if "Failed in nopython" not in line), type(error).__name__)
        warnings.warn(
            f"{getattr(function, '__name__', function)}: does not compile ({reason[:160]}); "
            "the loop runs it interpreted",
            InterpretedWarning,
            stacklevel=4,
        )
        return InterpretedKernel(checked(function), reason)
    return own


def _announce(function: Callable[..., Any]) -> None:
    global _warned, _announced
    if _cache is None:
        if not _warned:
            _warned = True
            warnings.warn(
                f"cannot write to {_cache_root()}: kernels are compiled anew in each process; "
                "set DQCONTROL_CACHE to a writable folder",
                CacheWarning,
                stacklevel=5,
            )
    elif not _announced and not any(_cache.glob(f"*/*{function.__name__}-*.nbi")):
        _announced = True
        print(
            "dqcontrol: compiling kernels for their first use (up to a minute) …", file=sys.stderr, flush=True
        )

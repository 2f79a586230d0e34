"""Users' own laws for C: compiled without what only Python has, or refused with the line that needs it."""

from __future__ import annotations

import ast
import inspect
import linecache
import re
import textwrap
import warnings
from collections.abc import Callable
from typing import Any

import llvmlite.binding as llvm
from numba.core.errors import NumbaDebugInfoWarning, NumbaError

from dqcontrol.compiled.compile import Kernel
from dqcontrol.compiled.numba_choice import numba_used
from dqcontrol.compiled.object_code import foreign_symbols, isolated_code, target_named
from dqcontrol.errors import Error
from dqcontrol.extensions.user_code import function_at
from dqcontrol.laws import OwnLaw
from dqcontrol.laws.law import LAW
from dqcontrol.laws.own_law import finite_checked

_ADVICE = "write loops over plain numbers, and take 'scratch' for arrays of your own"


class _OwnKernel(Kernel):
    """A user's function without reference counts and without the guard that catches what it raises."""

    def __init__(self, function: Callable[..., Any], *, as_in_python: bool = False) -> None:
        inner = numba_used.jit(function, False, ours=not as_in_python, kept=False, located=as_in_python)
        super().__init__(finite_checked(inner), LAW, strict=True, cached=False)
        self.__name__, self._as_in_python = function.__name__, as_in_python

    def bitcode(self, *, portable: bool = False) -> tuple[bytes, str]:
        """Return LLVM's code; it has no vectors: its sums keep their order."""
        with numba_used.scalar_code(), numba_used.quick_compilation():
            dispatcher = numba_used.jit(
                self.function, False, ours=not self._as_in_python, kept=False, located=self._as_in_python
            )
            dispatcher.compile(self.signature)
            return numba_used.bitcode_of(dispatcher, self.signature)


def own_law_kernel(law: OwnLaw) -> Kernel:
    """Return the kernel of a user's law for C.

    Raises
    ------
    Error
        If it raises, or needs what only Python has; it says what, and which line.
    """
    function = function_at("function", law.function)
    _check_raises_nothing(function)
    native = target_named("native")
    try:
        kernel = _OwnKernel(function)
        foreign = foreign_symbols(isolated_code(*kernel.bitcode(), "own", native))
    except NumbaError:  # an array that is made needs reference counts
        foreign = []
    else:
        if not foreign:
            return kernel
    with warnings.catch_warnings():
        warnings.simplefilter(
            "ignore", NumbaDebugInfoWarning
        )  # of expressions that Numba makes into functions
        code, name = _OwnKernel(function, as_in_python=True).bitcode()
    symbols = [
        symbol
        for symbol in foreign_symbols(isolated_code(code, name, "own", native))
        if symbol != "_Py_NoneStruct"
    ]
    where, symbol = _line_of(code, symbols or foreign, function)
    raise Error(f"law: {where} needs {symbol}, which only Python has: {_ADVICE}")


def _check_raises_nothing(function: Callable[..., Any]) -> None:
    """Raise an `Error` at a statement that raises: C would go on with what the law wrote before it."""
    file = inspect.getsourcefile(function) or ""
    lines, first = inspect.getsourcelines(function)
    for node in ast.walk(ast.parse(textwrap.dedent("".join(lines)))):
        if isinstance(node, ast.Raise | ast.Assert):
            line = first + node.lineno - 1
            raise Error(
                f"law: {file}:{line}: '{linecache.getline(file, line).strip()}' raises, which C does not; "
                "write NaN into 'out' there: the controller then says so, and its supervisor stops"
            )


def _line_of(code: bytes, symbols: list[str], function: Callable[..., Any]) -> tuple[str, str]:
    """Return the line of a function that first needs one of these symbols, and which."""
    file = inspect.getsourcefile(function) or ""
    lines, first = inspect.getsourcelines(function)
    text = str(llvm.parse_bitcode(code))
    places = dict(re.findall(r"^(!\d+) = (?:distinct )?!DILocation\((.*)\)$", text, re.MULTILINE))
    found: list[tuple[int, str]] = []
    for symbol in symbols:
        for place in re.findall(rf'@"?{re.escape(symbol)}"?\(.*!dbg (!\d+)', text):
            line = _own_line(places, place, range(first, first + len(lines)))
            if line:
                found.append((line, symbol))
    if not found:
        return f"{file}:{first}: {function.__name__}", ", ".join(symbols) or "memory from Python"
    line, symbol = min(found)
    return f"{file}:{line}: '{linecache.getline(file, line).strip()}'", symbol


def _own_line(places: dict[str, str], place: str, allowed: range) -> int:
    """Return the line that a place belongs to, or what it was inlined into, within the user's function; 0 if none."""
    while place:
        about = places.get(place, "")
        line = re.search(r"line: (\d+)", about)
        if line and int(line[1]) in allowed:
            return int(line[1])
        outer = re.search(r"inlinedAt: (!\d+)", about)
        place = outer[1] if outer else ""
    return 0

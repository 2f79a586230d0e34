"""A plugin of pytest: make one slip of a package at a time; do the tests that run its line see it?

Tests are collected once. Each slip is made in a fork, in the code of functions or in a module's constants, and the
tests that reach its lines run there, the quickest first. No file is written.
"""

import ast
import gc
import importlib
import json
import math
import os
import pickle
import random
import signal
import sys
import tempfile
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import partial
from itertools import accumulate
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any

import pytest
from _pytest.runner import runtestprotocol
from hypothesis.internal.conjecture.engine import ConjectureRunner

_LONGEST = 15  # s that one test may take as plain Python; longer ones are left out, and are said to be
_ENOUGH = 30  # s of tests for one slip: it is seen in the first of them, or hardly ever
_SLOWER = 3  # times as long as without the slip, and 5 s more, is a loop without end

# What a failing example looks like nobody reads here.
ConjectureRunner.shrink_interesting_examples = lambda self: None

Slip = dict[str, Any]
Lines = dict[tuple[str, int], list[int]]  # of a file and a line, the numbers of the tests that run it


def pytest_addoption(parser: pytest.Parser) -> None:
    """Take what to try from the command line."""
    parser.addoption("--slips", help="what tools/mutants/slips.py listed")
    parser.addoption("--seen", default="seen.jsonl", help="where to write what became of each, line by line")
    parser.addoption("--sample", type=int, default=0, help="try so many at random; 0: all")


def pytest_runtestloop(session: pytest.Session) -> bool:
    """Try all slips, in random order, in place of running the tests once."""
    option = session.config.getoption
    slips = json.loads(Path(option("--slips")).read_text())
    random.Random(39).shuffle(slips)
    slips = slips[: option("--sample") or None]
    reached, seconds = _reached(session.items, {os.path.abspath(slip["path"]) for slip in slips})
    counts: Counter[str] = Counter()
    unseen = []
    with Path(option("--seen")).open("w") as seen:
        for slip in slips:
            outcome, by = _tried(slip, session.items, reached, seconds)
            counts[outcome] += 1
            print(json.dumps(slip | {"outcome": outcome, "by": by}), file=seen, flush=True)
            if outcome != "seen":
                unseen.append(
                    f"{slip['path']}:{slip['first'] + 1}: {outcome} ({by}): {' '.join(slip['lines']).strip()}"
                )
            print(f"\r{counts.total()} of {len(slips)}: {dict(counts)}", end="", flush=True)
    print("", *sorted(unseen), sep="\n")
    return True


def _reached(items: list[pytest.Item], paths: set[str]) -> tuple[Lines, list[float]]:
    """Return which tests run each line of these files, and how long each takes."""
    reached: Lines = defaultdict(list)
    seconds, left_out = [math.inf] * len(items), []
    for k, item in enumerate(items):
        found = _forked(partial(_traced, item, paths), _LONGEST)
        if found is None:
            left_out.append(item.nodeid)
            continue
        seconds[k], lines = found
        for line in lines:
            reached[line].append(k)
    print(f"{len(items)} tests; these fail, skip or take longer than {_LONGEST} s:", *left_out, sep="\n  ")
    return reached, seconds


def _traced(item: pytest.Item, paths: set[str]) -> tuple[float, set[tuple[str, int]]] | None:
    lines: set[tuple[str, int]] = set()

    def line(frame: Any, event: str, _: Any) -> Any:
        lines.add((frame.f_code.co_filename, frame.f_lineno))
        return line

    def call(frame: Any, event: str, _: Any) -> Any:
        return line(frame, event, _) if frame.f_code.co_filename in paths else None

    sys.settrace(call)
    began = time.perf_counter()
    passed = _passes(item, None)
    sys.settrace(None)
    return (time.perf_counter() - began, lines) if passed else None


def _passes(item: pytest.Item, after: pytest.Item | None) -> bool:
    return all(report.passed for report in runtestprotocol(item, log=False, nextitem=after))


def _forked(function: Callable[[], Any], limit: float) -> Any:
    """Return what a function returns in a fork; None if it takes longer or ends the process."""
    with tempfile.NamedTemporaryFile() as file:
        if not (child := os.fork()):
            with suppress(BaseException):
                os.setpgid(0, 0)
                sink = os.open(os.devnull, os.O_WRONLY)
                os.dup2(sink, 1)
                os.dup2(sink, 2)
                Path(file.name).write_bytes(pickle.dumps(function()))
            os._exit(0)
        ends = time.monotonic() + limit
        while os.waitpid(child, os.WNOHANG) == (0, 0):
            if time.monotonic() > ends:
                with suppress(ProcessLookupError):
                    os.killpg(child, signal.SIGKILL)
                os.waitpid(child, 0)
                return None
            time.sleep(0.005)
        data = Path(file.name).read_bytes()
    return pickle.loads(data) if data else None


def _tried(slip: Slip, items: list[pytest.Item], reached: Lines, seconds: list[float]) -> tuple[str, str]:
    """Return what became of a slip, and which test saw it."""
    path = Path(slip["path"]).resolve()
    lines = path.read_text().splitlines()
    changed = "\n".join([*lines[: slip["first"]], *slip["lines"], *lines[slip["last"] :]]) + "\n"
    try:
        old, new = (compile(text, str(path), "exec") for text in (path.read_text(), changed))
    except SyntaxError:
        return "not tried", "no Python any more"
    pairs = [(a, b) for a, b in _pairs(old, new) if not _same(a, b)]
    if pairs and all(a.co_flags & 0x2 and "__qualname__" not in a.co_names for a, _ in pairs):  # CO_NEWLOCALS
        places = {(str(path), number + 1) for number in range(slip["first"], slip["last"])} & reached.keys()
        if not places:  # within a statement of several lines, of which not each counts as run
            places = {(str(path), number) for a, _ in pairs for *_, number in a.co_lines()}
        apply = partial(_swap, {_place(a): b for a, b in pairs})
    else:
        statement = _constant(slip, lines)
        if statement is None:
            return "not tried", "neither in a function nor a constant"
        places = {place for place in reached if place[0] == str(path)}  # none, of a file of constants alone
        module = importlib.import_module(".".join(path.with_suffix("").parts[path.parts.index("src") + 1 :]))
        apply = partial(_assign, module, changed, statement)
    passing = [k for k in range(len(items)) if seconds[k] < math.inf]
    running = {k for place in places for k in reached.get(place, ())} if places else passing
    tests = sorted(running, key=seconds.__getitem__)
    if not tests:
        return "unreached", "no test runs it"
    long = accumulate(seconds[k] for k in tests)
    chosen = [(items[k], seconds[k]) for k, until in zip(tests, long, strict=True) if until < _ENOUGH]
    found = _forked(partial(_first_failing, apply, chosen), _SLOWER * _ENOUGH + 5)
    if found is None:
        return "seen", "no end, or the end of the process"
    return ("seen", found) if found else ("unseen", f"{len(chosen)} of {len(tests)} tests")


def _first_failing(apply: Callable[[], object], chosen: list[tuple[pytest.Item, float]]) -> str:
    apply()
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    for (item, seconds), (after, _) in zip(chosen, [*chosen[1:], (None, 0)], strict=True):
        signal.setitimer(signal.ITIMER_REAL, _SLOWER * seconds + 5)
        if not _passes(item, after):
            return item.nodeid
    return ""


def _same(a: CodeType, b: CodeType) -> bool:
    def plain(code: CodeType) -> list[tuple[type, str]]:
        return [(type(each), repr(each)) for each in code.co_consts if not isinstance(each, CodeType)]

    return a.co_code == b.co_code and plain(a) == plain(b) and a.co_names == b.co_names


def _pairs(a: CodeType, b: CodeType) -> Iterator[tuple[CodeType, CodeType]]:
    """Yield a piece of code and each function in it, before and after."""
    yield a, b
    insides = [[each for each in code.co_consts if isinstance(each, CodeType)] for code in (a, b)]
    for one, other in zip(*insides, strict=True):
        yield from _pairs(one, other)


def _place(code: CodeType) -> tuple[str, str, int]:
    return code.co_filename, code.co_qualname, code.co_firstlineno


def _swap(after: dict[tuple[str, str, int], CodeType]) -> None:
    """Give each function that has one of these pieces of code, or makes functions of one, the other."""
    files = {file for file, *_ in after}

    def renewed(code: CodeType) -> CodeType:
        if new := after.get(_place(code)):
            return new
        inside = tuple(renewed(each) if isinstance(each, CodeType) else each for each in code.co_consts)
        is_same = all(a is b for a, b in zip(inside, code.co_consts, strict=True))
        return code if is_same else code.replace(co_consts=inside)

    for each in gc.get_objects():
        if isinstance(each, FunctionType) and each.__code__.co_filename in files:
            each.__code__ = renewed(each.__code__)


def _constant(slip: Slip, lines: list[str]) -> int | None:
    """Return which statement of a module a slip is in, if that assigns names."""
    for k, statement in enumerate(ast.parse("\n".join(lines)).body):
        if statement.lineno - 1 <= slip["first"] < (statement.end_lineno or 0):
            return k if isinstance(statement, ast.Assign | ast.AnnAssign) else None
    return None


def _assign(module: ModuleType, changed: str, statement: int) -> None:
    """Run an assignment anew, and those after it that need its names; hand the values to who imported them."""
    names: set[str] = set()
    space = dict(vars(module))
    for k, each in enumerate(ast.parse(changed).body[statement:]):
        if not isinstance(each, ast.Assign | ast.AnnAssign) or each.value is None:
            continue
        if k and not {node.id for node in ast.walk(each.value) if isinstance(node, ast.Name)} & names:
            continue
        exec(compile(ast.Module([each], []), str(module.__file__), "exec"), space)
        targets = each.targets if isinstance(each, ast.Assign) else [each.target]
        names |= {node.id for target in targets for node in ast.walk(target) if isinstance(node, ast.Name)}
    before = {name: vars(module)[name] for name in names}
    for other in list(sys.modules.values()):
        for name in names & vars(other).keys():
            if vars(other)[name] is before[name]:
                setattr(other, name, space[name])

"""Functions of users that a spec names by their place: ``FILE.py:NAME``, or ``MODULE:NAME`` of an installed package.

Reading a spec runs none of them; preparing it does. ``DQCONTROL_CODE=refused`` in the environment refuses such specs.
"""

from __future__ import annotations

import functools
import hashlib
import importlib
import importlib.util
import multiprocessing
import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

from dqcontrol.errors import FileFormatError, ShapeError, ValueRangeError, unknown_name
from dqcontrol.extensions import POLICY, REFUSED
from dqcontrol.files.input_file import read_whole

# functions that this process has said it runs, with their files' content
_announced: set[tuple[str, ...]] = set()


def function_at(field: str, place: object) -> Callable[..., Any]:
    """Return a user's function.

    Parameters
    ----------
    field
        Name for the error message.
    place
        The function, or ``FILE.py:NAME`` or ``MODULE:NAME``.

    Raises
    ------
    ShapeError
        If it is neither.
    FileFormatError
        If the file or module cannot be imported.
    UnknownNameError
        If there is no such function in it.
    """
    if callable(place):
        return place
    if not isinstance(place, str) or ":" not in place:
        raise ShapeError(
            f"{field}: expected a function, or its place as FILE.py:NAME or MODULE:NAME, got {place!r:.80}"
        )
    source, _, name = place.rpartition(":")
    module = _imported_file(Path(source)) if source.endswith(".py") else _imported_module(field, source)
    found = getattr(module, name, None)
    if not callable(found):
        own = [key for key, value in vars(module).items() if callable(value) and not key.startswith("_")]
        raise unknown_name(f"{field}: {source}", name, own)
    return found


def numbers_in(parameters: list[float] | dict[str, float]) -> list[float]:
    """Return parameters in their order, given with names or without."""
    return list(parameters.values() if isinstance(parameters, dict) else parameters)


def place_of(function: Callable[..., Any]) -> str:
    """Return the place of a function that a module holds, for a spec; the reverse of `function_at`.

    Raises
    ------
    ShapeError
        If no file holds it under its name, as those of a notebook or inside another function.
    """
    name, module = getattr(function, "__qualname__", ""), sys.modules.get(getattr(function, "__module__", ""))
    file = getattr(module, "__file__", None)
    if not file or getattr(module, name, None) is not function:
        raise ShapeError(
            f"function: {name or function!r} must stand in a file, so that workers find it there"
        )
    return f"{Path(file).resolve()}:{name}"


def place_from(place: str, folder: Path) -> str:
    """Return a place with the absolute name of its file, given relative to a folder."""
    source, colon, name = place.rpartition(":")
    return f"{(folder / source).resolve()}{colon}{name}" if source.endswith(".py") else place


def places(data: Any) -> Iterator[dict[str, Any]]:
    """Yield those parts of a spec's plain data that name a function."""
    if isinstance(data, dict):
        if data.get("kind") == "own" and isinstance(data.get("function"), str):
            yield data
        for value in data.values():
            yield from places(value)
    elif isinstance(data, list):
        for value in data:
            yield from places(value)


def admit(where: str, data: Any, folder: Path) -> None:
    """Make the names of files in places absolute, and say which code a spec brings, once a process, or refuse it.

    Raises
    ------
    ValueRangeError
        If code is refused.
    """
    found = list(places(data))
    if not found:
        return
    for part in found:
        part["function"] = place_from(part["function"], folder)
    names = ", ".join(dict.fromkeys(part["function"] for part in found))
    if os.environ.get(POLICY) == REFUSED:
        raise ValueRangeError(f"{where}: runs code of {names}, which --no-code or {POLICY}={REFUSED} refuses")
    code = names, *(hashlib.sha256(content).hexdigest() for content in sources(data))
    # Commands read a spec several times, and their workers do again: what was said is said anew for other code only.
    if code not in _announced and multiprocessing.parent_process() is None:
        _announced.add(code)
        print(f"dqcontrol: runs code of {names}", file=sys.stderr, flush=True)


def sources(data: Any) -> Iterator[bytes]:
    """Yield what results depend on beside a spec's text: the files of the functions that it names."""
    for part in places(data):
        path = Path(part["function"].rpartition(":")[0])
        if path.suffix == ".py" and path.is_file():
            yield path.read_bytes()


def _imported_file(path: Path) -> ModuleType:
    return _run(path.resolve(), hashlib.sha256(read_whole(path)).hexdigest()[:16])


@functools.lru_cache(maxsize=64)
def _run(path: Path, content: str) -> ModuleType:
    """Return the module of a file of this content; a changed file is another module."""
    name = f"{path.stem}_{content}"
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise FileFormatError(f"{path}: is not a Python file")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    sys.path.insert(0, str(path.parent))  # as for a script: it may import its neighbours
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        del sys.modules[name]
        raise FileFormatError(f"{path}: cannot be imported: {type(error).__name__}: {error}") from None
    finally:
        sys.path.remove(str(path.parent))
    return module


def _imported_module(field: str, name: str) -> ModuleType:
    try:
        return importlib.import_module(name)
    except Exception as error:
        raise FileFormatError(
            f"{field}: {name} cannot be imported: {type(error).__name__}: {error}"
        ) from None

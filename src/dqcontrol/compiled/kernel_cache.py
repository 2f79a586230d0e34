"""The folder that keeps the machine code of kernels between processes.

A module's kernels lie in a folder named after the module and after a hash of its source and of all that it imports from
this package and its own, of Numba, Python and the processor: an edit recompiles the kernels that it can change, and no
others.
Numba's own check of staleness sees only the file of the function itself, not those of its callees. Nothing is read,
made or deleted before the first kernel is needed.
"""

from __future__ import annotations

import functools
import hashlib
import os
import re
import shutil
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from importlib.util import resolve_name
from pathlib import Path
from typing import Any

import llvmlite.binding
import numba

from dqcontrol.errors import CacheWarning
from dqcontrol.files.output_file import whole_file

_OURS = __name__.partition(".")[0]
_KEPT = 8  # versions of a module's kernels
_SAID_EVERY = 5  # kernels: every few seconds
# compile.py imports it in an `if`, which `_AT_IMPORT` skips
_OF_ALL_KERNELS = "dqcontrol.compiled.numba_internals"
_IMPORT = r"from +([\w.]+) +import +(\([^)]*\)|[^\n]*)|import +([\w.]+)"
_AT_IMPORT = re.compile(f"^(?:{_IMPORT})", re.MULTILINE)
_ANYWHERE = re.compile(rf"^[ \t]*(?:{_IMPORT})", re.MULTILINE)
_OFFER = re.compile(r"^from +\.([\w.]*) +import +(\([^)]*\)|[^\n]*)", re.MULTILINE)


@functools.cache
def _file(module: str) -> Path | None:
    """Return where the source of a module or package lies, None if there is none."""
    top, *inside = module.split(".")
    holder = sys.modules.get(top)
    if not inside and not hasattr(holder, "__path__"):
        file = getattr(holder, "__file__", None)
        return Path(file) if file and file.endswith(".py") else None
    base = Path(*getattr(holder, "__path__", [])[:1]).joinpath(*inside)
    candidates = base.with_suffix(".py"), base / "__init__.py"
    return next((path for path in candidates if path.is_file()), None)


def _names(imported: str) -> list[str]:
    return re.findall(r"(\w+)(?: +as +\w+)?", re.sub("#.*", "", imported))


@functools.cache
def _offers(package: str) -> dict[str, str]:
    """Return the modules of what a package offers in its stub, by name; empty of a module."""
    path = _file(package)
    stub = path.with_suffix(".pyi") if path else None
    if stub is None or not stub.is_file():
        return {}
    found = _OFFER.findall(stub.read_text(encoding="utf-8"))
    return {name: f"{package}.{module or name}" for module, imported in found for name in _names(imported)}


@functools.cache
def _imports(module: str, lazily: bool) -> frozenset[str]:
    """Return the modules of this package and its own that a module imports, inside functions too if ``lazily``."""
    path = _file(module)
    assert path is not None
    top = module.partition(".")[0]
    package = module if path.stem == "__init__" else module.rpartition(".")[0]
    found = set(_offers(module).values())
    for given, names, whole in (_ANYWHERE if lazily else _AT_IMPORT).findall(
        path.read_text(encoding="utf-8")
    ):
        origin = resolve_name(given, package) if given.startswith(".") else given or whole
        if origin.partition(".")[0] not in (_OURS, top) or not _file(origin):
            continue
        if whole:
            found.add(whole)
            continue
        for name in _names(names):
            submodule = f"{origin}.{name}"
            offered = _offers(origin).get(name)
            found.add(submodule if _file(submodule) else offered or origin)
    return frozenset(found)


def has_source(module: str | None) -> bool:
    """Return whether a module's source can be found again; that of a notebook, or of a script, cannot."""
    return module not in (None, "__main__") and _file(str(module)) is not None


def _environment() -> str:
    processor = numba.config.CPU_NAME or llvmlite.binding.get_host_cpu_name()  # type: ignore[attr-defined]
    return f"{numba.__version__} {sys.version} {processor}"


@functools.cache
def source_hash(module: str, *, lazily: bool = False) -> str:
    """Return a hash of all that a module's results depend on.

    Parameters
    ----------
    module
        Its source counts, and that of all that it imports from this package and from its own.
    lazily
        Whether imports inside functions count; compiled functions have none.
    """
    found, waiting = set(), [module, _OF_ALL_KERNELS]
    while waiting:
        if (name := waiting.pop()) not in found:
            found.add(name)
            waiting += _imports(name, lazily)
    digest = hashlib.sha256(_environment().encode())
    for name in sorted(found):
        path = _file(name)
        assert path is not None
        digest.update(name.encode() + path.read_bytes())
    return digest.hexdigest()[:16]


def _root() -> Path:
    if chosen := os.environ.get("DQCONTROL_CACHE"):
        return Path(chosen)
    if sys.platform == "win32":
        base = Path(os.environ.get("LOCALAPPDATA", Path.home() / "AppData" / "Local"))
    elif sys.platform == "darwin":
        base = Path.home() / "Library" / "Caches"
    else:
        base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return base / "dqcontrol"


@functools.cache
def root() -> Path | None:
    """Return the folder of the cache, None if it cannot be written."""
    try:
        folder = _root()
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return folder
    except (OSError, RuntimeError):  # RuntimeError: no home folder
        return None


def module_folder(module: str) -> Path:
    """Return the folder of a module's kernels, and make it if it is new; the oldest of other versions go."""
    folder = (root() or _root()) / module / source_hash(module)
    if not folder.exists():
        folder.mkdir(parents=True, exist_ok=True)
        versions = (p for p in folder.parent.iterdir() if re.fullmatch("[0-9a-f]{16}", p.name) and p.is_dir())
        for old in sorted(versions, key=lambda path: path.stat().st_mtime)[:-_KEPT]:
            shutil.rmtree(old, ignore_errors=True)
    return folder


def state() -> tuple[Path, bool, int]:
    """Return the cache folder, whether it can be written, and how many kernels lie in it."""
    folder = root()
    return folder or _root(), folder is not None, len(list(folder.glob("*/*/*.nbi"))) if folder else 0


def clear(module: str) -> bool:
    """Remove a module's kernels; return whether there is a cache."""
    if root() is None:
        return False
    folder = module_folder(module)
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True, exist_ok=True)
    return True


def _place(function: Callable[..., Any]) -> str:
    """Return how the files of a kernel begin."""
    return f"{function.__name__}-{function.__code__.co_firstlineno}"


def is_kept(function: Callable[..., Any]) -> bool:
    """Return whether a kernel lies in the cache."""
    return root() is not None and any(module_folder(function.__module__).glob(f"*{_place(function)}.*.nbi"))


@contextmanager
def one_process_at_a_time(function: Callable[..., Any]) -> Iterator[None]:
    """Let one process compile a kernel: others that need it wait, and then find it kept."""
    with ExitStack() as held:
        with suppress(OSError):  # a cache that cannot be written: each compiles its own
            if root() is not None:
                from filelock import FileLock  # an eighth of Numba's import: only where something is compiled

                held.enter_context(FileLock(module_folder(function.__module__) / f"{_place(function)}.lock"))
        yield


def sealed(content: bytes) -> bytes:
    """Return what a file of the cache holds of this content: a digest stands before it."""
    return hashlib.sha256(content).digest() + content


def unsealed(path: str | Path) -> bytes | None:
    """Return the content of a file of the cache, None if there is none, or it was damaged: machine code would run."""
    try:
        whole = Path(path).read_bytes()
    except OSError:
        return None
    size = hashlib.sha256().digest_size
    return whole[size:] if whole == sealed(whole[size:]) else None


def read_bitcode(function: Callable[..., Any]) -> tuple[bytes, str] | None:
    """Return the portable code of a kernel and its name there, None if it is not kept."""
    if root() is None:
        return None
    content = unsealed(_bitcode_file(function))
    if content is None:
        return None
    name, _, code = content.partition(b"\n")
    return code, name.decode()


def keep_bitcode(function: Callable[..., Any], code: tuple[bytes, str]) -> None:
    """Keep the portable code of a kernel and its name there, if the folder can be written."""
    if root() is not None:
        with suppress(OSError), whole_file(_bitcode_file(function), overwrite=True) as file:
            file.write_bytes(sealed(code[1].encode() + b"\n" + code[0]))


def _bitcode_file(function: Callable[..., Any]) -> Path:
    return module_folder(function.__module__) / f"{_place(function)}.portable"


def announce(function: Callable[..., Any]) -> None:
    """Say that kernels are compiled, how many so far as they become more, or that the cache cannot keep them."""
    global _announced
    if root() is None:
        warn_unwritable()
    elif not is_kept(function):
        _announced += 1
        if _announced == 1:
            what = "compiling kernels for their first use (up to a minute) …"
        elif _announced % _SAID_EVERY == 0:
            what = f"compiling: {_announced} kernels so far …"
        else:
            return
        print(f"dqcontrol: {what}", file=sys.stderr, flush=True)


def warn_unwritable() -> None:
    """Say, once in a process, that kernels cannot be kept."""
    global _warned
    if not _warned:
        _warned = True
        warnings.warn(
            f"cannot write to {_root()}: kernels are compiled anew in each process; "
            "set DQCONTROL_CACHE to a writable folder",
            CacheWarning,
            stacklevel=6,
        )


_warned = False
_announced = 0  # kernels compiled

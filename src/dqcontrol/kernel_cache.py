"""The folder that keeps the machine code of kernels between processes.

It is named after a hash of all package sources, of Numba's version and of the processor, because Numba's own staleness
check sees only the file of the function itself, not those of its callees.
"""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import sys
import tempfile
import warnings
from pathlib import Path

import llvmlite.binding
import numba

from dqcontrol.errors import CacheWarning

_KEPT = 4


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


def _writable() -> Path | None:
    root = _root()
    folder = root / source_hash()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
        caches = (
            p for p in root.iterdir() if re.fullmatch("[0-9a-f]{16}", p.name) and p.is_dir() and p != folder
        )
        others = sorted(caches, key=lambda p: p.stat().st_mtime)  # names of hashes only: the rest is not ours
        for old in others[: -(_KEPT - 1)]:
            shutil.rmtree(old, ignore_errors=True)
    except (OSError, RuntimeError):  # RuntimeError: no home folder
        return None
    return folder


def state() -> tuple[Path, bool, int]:
    """Return the cache folder, whether it can be written, and how many kernels lie in it."""
    return FOLDER or _root(), FOLDER is not None, len(list(FOLDER.glob("*/*.nbi"))) if FOLDER else 0


def clear() -> bool:
    """Empty the folder; return whether there is one."""
    if FOLDER is None:
        return False
    shutil.rmtree(FOLDER, ignore_errors=True)
    FOLDER.mkdir(parents=True, exist_ok=True)
    return True


def announce(name: str) -> None:
    """Say, once in a process, that a kernel of this name is compiled, or that the cache cannot keep it."""
    global _warned, _announced
    if FOLDER is None:
        if not _warned:
            _warned = True
            warnings.warn(
                f"cannot write to {_root()}: kernels are compiled anew in each process; "
                "set DQCONTROL_CACHE to a writable folder",
                CacheWarning,
                stacklevel=5,
            )
    elif not _announced and not any(FOLDER.glob(f"*/*{name}-*.nbi")):
        _announced = True
        print(
            "dqcontrol: compiling kernels for their first use (up to a minute) …", file=sys.stderr, flush=True
        )


FOLDER = _writable()
_warned = False
_announced = False

"""Xacro files, expanded to URDF by xacro itself, with packages that are found without ROS."""

from __future__ import annotations

import contextlib
import io
import os
import subprocess
import sys
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

from dqcontrol.errors import FileFormatError, MissingExtraError
from dqcontrol.robots.files.package_folders import WHERE, package_folders

_MOST_SECONDS = 20.0  # a robot takes tenths of a second, on a busy machine some seconds
_MOST_MEMORY = 4 << 30  # bytes: what a robot takes is Python's 50 MB


def expand_xacro(path: str | Path) -> bytes:
    """Return the URDF text of a xacro file, with the defaults of its arguments.

    Raises
    ------
    MissingExtraError
        If xacro is not installed.
    FileFormatError
        If the file, or one that it includes, is missing or malformed, or a package is not found: it is named;
        or its expressions have no end.
    """
    try:
        import_module("xacro")
    except ImportError as error:
        raise MissingExtraError(
            f"{path}: is a xacro file, which needs xacro, and that cannot be imported ({error}); "
            f"pip install 'dqcontrol[xacro]', or expand it where ROS is: xacro {Path(path).name} > robot.urdf"
        ) from None
    try:
        done = subprocess.run(
            [sys.executable, "-m", __name__, str(path)],
            capture_output=True,
            timeout=_MOST_SECONDS,
            check=False,
            env=os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
        )
    except subprocess.TimeoutExpired:
        raise FileFormatError(f"{path}: xacro does not come to an end within {_MOST_SECONDS:g} s") from None
    if done.returncode:
        why = done.stderr.decode(errors="replace").strip() or f"xacro ended with {done.returncode}"
        raise FileFormatError(why)
    return done.stdout


def _expanded(path: str) -> bytes:
    """Do what `expand_xacro` does in a process of its own: expressions are Python, and may take any time and memory."""
    xacro = import_module("xacro")
    try:
        with (
            _packages_without_ros(Path(path)),
            contextlib.redirect_stderr(io.StringIO()),
        ):  # it prints what it raises
            return xacro.process_file(path).toxml(encoding="utf-8")
    except FileFormatError:
        raise
    except Exception as error:  # readers of damaged files raise anything
        if isinstance(error.__context__, FileFormatError):
            raise error.__context__ from None
        raise FileFormatError(f"{path}: xacro cannot expand it: {_words(error)}") from None


@contextlib.contextmanager
def _packages_without_ros(path: Path) -> Iterator[None]:
    """Let ``$(find PACKAGE)`` look where meshes are looked for, too; xacro itself asks ROS, and offers no other way."""
    substitution: Any = import_module("xacro.substitution_args")
    original = substitution._eval_find

    def find(package: str) -> str:
        folder = next(package_folders(package, path), None)
        if folder is None:
            raise FileFormatError(
                f"{path}: needs the package '{package}', which is not found; put it {WHERE}"
            )
        return str(folder)

    substitution._eval_find = find
    try:
        yield
    finally:
        substitution._eval_find = original


def _words(error: Exception) -> str:
    text = " ".join(str(error).split()) or type(error).__name__
    if "undefined substitution argument" in text.lower():
        text += (
            "; arguments have no values here: write a xacro file that sets them and includes this one, "
            "or expand it with them: xacro FILE NAME:=VALUE > robot.urdf"
        )
    return f"{text:.400}"


def _bound_memory() -> None:
    """Let an expression that is too large fail; where the system knows no such bound, time is the only one."""
    with contextlib.suppress(ImportError, ValueError, OSError):
        resource = import_module("resource")
        resource.setrlimit(resource.RLIMIT_AS, (_MOST_MEMORY, resource.getrlimit(resource.RLIMIT_AS)[1]))


if __name__ == "__main__":
    _bound_memory()
    try:
        sys.stdout.buffer.write(_expanded(sys.argv[1]))
    except FileFormatError as error:
        sys.exit(str(error))

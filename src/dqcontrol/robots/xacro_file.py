"""Xacro files, expanded to URDF by xacro itself, with packages that are found without ROS."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

from dqcontrol.errors import FileFormatError, MissingExtraError
from dqcontrol.robots.package_folders import WHERE, package_folders


def expand_xacro(path: str | Path) -> bytes:
    """Return the URDF text of a xacro file, with the defaults of its arguments.

    Raises
    ------
    MissingExtraError
        If xacro is not installed.
    FileFormatError
        If the file, or one that it includes, is missing or malformed, or a package is not found: it is named.
    """
    try:
        xacro = import_module("xacro")
    except ImportError as error:
        raise MissingExtraError(
            f"{path}: is a xacro file, which needs xacro, and that cannot be imported ({error}); "
            f"pip install 'dqcontrol[xacro]', or expand it where ROS is: xacro {Path(path).name} > robot.urdf"
        ) from None
    try:
        with (
            _packages_without_ros(Path(path)),
            contextlib.redirect_stderr(io.StringIO()),
        ):  # it prints what it raises
            return xacro.process_file(str(path)).toxml(encoding="utf-8")
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

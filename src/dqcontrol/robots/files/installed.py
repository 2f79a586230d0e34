"""Robot files that installed packages bring: ``PACKAGE:PATH``, and models of MuJoCo Menagerie by name."""

from __future__ import annotations

import importlib
import importlib.metadata
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from dqcontrol.errors import FileFormatError, MissingExtraError, UnknownNameError, suggest, unknown_name
from dqcontrol.robots.files.suffixes import MJCF, URDF, XACRO

EXAMPLES = "example-robot-data"
MENAGERIE = "menagerie"
_NAMES_SHOWN = 100  # of a package's files in a message


def installed_file(source: str) -> Path | None:
    """Return the robot file that ``PACKAGE:PATH`` or ``menagerie:NAME`` names; None for any other source.

    Of a path inside a package its end is enough, as much of it as tells it from others.

    Raises
    ------
    MissingExtraError
        If the package is not installed, or Menagerie's model not on this computer.
    UnknownNameError
        If it brings no such file, or several.
    """
    package, colon, inner = source.partition(":")
    if not colon or len(package) < 2 or Path(source).exists():  # one letter: a drive
        return None
    return _menagerie_file(inner) if package == MENAGERIE else _package_file(package, inner)


def package_files(package: str) -> dict[str, Path]:
    """Return the robot files of an installed package by their paths below the folder that holds them all.

    Raises
    ------
    MissingExtraError
        If the package is not installed.
    """
    try:
        found = importlib.metadata.distribution(package)
    except (importlib.metadata.PackageNotFoundError, ValueError):
        extra = "'dqcontrol[robots]'" if package == EXAMPLES else package
        raise MissingExtraError(
            f"{package}: is not installed; install it with: pip install {extra}"
        ) from None
    return _by_places(_robot_files(found))


def installed_robot_files() -> Iterator[tuple[str, Path]]:
    """Yield the source and the path of each robot file that installed packages bring, and Menagerie's on this computer.

    Examples
    --------
    >>> from dqcontrol.robots.files.installed import installed_robot_files
    >>> all(path.is_file() for _, path in installed_robot_files())
    True
    """
    found = {each.metadata["Name"]: each for each in importlib.metadata.distributions()}
    for name in sorted(filter(None, found), key=str.lower):
        for inner, path in _by_places(_robot_files(found[name])).items():
            yield f"{name}:{inner}", path
    try:
        registry = _menagerie()
    except MissingExtraError:
        return
    for name in registry.names():
        path = _menagerie_path(registry, name)
        if path is not None:
            yield f"{MENAGERIE}:{name}", path


def _robot_files(distribution: importlib.metadata.Distribution) -> list[Path]:
    named = [file for file in distribution.files or () if file.suffix.lower() in (URDF, XACRO, MJCF)]
    paths = [Path(str(file.locate())) for file in named]
    return [path for path in paths if path.suffix.lower() != MJCF or _is_mjcf(path)]


def _is_mjcf(path: Path) -> bool:
    """Return whether an XML file is a model of MuJoCo that moves, by itself or by what it includes."""
    try:
        text = path.read_text(encoding="utf-8", errors="replace")
    except OSError:  # listed, but removed since
        return False
    return "<mujoco" in text and "<worldbody" in text and any(tag in text for tag in _MOVING)


_MOVING = ("<joint", "<freejoint", "<include")


def _by_places(paths: list[Path]) -> dict[str, Path]:
    """Return paths by their places below the innermost folder that holds all of them."""
    top = os.path.commonpath([path.parent for path in paths]) if paths else ""
    return {path.relative_to(top).as_posix(): path for path in sorted(paths)}


def _package_file(package: str, inner: str) -> Path:
    known = package_files(package)
    parts = tuple(part for part in inner.split("/") if part)
    same = [path for path in known.values() if parts and path.parts[-len(parts) :] == parts]
    if len(same) == 1:
        return same[0]
    if same:
        ends = ", ".join(end for end, path in known.items() if path in same)
        raise UnknownNameError(f"{package}: '{inner}' may be each of {ends}; give one of these")
    stem = Path(inner).stem.lower()
    near = next((end for end in known if stem and stem in end.lower()), None)
    hint = f"; did you mean '{near}'?" if near else suggest(inner, known)
    names = sorted(known)
    more = f" and {len(names) - _NAMES_SHOWN} more" if len(names) > _NAMES_SHOWN else ""
    allowed = f"allowed: {', '.join(names[:_NAMES_SHOWN])}{more}" if names else "it brings no robot files"
    raise UnknownNameError(f"{package}: unknown file '{inner}'{hint} ({allowed})")


def _menagerie() -> Any:
    """Return the registry of the package mujoco-menagerie."""
    try:
        return importlib.import_module("mujoco_menagerie").bundled()
    except ImportError as error:
        raise MissingExtraError(
            f"{MENAGERIE}: models are named by mujoco-menagerie, which cannot be imported ({error}); "
            "pip install mujoco-menagerie"
        ) from None


def _menagerie_path(registry: Any, name: str) -> Path | None:
    """Return the file of a model's robot, without a scene, if it is on this computer: nothing is downloaded here."""
    robot, cache = registry.get(name), importlib.import_module("mujoco_menagerie").Cache()
    if cache.root is not None:
        folder = Path(cache.root) / name
    elif cache.is_cached(robot):
        folder = cache.model_path(robot)
    else:
        return None
    path = folder / robot.entry(robot.default_model).file
    return path if path.is_file() else None


def _menagerie_file(name: str) -> Path:
    registry = _menagerie()
    if name not in registry.names():
        raise unknown_name(MENAGERIE, name, registry.names())
    path = _menagerie_path(registry, name)
    if path is None:
        root = os.environ.get("MENAGERIE_ROOT")
        if root:
            raise FileFormatError(f"{MENAGERIE}: '{name}' is not in MENAGERIE_ROOT={root}")
        raise MissingExtraError(
            f"{MENAGERIE}: '{name}' is not on this computer yet; fetch it with: mujoco-menagerie prefetch {name}; "
            "or let MENAGERIE_ROOT name a copy of MuJoCo Menagerie"
        )
    return path

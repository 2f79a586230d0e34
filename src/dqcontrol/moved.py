"""The names of packages: those offered, imported when first used, and old ones, which work for one more release."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable, Sequence
from functools import wraps
from importlib import import_module
from types import ModuleType
from typing import Any, TypeVar

import lazy_loader

T = TypeVar("T")

_MODULES = {  # that are gone
    "dqcontrol.compile": "dqcontrol.compiled.compile",
    "dqcontrol.experiments.gains": "dqcontrol.experiments.gain_advice",
    "dqcontrol.experiments.metrics": "dqcontrol.measures.metrics",
    "dqcontrol.experiments.pick_and_drop": "dqcontrol.reproductions.silva2017.pick_and_drop_task",
    "dqcontrol.experiments.published": "dqcontrol.reproductions",
    "dqcontrol.experiments.published.pereira2016": "dqcontrol.reproductions.pereira2016",
    "dqcontrol.experiments.published.silva2017": "dqcontrol.reproductions.silva2017",
    "dqcontrol.experiments.tables": "dqcontrol.measures.tables",
    "dqcontrol.loop.export": "dqcontrol.recording.export",
    "dqcontrol.loop.mcap": "dqcontrol.recording.mcap",
    "dqcontrol.loop.stream": "dqcontrol.recording.stream",
    "dqcontrol.ros2.pereira2016": "dqcontrol.reproductions.pereira2016.nodes",
    "dqcontrol.view": "dqcontrol.figures",
    "dqcontrol.view.base_paths": "dqcontrol.figures.base_paths",
    "dqcontrol.view.browser": "dqcontrol.browser",
    "dqcontrol.view.clip": "dqcontrol.films.clip",
    "dqcontrol.view.figure_files": "dqcontrol.figures.figure_files",
    "dqcontrol.view.light_painting": "dqcontrol.films.light_painting",
    "dqcontrol.view.physics_picture": "dqcontrol.films.physics_picture",
    "dqcontrol.view.style": "dqcontrol.figures.style",
}
_NAMES: dict[
    str, dict[str, tuple[str, ...]]
] = {  # that have left a module; () for all that the new one offers
    "dqcontrol.experiments": {
        "dqcontrol.logs": ("JointLog", "evaluate_log", "read_joint_log"),
        "dqcontrol.measures": (),
    },
    "dqcontrol.loop": {
        "dqcontrol.recording": (
            "RecordStream",
            "export_record",
            "load_metadata",
            "load_record",
            "save_record",
        )
    },
    "dqcontrol.view": {"dqcontrol.reports": ("write_report",)},
}

_RENAMED = {  # names that changed in the module where they stand
    "dqcontrol.references": {"Line": "StraightStroke"},
    "dqcontrol.robots": {"Posture": "ReachingPosture"},
    "dqcontrol.compiled.compile": {
        "attached": "shared",
        "inlined": "inline",
        "strictly_inlined": "inline_ieee",
    },
    "dqcontrol.compile": {"inlined": "inline"},
}


class _MovedModule(ModuleType):
    """A module that is gone: it has what stands in its new place."""

    def __getattr__(self, name: str) -> Any:
        return find_moved(self.__name__, name)


def register() -> None:
    """Let modules that are gone be imported by their old names."""
    for old in _MODULES:
        sys.modules.setdefault(old, _MovedModule(old))


def find_moved(module: str, name: str, stacklevel: int = 3) -> Any:
    """Return what a module had under a name, with a warning that says where it is now.

    Raises
    ------
    AttributeError
        If it never had that name.
    """
    if (inner := f"{module}.{name}") in _MODULES:
        return sys.modules[inner]
    if name.startswith("_"):
        raise AttributeError(f"module '{module}' has no attribute '{name}'")
    places = (new for new in _NAMES.get(module, {}) if name in names_at(module, new))
    new = next(places, _MODULES.get(module))
    renamed = _RENAMED.get(module, {}).get(name, name)
    if new is None and renamed != name:
        new = module
    if new is None:
        raise AttributeError(f"module '{module}' has no attribute '{name}'")
    found = getattr(import_module(new), renamed)
    warnings.warn(f"{inner} is now {new}.{renamed}", DeprecationWarning, stacklevel=stacklevel)
    return found


def names_at(module: str, new: str) -> Sequence[str]:
    """Return the names that left a module for another."""
    return _NAMES[module][new] or import_module(new).__all__


def names_moved_from(module: str) -> Callable[[str], Any]:
    """Return the ``__getattr__`` of a module where names have left or changed."""
    return lambda name: find_moved(module, name)


def offered(package: str, file: str) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """Return ``__getattr__``, ``__dir__`` and ``__all__`` of a package, given its name and the file of its code.

    What stands in the stub beside that file, ``__init__.pyi``, is imported when it is first used; old names work too.
    """
    get, listing, names = lazy_loader.attach_stub(package, file)
    return lambda name: get(name) if name in names else find_moved(package, name), listing, names


def renamed_parameters(**new_names: str) -> Callable[[T], T]:
    """Let a function take parameters, and a dataclass have fields, under their old names too, with a warning.

    Parameters
    ----------
    **new_names
        By old name the new one.
    """

    def decorate(target: T) -> T:
        if not isinstance(target, type):
            return _with_old_names(target, new_names)
        kind: Any = target
        kind.__init__ = _with_old_names(kind.__init__, new_names)
        for old, new in new_names.items():
            setattr(kind, old, _old_field(old, new))
        return target

    return decorate


def _with_old_names(function: Any, new_names: dict[str, str]) -> Any:
    @wraps(function)
    def call(*arguments: Any, **named: Any) -> Any:
        for old in new_names.keys() & named.keys():
            _warn_renamed(old, new_names[old])
            if new_names[old] in named:
                raise TypeError(f"{old}: is the old name of '{new_names[old]}', which is given too")
            named[new_names[old]] = named.pop(old)
        return function(*arguments, **named)

    return call


def _old_field(old: str, new: str) -> property:
    def read(self: Any) -> Any:
        _warn_renamed(old, new)
        return getattr(self, new)

    return property(read)


def _warn_renamed(old: str, new: str) -> None:
    warnings.warn(
        f"{old} is now called {new}; the old name works for one more release", FutureWarning, stacklevel=3
    )

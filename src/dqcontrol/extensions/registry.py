"""Classes named by their kind: our own, and those that installed packages offer by entry points."""

from __future__ import annotations

import re
from collections.abc import Iterator
from importlib import import_module
from typing import Any, TypeVar, Union

import msgspec

from dqcontrol.errors import FileFormatError
from dqcontrol.extensions import offered

T = TypeVar("T")
S = TypeVar("S", bound=msgspec.Struct)


def registered(base: type[T], group: str = "", *, loaded: bool = False) -> list[type[T]]:
    """Return all subclasses of a class: those of a package of ours, and those that installed packages offer.

    Parameters
    ----------
    base
        The class.
    group
        Name of our package, and of the entry points by which other packages offer theirs; without it the subclasses
        that have been imported.
    loaded
        Ours have been imported, as where the package itself is being loaded.

    Raises
    ------
    FileFormatError
        If an entry point cannot be loaded or is no such subclass.
    """
    if group and not loaded:
        ours = import_module(group)
        for name in ours.__all__:
            getattr(ours, name)
    for name, kind in offered(group) if group else ():
        if not (isinstance(kind, type) and issubclass(kind, base)):
            raise FileFormatError(f"entry point {group}: {name} is no subclass of {base.__name__}")
    return list(dict.fromkeys(_subclasses(base)))


def union_of(base: type[S], group: str = "", *, loaded: bool = False) -> Any:
    """Return the union of all kinds of a structure, for a field of a spec: its subclasses with a tag in lower case.

    Raises
    ------
    FileFormatError
        If an entry point is wrong, see `registered`, or two kinds have one tag.
    """
    return Union[tuple(by_tag(base, group, loaded=loaded).values())]  # noqa: UP007


def by_tag(base: type[S], group: str = "", *, loaded: bool = False) -> dict[str, type[S]]:
    """Return all kinds of a structure by their tags; see `union_of`."""
    kinds: dict[str, type[S]] = {}
    for kind in registered(base, group, loaded=loaded):
        tag = str(kind.__struct_config__.tag)
        if not re.fullmatch("[a-z][a-z0-9-]*", tag):
            continue  # what several kinds share
        if tag in kinds:
            raise FileFormatError(
                f"kind '{tag}': offered by {kinds[tag].__module__} and by {kind.__module__}; rename one"
            )
        kinds[tag] = kind
    return kinds


def _subclasses(base: type[T]) -> Iterator[type[T]]:
    for kind in base.__subclasses__():
        yield kind
        yield from _subclasses(kind)

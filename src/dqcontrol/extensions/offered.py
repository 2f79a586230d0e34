"""What installed packages offer by entry points."""

from __future__ import annotations

from collections.abc import Iterator
from importlib.metadata import entry_points
from typing import Any


def offered(group: str) -> Iterator[tuple[str, Any]]:
    """Yield the name and the object of each entry point of a group.

    Raises
    ------
    FileFormatError
        If one cannot be loaded.
    """
    for point in entry_points(group=group):
        try:
            yield point.name, point.load()
        except Exception as error:
            from dqcontrol.errors import FileFormatError  # only now: it loads NumPy

            raise FileFormatError(
                f"entry point {group}: {point.name} = {point.value} cannot be loaded: {error}"
            ) from None

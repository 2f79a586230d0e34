"""Entry points of installed packages."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from importlib.metadata import entry_points
from typing import Any


@cache
def _all() -> Any:
    return entry_points()  # 20 ms in an environment of 200 distributions


def offered(group: str) -> Iterator[tuple[str, Any]]:
    """Yield the name and the object of each entry point of a group.

    Raises
    ------
    FileFormatError
        If one cannot be loaded.
    """
    for point in _all().select(group=group):
        try:
            yield point.name, point.load()
        except Exception as error:
            from dqcontrol.errors import FileFormatError  # only now: it loads NumPy

            raise FileFormatError(
                f"entry point {group}: {point.name} = {point.value} cannot be loaded: {error}"
            ) from None

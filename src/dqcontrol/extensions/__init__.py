"""Extensions: functions in users' own files, and kinds of laws, plants and references of other packages.

What the command line asks for at its start stands here, where it loads nothing heavy.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from importlib.metadata import entry_points
from typing import Any

POLICY = "DQCONTROL_CODE"  # in the environment, so that worker processes have it too
REFUSED = "refused"


@cache
def _entry_points() -> Any:
    return entry_points()  # 20 ms in an environment of 200 distributions


def offered(group: str) -> Iterator[tuple[str, Any]]:
    """Yield the name and the object of each entry point of a group.

    Raises
    ------
    FileFormatError
        If one cannot be loaded.
    """
    for point in _entry_points().select(group=group):
        try:
            yield point.name, point.load()
        except Exception as error:
            from dqcontrol.errors import FileFormatError  # only now: it loads NumPy

            raise FileFormatError(
                f"entry point {group}: {point.name} = {point.value} cannot be loaded: {error}"
            ) from None

"""Libraries of the extra ``plan``, imported where they are needed: their objects at module level leak on exit."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from dqcontrol.errors import MissingExtraError


def from_extra(name: str, what: str) -> Any:
    """Return a module by its name; ``what`` says what needs it.

    Raises
    ------
    MissingExtraError
        If it cannot be imported.
    """
    try:
        return import_module(name)
    except ImportError as error:
        library = name.partition(".")[0]
        raise MissingExtraError(
            f"{library}: {what} need it and it cannot be imported ({error}); pip install 'dqcontrol[plan]'"
        ) from None

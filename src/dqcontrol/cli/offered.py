"""Commands that installed packages offer by entry points, beside those of this package."""

from __future__ import annotations

from cyclopts import App, Group
from cyclopts.exceptions import CommandCollisionError

from dqcontrol.extensions.offered import offered


def add_offered(app: App, group: str, heading: Group | None = None) -> None:
    """Add the functions of a group of entry points to a command line, each under its name and one heading of the help.

    Raises
    ------
    FileFormatError
        If one cannot be loaded, or has the name of another command.
    """
    for name, function in offered(group):
        try:
            app.command(function, name=name, group=heading)
        except CommandCollisionError:
            from dqcontrol.errors import FileFormatError  # only now: it loads NumPy

            raise FileFormatError(f"entry point {group}: {name} is a command already; rename it") from None

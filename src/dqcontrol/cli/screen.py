"""What commands print on: tables as wide as the window, and bars of progress."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from rich.console import Console

if TYPE_CHECKING:
    from dqcontrol.measures.tables import Table


FAILED = 1  # exit status: a run did not do what was asked, or broke what it was to keep
_UNWATCHED = 200  # letters a line, when nobody watches


def print_table(table: Table) -> None:
    """Print a table, folded where the window is too narrow."""
    from dqcontrol.measures.folded import folded

    console = Console() if sys.stdout.isatty() else Console(width=_UNWATCHED)
    for part in folded(table, console.width):
        console.print(part)


@contextmanager
def progress_bar() -> Iterator[Callable[..., None]]:
    """Give what shows a bar for each label on standard error, once there is one."""
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn, TimeRemainingColumn

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(elapsed_when_finished=True),
    )
    bar = Progress(*columns, console=Console(stderr=True))
    tasks: dict[str, TaskID] = {}

    def report(done: float, total: int, label: str = "trials") -> None:
        if not tasks:
            bar.start()  # only now: an error before the first trial prints nothing else
        if label not in tasks:
            if done >= 1 and not tasks:
                print(f"dqcontrol: resuming: {done:g} of {total} trials already done", file=sys.stderr)
            tasks[label] = bar.add_task(label, total=total)
        bar.update(tasks[label], completed=done, total=total)

    try:
        yield report
    finally:
        if tasks:
            bar.stop()

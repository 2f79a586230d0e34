"""Output of commands: tables as wide as the window, and bars of progress."""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

    from dqcontrol.arrays import Array
    from dqcontrol.robots import Robot
    from dqcontrol.tables.tables import Cell, Column, Table


FAILED = 1  # exit status: a run did not do what was asked, or broke what it was to keep
WIDE, COLUMNS = "DQCONTROL_WIDE", "DQCONTROL_COLUMNS"  # in the environment: what options of all commands said
_ENDLESS = 10_000  # letters a line, with --wide and in files


def print_table(table: Table) -> None:
    """Print a table: as many columns as the window has room for, or those of ``--columns``, or with ``--wide`` all."""
    from rich.console import Console

    from dqcontrol.tables.fitted import fitted

    chosen = os.environ.get(COLUMNS)
    if chosen:
        table = table.with_columns(chosen.split(","))
    wide = WIDE in os.environ or not (sys.stdout.isatty() or "COLUMNS" in os.environ)
    console = Console(width=_ENDLESS) if wide else Console()
    for part in fitted(table, console.width, "--wide"):
        console.print(part)


def print_found(*tables: Table, folder: Path | None = None, words: Iterable[str] = ()) -> None:
    """Print where results are, their tables and what there is to say of them: at once, whatever is drawn after that."""
    if folder is not None:
        print(f"results: {folder}")
    for table in tables:
        print_table(table)
    for line in words:
        print(line)
    sys.stdout.flush()


def announce(command: str, url: str) -> None:
    """Say where a page is, and open the browser there."""
    import webbrowser

    print(f"{command}: {url} (Ctrl+C ends)", flush=True)
    webbrowser.open(url)


def joint_columns(robot: Robot) -> list[Column]:
    """Return a column for each joint: its angle or way."""
    from dqcontrol.tables.tables import Column

    return [
        Column(name, "°", "z.1f") if kind == "revolute" else Column(name, "m", "z.4f")
        for name, kind in zip(robot.joint_names, robot.joint_types, strict=True)
    ]


def joint_values(robot: Robot, q: Array) -> list[Cell]:
    """Return a configuration (n,), rad or m, in the units of these columns."""
    kinds = zip(q.tolist(), robot.joint_types, strict=True)
    return [math.degrees(value) if kind == "revolute" else value for value, kind in kinds]


@contextmanager
def progress_bar() -> Iterator[Callable[..., None]]:
    """Give what shows a bar for each label on standard error, once there is one."""
    from rich.console import Console
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

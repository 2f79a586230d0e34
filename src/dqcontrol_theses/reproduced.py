"""Result of the reproduction of a published experiment."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from dqcontrol.experiments import SPEC_FILE, Study, new_folder, write_table
from dqcontrol.reports import origins
from dqcontrol.tables import Table, VerdictCell

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Draw = Callable[[], "Figure"]
Write = Callable[[Path], None]


@dataclass(frozen=True)
class Reproduced:
    """What a reproduction gave.

    Attributes
    ----------
    name
        With its source, as ``"pereira2016/spiral"``.
    tables
        Published | ours | ratio, and the verdicts.
    studies
        By the name of their spec.
    figures
        Beside those of the studies, by file name.
    plant
        What stood for the source's robot; empty where there is no choice.
    files
        What writes further files, pictures and clips of physics, by their names.
    conditions
        Options of the command that were not left at their defaults.
    """

    name: str
    tables: list[Table]
    studies: Mapping[str, Study] = field(default_factory=dict)
    figures: Mapping[str, Draw] = field(default_factory=dict)
    plant: str = ""
    files: Mapping[str, Write] = field(default_factory=dict)
    conditions: Mapping[str, int] = field(default_factory=dict)

    def save(self, folder: str | Path, *, force: bool = False) -> Path:
        """Write a report, the tables as Markdown, CSV and LaTeX, figures, further files, and a folder each study.

        Raises
        ------
        ExistsError
            If the folder exists (and holds no results, with ``force``).
        """
        from dqcontrol.figures import save_figures
        from dqcontrol.reports import write_report

        with new_folder(folder, force=force) as new:
            (new / SPEC_FILE).write_text(self.heading, encoding="utf-8")
            text = "\n".join(table.markdown() for table in self.tables)
            (new / "tables.md").write_text(text, encoding="utf-8")
            for i, table in enumerate(self.tables, 1):
                write_table(table, new, f"table-{i}")
            for label, study in self.studies.items():
                study.save(new / label)
            figures = {label: draw() for label, draw in self.figures.items()}
            save_figures(figures, new, ("png", "pdf"))
            for label, write in self.files.items():
                write(new / label)
            pages = {label: f"{label}/report.html" for label in self.studies}
            write_report(
                new,
                self.name,
                facts=f"on {self.plant}" if self.plant else "",
                command=f"{self.command} --out again",
                verdicts=[table for table in self.tables if _judges(table)],
                tables=[table for table in self.tables if not _judges(table)],
                figures=figures,
                files=pages | {name: name for name in self.files},
                origins=origins({}),
            )
        return Path(folder)

    @property
    def heading(self) -> str:
        """The file that tells what a folder of results is of."""
        return f"# {self.command}\n"

    @property
    def command(self) -> str:
        """The line that gives it again."""
        options = ({"plant": self.plant} if self.plant else {}) | dict(self.conditions)
        words = [word for key, value in options.items() for word in (f"--{key}", str(value))]
        return shlex.join(["dqcontrol", "reproduce", self.name, *words])


def _judges(table: Table) -> bool:
    """Tell whether a table holds verdicts."""
    return any(isinstance(cell, VerdictCell) for row in table.rows for cell in row)

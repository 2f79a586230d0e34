"""What the reproduction of a published experiment gave."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from dqcontrol.experiments.comparison import write_table
from dqcontrol.experiments.output import MARK, new_folder
from dqcontrol.experiments.study import Study
from dqcontrol.experiments.tables import Table

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
    """

    name: str
    tables: list[Table]
    studies: Mapping[str, Study] = field(default_factory=dict)
    figures: Mapping[str, Draw] = field(default_factory=dict)
    plant: str = ""
    files: Mapping[str, Write] = field(default_factory=dict)

    def save(self, folder: str | Path, *, force: bool = False) -> Path:
        """Write ``tables.md``, a CSV and a LaTeX file each table, figures, further files, and a folder each study.

        Raises
        ------
        ExistsError
            If the folder exists (and holds no results, with ``force``).
        """
        with new_folder(folder, force=force) as new:
            plant = f" --plant {self.plant}" if self.plant else ""
            (new / MARK).write_text(f"# dqcontrol reproduce {self.name}{plant}\n", encoding="utf-8")
            text = "\n".join(table.markdown() for table in self.tables)
            (new / "tables.md").write_text(text, encoding="utf-8")
            for i, table in enumerate(self.tables, 1):
                write_table(table, new, f"table-{i}")
            for label, study in self.studies.items():
                study.save(new / label)
            for label, draw in self.figures.items():
                draw().savefig(new / f"{label}.png")
            for label, write in self.files.items():
                write(new / label)
        return Path(folder)

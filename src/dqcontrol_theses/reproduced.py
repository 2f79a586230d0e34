"""Published experiments run again: tables beside the printed ones, verdicts on the claims, all of it in a folder."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

from dqcontrol.errors import ValueRangeError, unknown_name
from dqcontrol.experiments import SPEC_FILE, Study, new_folder, write_table
from dqcontrol.reports import origins
from dqcontrol.tables import Table, VerdictCell
from dqcontrol_theses.catalogue import SAMPLES, Conditions, Progress, chosen_plant, experiments, names, source

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


def reproduce(
    name: str,
    *,
    plant: str | None = None,
    jobs: int | None = None,
    samples: int = SAMPLES,
    repeats: int | None = None,
    progress: Progress | None = None,
    unfinished: str | Path | None = None,
) -> Reproduced:
    """Run a published experiment again and hold it against what was printed.

    Parameters
    ----------
    name
        As `catalogue_table` lists them, with or without the source's name.
    plant
        What stands for the source's robot, one of those listed; default: the first.
    jobs
        Processes that work in parallel; as for `run_study`.
    samples
        Of each run in real time.
    repeats
        At most so many of each run, at least 1; default: as many as were printed.
    progress
        Called with the name of what is run, how much of it is done, and how much it is in all.
    unfinished
        Working folder that keeps finished trials, searches and repeats, so that the same call resumes after an
        interruption; it stays there when all is done. Needs pyarrow.

    Raises
    ------
    UnknownNameError
        If there is no such experiment or plant.
    ValueRangeError
        If ``repeats`` is below 1.
    ExistsError
        If ``unfinished`` holds results of another experiment, number of repeats or version.

    Examples
    --------
    >>> from dqcontrol_theses import reproduce
    >>> done = reproduce("light-painting", plant="servo", jobs=1)
    >>> {study.rows[0]["stopped"] for study in done.studies.values()}
    {'duration'}
    """
    if repeats is not None and repeats < 1:
        raise ValueRangeError(f"repeats: must be at least 1, got {repeats}")
    full, *others = names(name)
    if others:
        raise unknown_name("reproduction", name, list(experiments()))
    folder, _, short = full.partition("/")
    kept = None if unfinished is None else Path(unfinished)
    conditions = Conditions(chosen_plant(full, plant), jobs, samples, repeats, progress, kept)
    return replace(source(folder).reproduce(short, conditions), conditions=_chosen(samples, repeats))


def is_finished(
    folder: str | Path,
    name: str,
    *,
    plant: str | None = None,
    samples: int = SAMPLES,
    repeats: int | None = None,
) -> bool:
    """Tell whether a folder holds the results that `reproduce` would give again: such folders are written whole.

    Parameters
    ----------
    folder
        Where `Reproduced.save` would write.
    name, plant, samples, repeats
        As for `reproduce`, the name with its source.
    """
    file = Path(folder) / SPEC_FILE
    same = Reproduced(name, [], plant=chosen_plant(name, plant), conditions=_chosen(samples, repeats))
    return file.is_file() and file.read_text(encoding="utf-8") == same.heading


def _chosen(samples: int, repeats: int | None) -> dict[str, int]:
    """Return the options that are not at their defaults."""
    chosen = {} if repeats is None else {"repeats": repeats}
    return chosen | ({} if samples == SAMPLES else {"samples": samples})

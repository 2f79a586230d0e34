"""Studies: the trials of a spec, their tables and plots."""

from __future__ import annotations

import os
import shutil
import warnings
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from dqcontrol.errors import DivergedError, LimitWarning
from dqcontrol.experiments.prepared_experiment import PreparedExperiment, prepare
from dqcontrol.experiments.processes import in_processes
from dqcontrol.experiments.result_pages import result_pages
from dqcontrol.experiments.results_folder import PARENT, SPEC_FILE, folder_names, new_folder
from dqcontrol.experiments.row_file import Row, write_rows
from dqcontrol.experiments.run import Run, execute
from dqcontrol.experiments.run_comparison import MEANS, MOST_CURVES, summary_of, unit_of_way, write_table
from dqcontrol.experiments.spec import Spec, read_spec
from dqcontrol.experiments.spec.spec_files import copy_inputs
from dqcontrol.experiments.trials import Trial, trial_folder
from dqcontrol.experiments.verdict import headline, verdict_of
from dqcontrol.files.yaml_file import parse_yaml
from dqcontrol.loop import Record
from dqcontrol.loop.record import has_failed, thinned
from dqcontrol.measures.repeats import (
    confidence_table,
    differences_table,
    means_table,
    repeatability_table,
)
from dqcontrol.tables.tables import Table


def noise_model(spec: Spec) -> str:
    """Return what is drawn from each repeat's seed: the encoders of the plants and random disturbances.

    Examples
    --------
    >>> from dqcontrol.experiments import read_spec
    >>> spec, _ = read_spec({
    ...     "name": "noise", "robot": "iiwa7", "start": [0, 0.6, 0, 1.6, 0, 0.6, 0], "period": 0.01,
    ...     "reference": {"kind": "circle", "radius": 0.07, "duration": 2},
    ...     "law": {"kind": "proportional", "gain": 10},
    ...     "plant": {"kind": "servo", "encoder_noise": 1e-4, "encoder_resolution": 1e-3},
    ... })
    >>> noise_model(spec)
    'white encoder noise of 0.0001 rad before rounding to 0.001 rad'
    """
    plants = spec.plant_by_label
    parts = []
    for label, plant in plants.items():
        noise, step = map(_size, plant.encoder_errors())
        said = [f"white encoder noise of {noise} rad"] if noise else []
        said += [f"{'before ' if noise else 'encoders '}rounding to {step} rad"] if step else []
        if said:
            parts.append(f"{label}: {' '.join(said)}" if len(plants) > 1 else " ".join(said))
    if spec.disturbance is not None:
        parts.append("the spec's disturbance")
    return "; ".join(parts) or "none"


def _size(value: float | list[float]) -> str:
    """Return a size as text, several as their range; empty for none."""
    sizes = value if isinstance(value, list) else [value]
    if not any(sizes):
        return ""
    return f"{min(sizes):g}" if min(sizes) == max(sizes) else f"{min(sizes):g} … {max(sizes):g}"


ROWS = "runs.parquet"
_WORTH_PROCESSES = 4  # runs whose figures take longer than starting processes
_DRAWN = 20_000  # samples of a run in a picture of several; a longer one takes more memory than the study


@dataclass(frozen=True)
class Study:
    """The trials of a spec.

    Attributes
    ----------
    name
        Of the spec.
    spec
        Its YAML text with all defaults.
    runs
        Those whose records are in memory, by label: the robot, law, set and plant that there are several of, and the
        repeat.
    rows
        One a trial: ``robot``, ``law``, ``set`` and ``plant`` (labels, empty where there is one without a label),
        ``repeat``, ``seed``, ``stopped``, ``parameter.X`` for every key X of a grid, and all numbers of `Metrics.flat`;
        None where one does not exist.
    recordings
        Folder in which each trial has its own, ``LABEL/REPEAT``, if they were written while the study ran.
    taken_over
        How many trials were finished when the study was interrupted earlier, and not repeated.
    """

    name: str
    spec: str
    runs: dict[str, Run]
    rows: list[Row] = field(default_factory=list)
    recordings: Path | None = None
    taken_over: int = 0

    def __repr__(self) -> str:
        return f"Study({self.name!r}, {len(self.rows)} trials, {len(self.runs)} with records)"

    def __str__(self) -> str:
        """Return the table."""
        return str(self.table())

    @property
    def is_repeated(self) -> bool:
        """Whether any combination ran more than once."""
        return any(row["repeat"] for row in self.rows)

    @property
    def headline(self) -> str:
        """The first line on it: what came of its one run, or how many failed, and of one of these why."""
        return headline([(Trial.of(row).label(self.is_repeated), verdict_of(row)) for row in self.rows])

    @property
    def is_good(self) -> bool:
        """Whether every run did what was asked and kept what it was to keep."""
        return not any(verdict_of(row).failure for row in self.rows)

    def failures(self) -> list[str]:
        """Say of each combination of robot, law, set and plant that diverged or faulted how often, when and why."""
        lines = []
        for label, trials in by_label(self.rows).items():
            if gone := [row for row in trials if has_failed(str(row["stopped"]))]:
                count = f"{len(gone)} of {len(trials)} repeats " if self.is_repeated else ""
                seed = f" (seed {gone[0]['seed']})" if self.is_repeated else ""
                lines.append(f"{label}: {count}{gone[0]['stopped']}{seed}")
        return lines

    def table(self) -> Table:
        """Return means and standard deviations of repeats; one row a run where there are none."""
        if self.is_repeated:
            return means_table(self.rows, MEANS, self.name)
        rows = ((Trial.of(row).names.label, row) for row in self.rows)
        return summary_of(rows, self.name, unit_of_way(run.robot for run in self.runs.values()))

    def _repr_markdown_(self) -> str:
        """Return what notebooks show: the table."""
        return self.table().markdown()

    def save(
        self,
        folder: str | Path,
        *,
        force: bool = False,
        figures: bool | None = None,
        jobs: int | None = None,
        progress: Callable[[int, int], None] | None = None,
    ) -> Path:
        """Write ``spec.yaml``, ``report.html``, tables and comparison plots, and what was kept of each trial.

        Without repeats and with records in memory: a folder a run. Otherwise ``runs.parquet`` with its rows, and with
        records ``runs/LABEL/REPEAT``.

        Parameters
        ----------
        folder
            A new folder.
        force
            Replace it, if it holds earlier results.
        figures
            True: those of each run and of all together; default: those of all together, each run takes a second;
            False: none. `dqcontrol.reports.rewrite_reports` draws what is missing later.
        jobs
            Processes that draw in parallel; default: as many as there are processors, or one for few runs.
        progress
            Called with the number of pages of runs written, and of all of them.

        Raises
        ------
        ExistsError
            If the folder exists (and holds no results, with ``force``).
        """
        with new_folder(folder, force=force) as new:
            (new / SPEC_FILE).write_text(self.spec, encoding="utf-8")
            copy_inputs(parse_yaml("spec", self.spec), new)
            names = folder_names(self.runs) if self.runs and not self.is_repeated else {}
            folders = {label: new / name for label, name in names.items()}
            self._write_runs(folders, figures is True, jobs, progress)
            if not names:
                self._write_trials(new)
            tables = self._write_tables(new)
            records: dict[str, Record] = {}
            if figures is not False:
                records = {label: self.runs[label].record for label in names} or self._first_repeats()
            write_table(self.table(), new, "table")
            pages = {label: f"{name}/report.html" for label, name in names.items()}
            result_pages().write_study(self, new, tables, records, pages, figures=figures is not False)
        return Path(folder)

    def _write_runs(
        self,
        folders: Mapping[str, Path],
        figures: bool,
        jobs: int | None,
        progress: Callable[[int, int], None] | None,
    ) -> None:
        """Write the folder of each run, in parallel where that saves time."""
        import joblib

        pages = [_Page(self.runs[label], folder, figures) for label, folder in folders.items()]
        if jobs is None:
            jobs = joblib.cpu_count() if figures and len(pages) >= _WORTH_PROCESSES else 1
        done = map(_write_page, pages) if jobs == 1 else in_processes(_write_page, pages, jobs)
        for count, _ in enumerate(done, 1):
            if progress:
                progress(count, len(pages))

    def _write_trials(self, new: Path) -> None:
        write_rows(new / ROWS, self.rows, {"spec": self.spec})
        if self.recordings is not None:
            shutil.copytree(self.recordings, new / "runs", copy_function=_link_or_copy)
        elif self.runs:
            for row in self.rows:
                if run := self.runs.get(Trial.of(row).label(repeated=True)):
                    inner = trial_folder(new / "runs", Trial.of(row))
                    inner.mkdir(parents=True)
                    run.write_data(inner)

    def _write_tables(self, new: Path) -> list[Table]:
        """Write the tables of repeats, and return them."""
        if not self.is_repeated:
            return []
        spec, _ = read_spec(parse_yaml("spec", self.spec))
        tables = {
            "confidence": confidence_table(self.rows, MEANS),
            "repeatability": repeatability_table(self.rows, noise=noise_model(spec)),
        }
        groups = [(row["robot"], row["set"], row["plant"]) for row in self.rows if row["repeat"] == 0]
        if len(groups) > len(set(groups)):  # somewhere two laws can be compared
            tables["differences"] = differences_table(self.rows)
        for name, table in tables.items():
            write_table(table, new, name)
        return list(tables.values())

    def setting(self) -> PreparedExperiment:
        """Return the spec made ready once more, without the warnings that were given before."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", LimitWarning)
            return prepare(parse_yaml("spec", self.spec))

    def _first_repeats(self) -> dict[str, Record]:
        """Run the first repeat of each combination again, as many as a figure shows."""
        setting, records = self.setting(), {}
        for case in setting.cases[:MOST_CURVES]:
            with suppress(DivergedError):
                records[case.names.label] = thinned(execute(setting, case), _DRAWN)
        return records


class _Page(NamedTuple):
    """A run, the new folder that it is written into, and whether with figures."""

    run: Run
    folder: Path
    figures: bool


def _write_page(page: _Page) -> None:
    page.folder.mkdir()
    page.run.write(page.folder, f"{PARENT}/{PARENT}", figures=page.figures)


def by_label(rows: Iterable[Row]) -> dict[str, list[Row]]:
    """Return the repeats of each combination."""
    groups: dict[str, list[Row]] = {}
    for row in rows:
        groups.setdefault(Trial.of(row).names.label, []).append(row)
    return groups


def _link_or_copy(source: str, target: str) -> None:
    """Give a file a second name; on file systems without, copy it."""
    try:
        os.link(source, target)
    except OSError:
        shutil.copy2(source, target)

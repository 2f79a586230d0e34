"""Studies: all robots, laws, parameter sets and plants of a spec, repeated; their trials, tables and plots."""

from __future__ import annotations

import os
import shutil
import warnings
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from dqcontrol.errors import DivergedError, LimitWarning, ValueRangeError
from dqcontrol.experiments.check import warn_unstable
from dqcontrol.experiments.journal import Journal
from dqcontrol.experiments.output import MARK, check_new, folder_names, new_folder
from dqcontrol.experiments.repeat_tables import differences_table, means_table, repeatability_table
from dqcontrol.experiments.row_file import Row, write_rows
from dqcontrol.experiments.run import Run, beyond_limits, execute
from dqcontrol.experiments.setting import Names, Setting, prepare
from dqcontrol.experiments.tables import Column, Table
from dqcontrol.experiments.trials import Batch, Trial, outcomes, sensible_jobs, trial_folder
from dqcontrol.yaml_file import parse_yaml

COMPARED = {  # keys of `Metrics.flat`; errors without the start that the spec excludes
    "position.settled_mean": Column("mean", "mm", ".3g"),
    "position.settled_rms": Column("RMS", "mm", ".3g"),
    "position.settled_peak": Column("max", "mm", ".3g"),
    "orientation.settled_rms": Column("RMS", "°", ".3g"),
    "orientation.settled_peak": Column("max", "°", ".3g"),
    "effort": Column("effort", "rad/√s", ".3g"),
    "control.peak": Column("peak |u|", "rad/s", ".3g"),
    "hand_speed.peak": Column("peak speed", "m/s", ".3g"),
    "hand_acceleration.peak": Column("peak acc.", "m/s²", ".3g"),
    "limit_margin": Column("limit margin", "rad", ".3g"),
}

MEANS = (
    "position.settled_rms",
    "position.settled_peak",
    "orientation.settled_rms",
    "error.integral",
    "control.integral",
    "effort",
)
ROWS = "runs.parquet"
_MOST_CURVES = 12

StudyProgress = Callable[[float, int], None]  # trials done, with parts of the one that runs; trials in all


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

    @property
    def is_repeated(self) -> bool:
        """Whether any combination ran more than once."""
        return any(row["repeat"] for row in self.rows)

    def divergences(self) -> list[str]:
        """Say of each combination of robot, law, set and plant that left the finite numbers how often, when and why."""
        lines = []
        for label, trials in _by_label(self.rows).items():
            if gone := [row for row in trials if str(row["stopped"]).startswith("diverged")]:
                count = f"{len(gone)} of {len(trials)} repeats " if self.is_repeated else ""
                seed = f" (seed {gone[0]['seed']})" if self.is_repeated else ""
                lines.append(f"{label}: {count}{gone[0]['stopped']}{seed}")
        return lines

    def table(self) -> Table:
        """Return means and standard deviations of repeats; one row a run where there are none."""
        if self.is_repeated:
            return means_table(self.rows, MEANS, self.name)
        return _summary(((_trial(row).names.label, row) for row in self.rows), self.name)

    def save(self, folder: str | Path, *, force: bool = False) -> Path:
        """Write ``spec.yaml``, tables and comparison plots, and what was kept of each trial.

        Without repeats and with records in memory: a folder a run. Otherwise ``runs.parquet`` with `rows`, and with
        records ``runs/LABEL/REPEAT``.

        Parameters
        ----------
        folder
            A new folder.
        force
            Replace it, if it holds earlier results.

        Raises
        ------
        ExistsError
            If the folder exists (and holds no results, with ``force``).
        """
        with new_folder(folder, force=force) as new:
            (new / MARK).write_text(self.spec, encoding="utf-8")
            if self.runs and not self.is_repeated:
                for label, name in folder_names(self.runs).items():
                    (new / name).mkdir()
                    self.runs[label].write(new / name)
                write_comparison(self.runs, new, self.name)
            else:
                self._write_trials(new)
        return Path(folder)

    def _write_trials(self, new: Path) -> None:
        write_rows(new / ROWS, self.rows, {"spec": self.spec})
        if self.recordings is not None:
            shutil.copytree(self.recordings, new / "runs", copy_function=_link)
        elif self.runs:
            for row in self.rows:
                if run := self.runs.get(_label(row, repeated=True)):
                    inner = trial_folder(new / "runs", _trial(row))
                    inner.mkdir(parents=True)
                    run.write_data(inner)
        for name, table in self._tables().items():
            table.write(new / f"{name}.md")
            table.write(new / f"{name}.csv")
        setting = _prepared_again(self.spec)
        examples = {}
        for case in setting.cases[:_MOST_CURVES]:
            try:
                examples[case.names.label] = execute(setting, case)
            except DivergedError:
                continue
        if examples:
            from dqcontrol.view import save_comparison

            save_comparison(examples, new)

    def _tables(self) -> dict[str, Table]:
        tables = {"table": self.table()}
        if self.is_repeated:
            tables["repeatability"] = repeatability_table(self.rows)
            if len({row["law"] for row in self.rows}) > 1:
                tables["differences"] = differences_table(self.rows)
        return tables


def run_study(
    source: str | Path | dict[str, Any],
    *,
    jobs: int | None = None,
    progress: StudyProgress | None = None,
    journal: str | Path | None = None,
) -> Study:
    """Run every robot, law, parameter set and plant of a spec, as often as it says.

    The same spec gives the same rows to the last bit, whatever the number of jobs.

    Parameters
    ----------
    source
        Path of a YAML file, or the same as a dictionary; see `dqcontrol.experiments.Spec`.
    jobs
        Processes that work in parallel; default: as many as there are processors, or one if there is little to do.
    progress
        Called with the number of trials done, with parts of the one that runs, and of trials in all.
    journal
        Working folder that keeps finished trials, so that the same call goes on after an interruption; it stays there
        when the study is complete. Needs pyarrow.

    Raises
    ------
    dqcontrol.Error
        If something is missing, malformed, does not fit or is out of reach; before anything moves.

    Examples
    --------
    >>> import dqcontrol as dqc
    >>> study = dqc.run_study({
    ...     "name": "noise", "robot": "iiwa7", "start": [0, 0.6, 0, 1.6, 0, 0.6, 0], "period": 0.01,
    ...     "reference": {"kind": "circle", "radius": 0.07, "duration": 2},
    ...     "law": {"kind": "proportional", "gain": 10}, "plant": {"kind": "servo", "encoder_noise": 1e-4},
    ...     "repeats": 3,
    ... })
    >>> [row["seed"] for row in study.rows]
    [0, 1, 2]
    """
    setting = prepare(source)
    if journal is None:
        return _run(setting, _checked_jobs(jobs), progress, None)
    with Journal(Path(journal), setting) as kept:
        return _run(setting, _checked_jobs(jobs), progress, kept)


def run_study_to(
    source: str | Path | dict[str, Any],
    folder: str | Path,
    *,
    force: bool = False,
    jobs: int | None = None,
    progress: StudyProgress | None = None,
) -> Study:
    """Run a study and save it; after an interruption the same call goes on with the trials that are left.

    Finished trials are kept in ``.NAME.part`` beside the folder NAME until the study is complete; only a study that
    keeps all records of single runs does without.

    Parameters
    ----------
    source, jobs, progress
        As for `run_study`.
    folder
        A new folder; a spec of one run makes a folder of a run.
    force
        Replace the folder, if it holds earlier results, and discard the finished trials of another spec or version.

    Raises
    ------
    dqcontrol.Error
        As for `run_study`, or if the folder must not be written.
    """
    setting, target = prepare(source), Path(folder)
    check_new(target, force=force)
    jobs = _checked_jobs(jobs)
    if setting.spec.keeps_records and setting.spec.repeats == 1:
        study = _run(setting, jobs, progress, None)
        if not study.runs:
            raise DivergedError(str(study.rows[0]["stopped"]))
        (next(iter(study.runs.values())) if setting.spec.is_single else study).save(target, force=force)
        return study
    with Journal(working_folder(target), setting, force=force) as journal:
        study = _run(setting, jobs, progress, journal)
        study.save(target, force=force)
        journal.discard()
    return study


def working_folder(folder: Path) -> Path:
    """Return where the finished trials of a study are kept until its folder is complete."""
    return folder.parent / f".{folder.name}.part"


def _checked_jobs(jobs: int | None) -> int | None:
    if jobs is not None and (isinstance(jobs, bool) or not isinstance(jobs, int) or jobs < 1):
        raise ValueRangeError(f"jobs: expected an integer ≥ 1, got {jobs!r:.80}")
    return jobs


def _run(
    setting: Setting, jobs: int | None, progress: StudyProgress | None, journal: Journal | None
) -> Study:
    warn_unstable(setting, stacklevel=3)
    spec = setting.spec
    rows = journal.finished() if journal else {}
    taken_over = len(rows)
    recordings = journal.recordings if journal and spec.keeps_records else None
    batches, order = [], []
    for case in setting.cases:
        trials = [Trial(case.names, repeat) for repeat in range(spec.repeats)]
        order += trials
        if left := [trial.repeat for trial in trials if trial not in rows]:
            batches.append(Batch(setting, case, left, recordings))
    report = progress or (lambda done, total: None)
    report(taken_over, len(order))
    runs: dict[Trial, Run] = {}
    jobs = sensible_jobs(batches) if jobs is None else jobs
    for outcome in outcomes(batches, jobs, lambda done, all_: report(len(rows) + done / all_, len(order))):
        rows[outcome.trial] = outcome.row
        if outcome.run is not None:
            runs[outcome.trial] = outcome.run
        if journal:
            journal.add(outcome)
        report(len(rows), len(order))
    _warn_of_limits(rows[trial] for trial in order)
    labelled = {_label(rows[trial], spec.repeats > 1): runs[trial] for trial in order if trial in runs}
    return Study(spec.name, setting.text, labelled, [rows[t] for t in order], recordings, taken_over)


def _trial(row: Mapping[str, Any]) -> Trial:
    return Trial(Names(*(row[key] for key in Names._fields)), row["repeat"])


def _label(row: Mapping[str, Any], repeated: bool) -> str:
    names, repeat = _trial(row)
    return f"{names.label} · {repeat}" if repeated else names.label


def _by_label(rows: Iterable[Row]) -> dict[str, list[Row]]:
    """Return the repeats of each combination."""
    groups: dict[str, list[Row]] = {}
    for row in rows:
        groups.setdefault(_trial(row).names.label, []).append(row)
    return groups


def _warn_of_limits(rows: Iterable[Row]) -> None:
    for label, trials in _by_label(rows).items():
        if any((row["limit_margin"] or 0.0) < 0 for row in trials):  # type: ignore[operator]
            warnings.warn(beyond_limits(label, trials), LimitWarning, stacklevel=4)


def _prepared_again(text: str) -> Setting:
    """Return a setting from its own text, without the warnings that were given before."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LimitWarning)
        return prepare(parse_yaml("spec", text))


def _link(source: str, target: str) -> None:
    """Give a file a second name; on file systems without, copy it."""
    try:
        os.link(source, target)
    except OSError:
        shutil.copy2(source, target)


def summary(runs: Mapping[str, Run], title: str = "") -> Table:
    """Return one row a run; errors in mm and degrees are those after the start that the spec excludes."""
    return _summary(
        ((label, run.metrics.flat() | {"stopped": run.record.stopped}) for label, run in runs.items()), title
    )


def _summary(rows: Iterable[tuple[str, Mapping[str, Any]]], title: str) -> Table:
    lines = [[label, *(row[key] for key in COMPARED), row["stopped"]] for label, row in rows]
    return Table([Column("run"), *COMPARED.values(), Column("ended by")], lines, title)


def write_comparison(runs: Mapping[str, Run], folder: Path, title: str) -> None:
    """Write table and comparison plots of several runs into an existing folder."""
    from dqcontrol.view import save_comparison

    table = summary(runs, title)
    table.write(folder / "table.md")
    table.write(folder / "table.csv")
    save_comparison({label: run.record for label, run in runs.items()}, folder)

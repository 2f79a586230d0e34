"""Running the trials of a study, and keeping those that are finished."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

from dqcontrol.errors import DivergedError, FileFormatError
from dqcontrol.experiments.check import warn_unstable
from dqcontrol.experiments.failure_hints import warn_of_failures
from dqcontrol.experiments.prepared_experiment import PreparedExperiment, prepare
from dqcontrol.experiments.processes import checked_jobs
from dqcontrol.experiments.results_folder import WorkingFolder, check_new, told_first, working_folder
from dqcontrol.experiments.row_file import Row, read_rows, write_rows
from dqcontrol.experiments.run import Run, as_run
from dqcontrol.experiments.study import Study, by_label
from dqcontrol.experiments.trials import Batch, Trial, TrialOutcome, outcomes, sensible_jobs, trial_folder
from dqcontrol.recording import load_record

_EVERY = 2.0  # s between parts


class Journal(WorkingFolder):
    """A working folder with the rows of a study's finished trials, in the order that they finish.

    Parameters
    ----------
    folder, force
        As for `WorkingFolder`, which says what is raised, too.
    setting
        The study.
    """

    def __init__(self, folder: Path, setting: PreparedExperiment, *, force: bool = False) -> None:
        self._pending: list[Row] = []
        self._written = time.monotonic()
        super().__init__(folder, setting.text, setting.fingerprint(), force=force)
        self._next = max(self.parts(), default=-1) + 1

    def finished(self) -> dict[Trial, Row]:
        """Return the rows of all finished trials.

        Raises
        ------
        FileFormatError
            If a part is damaged.
        """
        rows: dict[Trial, Row] = {}
        for path in self.parts().values():
            try:
                rows |= {Trial.of(row): row for row in read_rows(path)}
            except (FileFormatError, KeyError) as error:
                raise FileFormatError(
                    f"{path}: is damaged ({error}); remove it to repeat its trials"
                ) from None
        return rows

    def add(self, outcome: TrialOutcome) -> None:
        """Note a finished trial; it reaches the disk within two seconds, or when the journal is closed."""
        self._pending.append(outcome.row)
        if time.monotonic() - self._written > _EVERY:
            self._flush()

    def _flush(self) -> None:
        if self._pending:
            write_rows(self.part(self._next), self._pending, {})
            self._pending, self._next = [], self._next + 1
        self._written = time.monotonic()

    def close(self) -> None:
        """Write what is noted, and let others in."""
        try:
            self._flush()
        finally:
            super().close()

    def discard(self) -> None:
        """Remove the folder."""
        self._pending = []
        super().discard()


StudyProgress = Callable[[float, int], None]  # trials done, with parts of the one that runs; trials in all


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
        As for `run`.
    jobs
        Processes that work in parallel; default: as many as there are processors, or one if there is little to do.
    progress
        Called with the number of trials done, with parts of the one that runs, and of trials in all.
    journal
        Working folder that keeps finished trials, with their records where the study gives them, so that the same call
        resumes after an interruption; it stays there when the study is complete. Needs pyarrow.

    Raises
    ------
    Error
        If something is missing, malformed, does not fit or is out of reach; before anything moves.

    Examples
    --------
    >>> import dqcontrol as dqc
    >>> circle, law = {"kind": "circle", "radius": 0.07, "duration": 2}, {"kind": "proportional", "gain": 10}
    >>> spec = {"name": "noise", "robot": "iiwa7", "start": [0, 0.6, 0, 1.6, 0, 0.6, 0], "period": 0.01}
    >>> spec |= {"reference": circle, "law": law, "plant": {"kind": "servo", "encoder_noise": 1e-4}}
    >>> study = dqc.run_study(spec | {"repeats": 3})
    >>> [row["seed"] for row in study.rows]
    [0, 1, 2]
    """
    setting = prepare(source)
    with nullcontext() if journal is None else Journal(Path(journal), setting) as kept:
        study = _run(setting, checked_jobs(jobs), progress, kept)
    _warn(setting, study)
    return study


def run_study_to(
    source: str | Path | dict[str, Any],
    folder: str | Path,
    *,
    force: bool = False,
    jobs: int | None = None,
    figures: bool | None = None,
    progress: StudyProgress | None = None,
    computed: Callable[[Study], None] | None = None,
    drawing: Callable[[int, int], None] | None = None,
) -> Study:
    """Run a study and save it; after an interruption the same call resumes with the trials that are left.

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
    figures
        As for `Study.save`; a single run has its figures unless this is False.
    computed
        Called with the study once it has run, before figures and reports are written.
    drawing
        Called with the number of reports of single runs that are written, and of all of them.

    Raises
    ------
    Error
        As for `run_study`, or if the folder must not be written.
    """
    setting, target = prepare(source), Path(folder)
    check_new(target, force=force)
    jobs = checked_jobs(jobs)
    if setting.spec.keeps_records and setting.spec.repeats == 1:
        study = _run(setting, jobs, progress, None)
        if not study.runs:
            raise DivergedError(str(study.rows[0]["stopped"]))
        with told_first(computed, study):
            _warn(setting, study)
            if setting.spec.is_single:
                next(iter(study.runs.values())).save(target, force=force, figures=figures is not False)
            else:
                study.save(target, force=force, figures=figures, jobs=jobs, progress=drawing)
        return study
    with Journal(working_folder(target), setting, force=force) as journal:
        study = _run(setting, jobs, progress, journal)
        with told_first(computed, study):
            _warn(setting, study)
            study.save(target, force=force, figures=figures, jobs=jobs, progress=drawing)
            journal.discard()
    return study


def _warn(setting: PreparedExperiment, study: Study) -> None:
    """Warn the caller of a public function of what fell short."""
    rows = by_label(study.rows)
    warn_of_failures([(case, rows[case.names.label]) for case in setting.cases], stacklevel=3)


def _run(
    setting: PreparedExperiment, jobs: int | None, progress: StudyProgress | None, journal: Journal | None
) -> Study:
    expected = {check.names: check for check in warn_unstable(setting, stacklevel=3)}
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
            runs[outcome.trial] = replace(outcome.run, expected=expected[outcome.trial.names])
        if journal:
            journal.add(outcome)
        report(len(rows), len(order))
    if recordings and spec.repeats == 1:
        runs = _read_back(setting, recordings)
        runs = {trial: replace(run, expected=expected[trial.names]) for trial, run in runs.items()}
    labelled = {trial.label(spec.repeats > 1): runs[trial] for trial in order if trial in runs}
    return Study(spec.name, setting.text, labelled, [rows[t] for t in order], recordings, taken_over)


def _read_back(setting: PreparedExperiment, recordings: Path) -> dict[Trial, Run]:
    """Return the runs that a study without repeats has left in its folder; those that diverged left none."""
    runs = {}
    for case in setting.cases:
        trial = Trial(case.names, 0)
        file = trial_folder(recordings, trial) / "record.mcap"
        if file.exists():
            runs[trial] = as_run(setting, case, 0, load_record(file))
    return runs

"""Studies: the trials of a spec and other parts of work, run and kept as they finish, and what came of them."""

from __future__ import annotations

import os
import shutil
import time
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import nullcontext, suppress
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import msgspec

from dqcontrol.compiled.kernel_cache import source_hash
from dqcontrol.errors import DivergedError, FileFormatError, LimitWarning
from dqcontrol.experiments import results_folder
from dqcontrol.experiments.check import warn_unstable
from dqcontrol.experiments.failure_hints import warn_of_failures
from dqcontrol.experiments.prepared_experiment import PreparedExperiment, prepare, program
from dqcontrol.experiments.processes import checked_jobs, in_processes, sensible_jobs
from dqcontrol.experiments.result_pages import result_pages
from dqcontrol.experiments.run import Run, as_run, execute
from dqcontrol.experiments.run_comparison import MEANS, MOST_CURVES, summary_of, unit_of_way, write_table
from dqcontrol.experiments.spec import Spec, read_spec
from dqcontrol.experiments.spec.spec_files import write_spec
from dqcontrol.experiments.trials import Batch, Trial, TrialOutcome, outcomes, trial_folder
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
from dqcontrol.recording import load_record
from dqcontrol.tables.tables import Table, Tabled

T = TypeVar("T")
R = TypeVar("R")


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
_EVERY = 2.0  # s between parts of a journal
_WORTH_PROCESSES = 4  # runs whose figures take longer than starting processes
_DRAWN = 20_000  # samples of a run in a picture of several; a longer one takes more memory than the study


@dataclass(frozen=True)
class Study(Tabled):
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
    rows: list[results_folder.Row] = field(default_factory=list)
    recordings: Path | None = None
    taken_over: int = 0

    def __repr__(self) -> str:
        return f"Study({self.name!r}, {len(self.rows)} trials, {len(self.runs)} with records)"

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
        with results_folder.new_folder(folder, force=force) as new:
            write_spec(self.spec, new)
            names = results_folder.folder_names(self.runs) if self.runs and not self.is_repeated else {}
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
            result_pages().write_study_report(self, new, tables, records, pages, figures=figures is not False)
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
        results_folder.write_rows(new / ROWS, self.rows, {"spec": self.spec})
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
    page.run.write(page.folder, f"{results_folder.PARENT}/{results_folder.PARENT}", figures=page.figures)


def by_label(rows: Iterable[results_folder.Row]) -> dict[str, list[results_folder.Row]]:
    """Return the repeats of each combination."""
    groups: dict[str, list[results_folder.Row]] = {}
    for row in rows:
        groups.setdefault(Trial.of(row).names.label, []).append(row)
    return groups


def _link_or_copy(source: str, target: str) -> None:
    """Give a file a second name; on file systems without, copy it."""
    try:
        os.link(source, target)
    except OSError:
        shutil.copy2(source, target)


class Journal(results_folder.WorkingFolder):
    """A working folder with the rows of a study's finished trials, in the order that they finish.

    Parameters
    ----------
    folder, force
        As for `WorkingFolder`, which says what is raised, too.
    setting
        The study.
    """

    def __init__(self, folder: Path, setting: PreparedExperiment, *, force: bool = False) -> None:
        self._pending: list[results_folder.Row] = []
        self._written = time.monotonic()
        super().__init__(folder, setting.text, setting.fingerprint(), force=force)
        self._next = max(self.parts(), default=-1) + 1

    def finished(self) -> dict[Trial, results_folder.Row]:
        """Return the rows of all finished trials.

        Raises
        ------
        FileFormatError
            If a part is damaged.
        """
        rows: dict[Trial, results_folder.Row] = {}
        for path in self.parts().values():
            try:
                rows |= {Trial.of(row): row for row in results_folder.read_rows(path)}
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
            results_folder.write_rows(self.part(self._next), self._pending, {})
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
    results_folder.check_new(target, force=force)
    jobs = checked_jobs(jobs)
    if setting.spec.keeps_records and setting.spec.repeats == 1:
        study = _run(setting, jobs, progress, None)
        if not study.runs:
            raise DivergedError(str(study.rows[0]["stopped"]))
        with results_folder.told_first(computed, study):
            _warn(setting, study)
            if setting.spec.is_single:
                next(iter(study.runs.values())).save(target, force=force, figures=figures is not False)
            else:
                study.save(target, force=force, figures=figures, jobs=jobs, progress=drawing)
        return study
    with Journal(results_folder.working_folder(target), setting, force=force) as journal:
        study = _run(setting, jobs, progress, journal)
        with results_folder.told_first(computed, study):
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
    jobs = sensible_jobs(sum(batch.seconds for batch in batches)) if jobs is None else jobs
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


def work_through(
    function: Callable[[T], R],
    kind: type[R],
    parts: Sequence[T],
    spec: str,
    jobs: int | None = None,
    progress: Callable[[float, int], None] | None = None,
    folder: Path | None = None,
) -> list[R]:
    """Return what a function gives for each part, in their order.

    Parameters
    ----------
    function
        Of a module, so that other processes find it.
    kind
        What it returns: a dataclass of plain numbers and words.
    parts
        Their ``repr`` tells them apart.
    spec
        Text of the experiment.
    jobs
        Processes that work in parallel; default: as many as there are processors.
    progress
        Called with the number of parts done, and of all of them.
    folder
        Working folder that keeps what is finished, so that the same call resumes after an interruption.

    Raises
    ------
    ExistsError
        If the folder holds results of another experiment or version.
    """
    if not parts:
        return []
    report, found = progress or (lambda done, total: None), {}
    kept = (
        nullcontext()
        if folder is None
        else results_folder.WorkingFolder(folder, spec, _fingerprint(function, parts))
    )
    with kept as working:
        files = [working.part(i).with_suffix(".found") for i in range(len(parts))] if working else []
        for i, file in enumerate(files):
            if file.exists():
                found[i] = msgspec.msgpack.decode(file.read_bytes(), type=kind)
        report(len(found), len(parts))
        left = [(i, part) for i, part in enumerate(parts) if i not in found]
        for i, result in _results(function, left, jobs):
            found[i] = result
            if files:
                results_folder.write_whole(files[i], msgspec.msgpack.encode(result))
            report(len(found), len(parts))
    return [found[i] for i in range(len(parts))]


def _fingerprint(function: Callable[[T], R], parts: Sequence[T]) -> str:
    return f"{program()} {source_hash(function.__module__, lazily=True)} {parts!r}"


def _results(
    function: Callable[[T], R], left: Sequence[tuple[int, T]], jobs: int | None
) -> Iterator[tuple[int, R]]:
    if jobs is None:
        import joblib

        jobs = joblib.cpu_count()
    if jobs == 1 or len(left) <= 1:
        yield from ((i, function(part)) for i, part in left)
        return
    yield from in_processes(partial(_numbered, function), left, min(jobs, len(left)))


def _numbered(function: Callable[[T], R], part: tuple[int, T]) -> tuple[int, R]:
    """Return a part's number beside its result, as other processes give it back."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the main process says what is to be said of the experiment
        return part[0], function(part[1])

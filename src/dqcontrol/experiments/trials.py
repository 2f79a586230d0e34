"""Trials: the single runs of a study, one after the other or in parallel processes."""

from __future__ import annotations

import math
import shutil
import tempfile
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

from dqcontrol.errors import DivergedError
from dqcontrol.experiments.prepared_experiment import Combination, Names, PreparedExperiment
from dqcontrol.experiments.processes import in_processes
from dqcontrol.experiments.results_folder import Row, folder_names
from dqcontrol.experiments.run import Run, as_run, execute, measure
from dqcontrol.experiments.verdict import Judge
from dqcontrol.loop import Record
from dqcontrol.measures.metric_tables import METRIC_COLUMNS

Steps = Callable[[int, int], None]

_STORED = 3e-4  # s a step, to write its record
_CHUNK = 1.0  # s of work that a process is given at once


class Trial(NamedTuple):
    """What names one trial of a study."""

    names: Names
    repeat: int

    @classmethod
    def of(cls, row: Row) -> Trial:
        """Return what a row of a study's table belongs to."""
        return cls(Names(*(str(row[key]) for key in Names._fields)), int(str(row["repeat"])))

    def label(self, repeated: bool) -> str:
        """Return its labels, and which repeat it is if there are several."""
        return f"{self.names.label} · {self.repeat}" if repeated else self.names.label


@dataclass(frozen=True)
class TrialOutcome:
    """What came of a trial: a row of the study's table, and the run where records are kept in memory."""

    trial: Trial
    row: Row
    run: Run | None


@dataclass(frozen=True)
class Batch:
    """Repeats of one case, which share the prepared law.

    Attributes
    ----------
    setting, case
        The spec, and which of its combinations.
    repeats
        Their numbers.
    folder
        Where their recordings go; None keeps them in memory. See `trial_folder`.
    """

    setting: PreparedExperiment
    case: Combination
    repeats: Sequence[int]
    folder: Path | None

    @property
    def seconds(self) -> float:
        """How long it takes, roughly."""
        spec = self.setting.spec
        step = self.case.plant.step_time(spec.period, is_compiled=self.case.is_compiled)
        stored = _STORED if self.folder and spec.keeps_records else 0.0
        return len(self.repeats) * len(self.case.scene.samples) * (step + stored)

    def split(self) -> Iterator[Batch]:
        """Return it in parts of about a second."""
        parts = min(math.ceil(self.seconds / _CHUNK), len(self.repeats))
        size = math.ceil(len(self.repeats) / parts)
        for first in range(0, len(self.repeats), size):
            yield replace(self, repeats=self.repeats[first : first + size])

    def outcomes(self, progress: Steps | None = None) -> Iterator[TrialOutcome]:
        """Run one trial after the other; ``progress`` is told each one's steps done and its steps in all."""
        case, law = self.case, self.case.prepare_law(self.setting.spec)
        case = case if law is case.prepared else replace(case, prepared=law)
        scene = case.scene
        spec = self.setting.spec
        whole = scene.reference.duration if spec.may_cut else 0.0
        judge = Judge(scene.robot, case.variant.law, case.plant, spec, scene.tasks, scene.desired, whole)
        for repeat in self.repeats:
            yield self._outcome(case, repeat, progress, judge)

    def _outcome(self, case: Combination, repeat: int, progress: Steps | None, judge: Judge) -> TrialOutcome:
        trial, spec = Trial(case.names, repeat), self.setting.spec
        try:
            record = execute(self.setting, case, repeat, progress=progress)
        except DivergedError as error:
            return TrialOutcome(trial, self._row(repeat, str(error), dict.fromkeys(METRIC_COLUMNS)), None)
        found = measure(record, case.scene.robot, spec.skip_initial, spec.metrics_from, judge=judge)
        run = self._kept(case, repeat, record) if spec.keeps_records else None
        return TrialOutcome(trial, self._row(repeat, record.stopped, found.flat()), run)

    def _row(self, repeat: int, stopped: str, metrics: Mapping[str, float | int | str | None]) -> Row:
        parameters = {f"parameter.{key}": value for key, value in self.case.variant.point.items()}
        trial: Row = {"repeat": repeat, "seed": self.setting.spec.seed + repeat, "stopped": stopped}
        return {**self.case.names._asdict(), **trial, **parameters, **metrics}

    def _kept(self, case: Combination, repeat: int, record: Record) -> Run | None:
        run = as_run(self.setting, case, repeat, record)
        if self.folder is None:
            return run
        target = trial_folder(self.folder, Trial(case.names, repeat))
        target.parent.mkdir(parents=True, exist_ok=True)
        draft = Path(tempfile.mkdtemp(prefix=".", dir=target.parent))
        run.write_data(draft)
        draft.chmod(0o755)
        shutil.rmtree(target, ignore_errors=True)  # of a study that was interrupted before it noted the trial
        draft.rename(target)
        return None


def trial_folder(folder: Path, trial: Trial) -> Path:
    """Return where a trial's recording goes: ``folder/LABEL/REPEAT``."""
    return folder / folder_names([trial.names.label])[trial.names.label] / str(trial.repeat)


def outcomes(batches: Sequence[Batch], jobs: int, progress: Steps | None = None) -> Iterator[TrialOutcome]:
    """Run batches, and give each outcome as soon as it is there; in processes, in any order.

    Raises
    ------
    Error
        If a process dies.
    """
    parts = [part for batch in batches for part in batch.split()]
    if jobs == 1 or len(parts) == 1:
        for batch in batches:
            yield from batch.outcomes(progress)
        return
    precompile(batches)
    results = in_processes(_in_process, map(_alone, parts), min(jobs, len(parts)))
    for some in results:
        yield from map(_received, some)


def _in_process(batch: Batch) -> list[TrialOutcome]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the main process has said it, or says it once for all trials
        return list(batch.outcomes())


def _received(outcome: TrialOutcome) -> TrialOutcome:
    """Return an outcome that came from a process with a record that cannot be changed, as it was there."""
    run = outcome.run
    return outcome if run is None else replace(outcome, run=replace(run, record=replace(run.record)))


def _alone(batch: Batch) -> Batch:
    """Return a batch with nothing of its study that it does not need, to send it to a process."""
    case = replace(batch.case, prepared=None)
    setting = replace(batch.setting, scenes={case.names.robot: case.scene}, cases=(case,))
    return replace(batch, setting=setting, case=case)


def precompile(batches: Sequence[Batch]) -> None:
    """Run two samples of every kind of trial, so that what has to be compiled is compiled once, not in each process."""
    kinds = {}
    for batch in batches:
        law = batch.case.variant.law
        kinds[type(law), type(law.null_space), type(batch.case.plant)] = batch
    for batch in kinds.values():
        scene = replace(batch.case.scene, samples=batch.case.scene.samples[:2])
        with suppress(DivergedError):
            record = execute(batch.setting, replace(batch.case, scene=scene))
            measure(record, scene.robot, 0.0)

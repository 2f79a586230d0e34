"""Running a search: every law tuned under the same budget, in processes here or on a cluster."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import msgspec

from dqcontrol.errors import Error, ShapeError
from dqcontrol.experiments.check import LEAST_OVERSHOOT, loop_checks
from dqcontrol.experiments.prepared_experiment import prepare_spec, program
from dqcontrol.experiments.processes import checked_jobs, workers
from dqcontrol.experiments.result_pages import result_pages
from dqcontrol.experiments.results_folder import (
    SavedTable,
    WorkingFolder,
    check_new,
    new_folder,
    told_first,
    working_folder,
    write_rows,
)
from dqcontrol.experiments.run_comparison import write_table
from dqcontrol.experiments.spec import as_spec
from dqcontrol.experiments.spec.reference_spec import ObjectSpec
from dqcontrol.experiments.spec.spec_files import write_spec
from dqcontrol.files.output_file import finite_or_none, write_json, yaml_text
from dqcontrol.measures.metric_tables import NUMBER_COLUMNS
from dqcontrol.measures.metrics import AT_LIMIT
from dqcontrol.tables.number_texts import percent_text
from dqcontrol.tables.tables import Cell, Column, Table
from dqcontrol.tuning.law_search import LawResult, LawSearch, LawTask, ready_problem
from dqcontrol.tuning.spec_blocks import TuneProblem, read_tune

TuneProgress = Callable[[int, int], None]  # laws done; laws in all
WINNERS, BEST, EVALUATIONS, FRONTS = "winners.json", "best.yaml", "evaluations.parquet", "fronts.json"
_LARGER = 1.1  # times the searched total
_STEP = 1.5e-6  # s, roughly
_FASTER = ", less damped"  # behind the label of a law


@dataclass(frozen=True)
class TunedLaw:
    """One law, tuned.

    Attributes
    ----------
    result
        What was found.
    margin
        By how much its loop's gain could be multiplied, as ``check`` says; None if that is unknown.
    overshoot
        Of a step, as a share of it, as ``check`` says; None if that is unknown.
    verdict
        Of ``check``.
    objectives
        Names of the objectives.
    faster
        The same law with a gain whose total is smaller at the price of damping; None if there is none.
    """

    result: LawResult
    margin: float | None
    overshoot: float | None
    verdict: str
    objectives: tuple[str, ...]
    faster: TunedLaw | None = None

    @property
    def label(self) -> str:
        """Label of the law in the spec."""
        return self.result.label

    @property
    def succeeded(self) -> bool:
        """Whether it keeps all constraints on what was searched."""
        return self.result.violation == 0 and math.isfinite(self.result.total)

    def to_dict(self) -> dict[str, Any]:
        """Return an entry of ``winners.json``: numbers of the objectives in the units of tables."""

        def shown(values: Mapping[str, float], total: float) -> dict[str, float | None]:
            return finite_or_none({name: values[name] for name in self.objectives} | {"total": total})

        found = self.result
        return {
            "law": self.label,
            "parameters": found.parameters,
            "objectives": shown(found.searched, found.total),
            "held_out": shown(found.held_out, found.held_out_total),
            "margin": finite_or_none(self.margin),
            "overshoot": finite_or_none(self.overshoot),
            "verdict": self.verdict,
            "evaluations": found.evaluations,
        }


@dataclass(frozen=True)
class Tuning(SavedTable):
    """What a search found.

    Attributes
    ----------
    problem
        What was searched for.
    laws
        Each tuned, the best on what the search did not see first; those that break a constraint last.
    """

    problem: TuneProblem
    laws: tuple[TunedLaw, ...]

    def __repr__(self) -> str:
        return f"Tuning({self.problem.spec.name!r}, best: {self.laws[0].label!r})"

    @property
    def best(self) -> TunedLaw:
        """The first."""
        return self.laws[0]

    @cached_property
    def best_spec(self) -> dict[str, Any]:
        """The spec of one run with the best law, as plain data."""
        return self.spec_of(self.best.label)

    def spec_of(self, label: str) -> dict[str, Any]:
        """Return the spec of one run with the best parameters of a law, as plain data."""
        found = next(each for each in self.laws if each.label == label)
        data = {key: value for key, value in self.problem.data.items() if key not in ("law", "laws")}
        return data | {"law": found.result.law}

    def table(self) -> Table:
        """Return one row a law: parameters, objectives on what was searched and on what was not, margin."""
        names = list(self.problem.block.objectives)
        rows: list[list[tuple[Column, Cell]]] = []
        shown = [
            (f"{law.label}{_FASTER}" if law is each.faster else law.label, law)
            for each in self.laws
            for law in (each, each.faster)
            if law is not None
        ]
        for label, each in shown:
            found = each.result
            parameters = [f"{key} {_in_short(value)}" for key, value in found.parameters.items()]
            percent = None if each.overshoot is None else 100 * each.overshoot
            overshoot = percent if percent is None or percent >= LEAST_OVERSHOOT else 0.0
            rows.append(
                [
                    (Column("law"), label),
                    (Column("parameters"), ", ".join(parameters)),
                    *((NUMBER_COLUMNS[name], finite_or_none(found.searched[name])) for name in names),
                    (Column("total"), finite_or_none(found.total)),
                    (Column("total, held out"), finite_or_none(found.held_out_total)),
                    (Column("margin", "", ".3g"), finite_or_none(each.margin)),
                    (Column("overshoot", "%", ".2g"), overshoot),
                    (Column("verdict"), each.verdict),
                    (Column("evaluations"), found.evaluations),
                ]
            )
        return Table.of(rows, f"{self.problem.spec.name}: every law tuned")

    def remarks(self) -> list[str]:
        """Say what the table does not: constraints broken, sides of the box reached, limits of speed met."""
        lines = []
        for each in self.laws:
            found = each.result
            missing = [name for name in each.objectives if math.isnan(found.searched[name])]
            if not math.isfinite(found.total) and math.isfinite(found.searched["error.mean"]):
                lines.append(
                    f"{each.label}: {', '.join(missing)} has no value on these motions, as the settling time where the "
                    "hand begins on its target or does not settle; take another objective"
                )
                continue
            if not math.isfinite(found.total):
                lines.append(f"{each.label}: no parameters run to the end")
            elif found.violation:
                lines.append(f"{each.label}: no parameters keep the constraints; the nearest are shown")
            if found.held_out_violation:
                why = "breaks a constraint, or diverges, on what the search did not see"
                lines.append(f"{each.label}: {why}")
            free = [name for name in found.at_side if not name.endswith("(margin)")]
            if free:
                lines.append(f"{each.label}: {', '.join(free)} at an end of the range: widen it")
            if any(name.endswith("(margin)") for name in found.at_side):
                lines.append(f"{each.label}: as fast as margin and damping allow")
            if (faster := each.faster) is not None:
                lines.append(
                    f"{each.label}{_FASTER}: {faster.result.total / found.total:.2g} of that total, {faster.verdict} "
                    f"as check says, overshoot {percent_text(faster.overshoot or 0.0)}, margin "
                    f"{faster.margin or math.nan:.3g}; tune: {{damping: 0}} takes it"
                )
            if found.searched["saturation"] > 0:
                lines.append(
                    f"{each.label}: {percent_text(found.searched['saturation'])} of the samples are at velocity "
                    "limits: what was tuned is the saturation"
                )
            if found.searched["limit_margin"] < AT_LIMIT:
                lines.append(
                    f"{each.label}: a joint comes to its position limit on what was searched, and what was tuned is "
                    "how it stops; start elsewhere, or ask for room: constraints: {limit_margin: {low: 0.05}}"
                )
        return lines + self._held_out_remarks()

    def _held_out_remarks(self) -> list[str]:
        """Say whose total is larger on what the search did not see, and whether the search is to blame."""
        ratios = {
            each.label: each.result.held_out_total / each.result.total
            for each in self.laws
            if each.succeeded and each.result.total > 0 and math.isfinite(each.result.held_out_total)
        }
        larger = {label: ratio for label, ratio in ratios.items() if ratio > _LARGER}
        stopped = [each.label for each in self.laws if each.result.held_out["limit_margin"] < AT_LIMIT]
        if len(larger) == len(ratios) > 1 and not stopped:
            low, high = min(larger.values()), max(larger.values())
            return [
                f"held out: harder for every law, totals are {low:.3g} to {high:.3g} times those searched on; that is "
                "the motion rather than the search"
            ]
        at_limit = "a joint comes to its position limit there; hold out what the robot can do"
        return [
            f"{label}: held out its total is {ratio:.3g} times that searched on: "
            + (at_limit if label in stopped else "a harder motion, or the search saw too few")
            for label, ratio in larger.items()
        ]

    def winners(self) -> list[dict[str, Any]]:
        """Return what ``winners.json`` holds."""
        faster = [{"faster": each.faster.to_dict()} if each.faster else {} for each in self.laws]
        return [each.to_dict() | more for each, more in zip(self.laws, faster, strict=True)]

    def write(self, folder: Path) -> None:
        """Write ``winners.json``, ``best.yaml``, all evaluations, the table, figures and a report into a folder."""
        text = tune_text(self.problem)
        write_spec(text, folder)
        write_json(folder / WINNERS, self.winners())
        (folder / BEST).write_text(yaml_text(self.best_spec), encoding="utf-8")
        rows = [{"law": each.label} | row for each in self.laws for row in each.result.rows]
        write_rows(folder / EVALUATIONS, rows, {"spec": text})
        if self.problem.block.front:
            write_json(folder / FRONTS, self.fronts())
        write_table(self.table(), folder, "winners")
        result_pages().write_tuning_report(self, text, folder)

    def fronts(self) -> dict[str, list[dict[str, Any]]]:
        """Return of each law its best compromises: parameters, and both objectives."""
        front = self.problem.block.front
        if front is None:
            return {}
        first, second = front.objectives
        return {
            each.label: [{"parameters": p, first: a, second: b} for p, a, b in each.result.front]
            for each in self.laws
        }


def tune(
    source: str | Path | dict[str, Any],
    *,
    jobs: int | None = None,
    scheduler: str | None = None,
    progress: TuneProgress | None = None,
    journal: str | Path | None = None,
    **block: Any,
) -> Tuning:
    """Find the best parameters of every law of a spec, all under the same budget, and judge them on unseen runs.

    Parameters
    ----------
    source
        Path of a YAML file, or the same as a dictionary, with laws, one robot, one plant, and perhaps the block
        ``tune``; see `TuneBlock`.
    jobs
        Processes on this machine; default: as many as there are processors, or one if there is little to do.
    scheduler
        Address of a Dask scheduler, whose workers search in place of processes here.
    progress
        Called with laws done, and in all.
    journal
        Working folder that keeps what was evaluated, so that the same call resumes after an interruption; it stays
        there when the search is complete. Needs pyarrow.
    **block
        Keys of ``tune`` that differ, as ``budget=100``.

    Raises
    ------
    Error
        If something is missing, malformed, does not fit, is out of reach, or no law of a range can be stable; before
        anything runs.

    Examples
    --------
    >>> import dqcontrol as dqc
    >>> found = dqc.tune({
    ...     "name": "best", "robot": "iiwa7", "start": [0, 0.6, 0, 1.6, 0, 0.6, 0], "period": 0.01,
    ...     "reference": {"kind": "circle", "radius": 0.05, "duration": 1},
    ...     "law": {"kind": "proportional-feedforward", "gain": 5},
    ...     "plant": {"kind": "servo", "delay": 0.02, "encoder_noise": 2e-4},
    ... }, budget=8)
    >>> found.best.label, found.best.margin >= 2
    ('proportional-feedforward', True)
    """
    problem, jobs = read_tune(source, **block), checked_jobs(jobs)
    _check(problem, jobs, scheduler)
    if journal is None:
        return _tuned(problem, jobs, scheduler, None, progress)
    with _working_folder(Path(journal), problem) as kept:
        return _tuned(problem, jobs, scheduler, kept, progress)


def tune_to(
    source: str | Path | dict[str, Any],
    folder: str | Path,
    *,
    force: bool = False,
    jobs: int | None = None,
    scheduler: str | None = None,
    progress: TuneProgress | None = None,
    computed: Callable[[Tuning], None] | None = None,
) -> Tuning:
    """Do the same, and write a folder of results; after an interruption the same call resumes it.

    Parameters
    ----------
    source, jobs, scheduler, progress
        As for `tune`.
    folder
        A new folder.
    force
        Replace the folder, if it holds earlier results, and discard an unfinished search of another spec or version.
    computed
        Called with what was found before figures and report are written.

    Raises
    ------
    Error
        As `tune`, and if the folder must not be written.
    """
    problem, target, jobs = read_tune(source), Path(folder), checked_jobs(jobs)
    check_new(target, force=force)
    _check(problem, jobs, scheduler)
    with _working_folder(working_folder(target), problem, force=force) as kept:
        found = _tuned(problem, jobs, scheduler, kept, progress)
        with told_first(computed, found), new_folder(target, force=force) as new:
            found.write(new)
        kept.discard()
    return found


def _tuned(
    problem: TuneProblem,
    jobs: int | None,
    scheduler: str | None,
    kept: WorkingFolder | None,
    progress: TuneProgress | None,
) -> Tuning:
    labels = [variant.label for variant in problem.spec.variants]
    seconds = _STEP * ready_problem(problem).searched.steps * problem.block.budget * len(labels)
    version = program()
    tasks = [
        LawTask(problem, label, i, version, kept.part(i) if kept and scheduler is None else None)
        for i, label in enumerate(labels)
    ]
    results: dict[int, LawResult] = {}
    report = progress or (lambda done, total: None)
    report(0, len(tasks))
    jobs = 1 if _is_here(problem) else jobs
    with workers(LawTask.run, jobs, scheduler, seconds, len(tasks)) as carry_out:
        for part, result in carry_out(tasks):
            results[part] = result
            report(len(results), len(tasks))
    tuned = [_judged(problem, results[i]) for i in range(len(labels))]
    return Tuning(problem, tuple(sorted(tuned, key=_place)))


def _check(problem: TuneProblem, jobs: int | None, scheduler: str | None) -> None:
    """Raise if something of a search does not fit, before anything is written or runs."""
    if scheduler is not None and jobs is not None:
        raise Error("jobs: is for processes on this machine; leave it out with a scheduler")
    if _is_here(problem) and (scheduler is not None or jobs not in (None, 1)):
        raise Error(
            "reference: is an object of this program, which other processes do not have; leave out jobs"
        )
    for variant in problem.spec.variants:
        free = len(LawSearch(problem, variant.label).space.names)
        if problem.block.budget < 2 * free + 2:
            raise ShapeError(
                f"{problem.where}: tune.budget: {problem.block.budget} is too small for {free} free parameters of "
                f"{variant.label}; give {2 * free + 2} or more"
            )


def _is_here(problem: TuneProblem) -> bool:
    return isinstance(problem.spec.reference, ObjectSpec)


def _place(law: TunedLaw) -> tuple[bool, bool, float, float]:
    found = law.result
    held_out = bool(found.held_out_violation) or not math.isfinite(found.held_out_total)
    return not law.succeeded, held_out, found.held_out_total, found.total


def _judged(problem: TuneProblem, result: LawResult) -> TunedLaw:
    """Return a law as ``check`` sees it."""
    data = {key: value for key, value in problem.data.items() if key not in ("law", "laws")}
    spec = as_spec(problem.where, data | {"law": result.law}, problem.folder)
    (row,) = loop_checks(prepare_spec(spec, problem.folder, {}))
    margin = overshoot = None
    if row.loops:
        margin, overshoot = row.worst.margin, row.overshoot
    elif row.numeric:
        margin = row.numeric.margin
    faster = _judged(problem, result.faster) if result.faster else None
    return TunedLaw(result, margin, overshoot, row.verdict, tuple(problem.block.objectives), faster)


def tune_text(problem: TuneProblem) -> str:
    """Return spec and block as YAML with absolute file names, so that it runs anywhere."""
    block = msgspec.to_builtins(problem.block, enc_hook=str)
    return yaml_text(problem.data | {"tune": _without_empty(block)})


def _without_empty(block: Any) -> Any:
    if not isinstance(block, dict):
        return block
    return {key: _without_empty(value) for key, value in block.items() if value not in (None, {}, [])}


def _working_folder(folder: Path, problem: TuneProblem, *, force: bool = False) -> WorkingFolder:
    fingerprint = prepare_spec(problem.spec, problem.folder, {}).fingerprint()
    return WorkingFolder(folder, tune_text(problem), fingerprint, force=force)


def _in_short(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)

"""Figures and reports of saved results, drawn anew."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import joblib

from dqcontrol.errors import FileFormatError, LimitWarning, NoteWarning
from dqcontrol.experiments import load_results, prepare, rank, read_spec
from dqcontrol.experiments.check import LoopCheck, loop_checks
from dqcontrol.experiments.processes import in_processes
from dqcontrol.experiments.results_folder import PARENT, SPEC_FILE, added_files
from dqcontrol.files.yaml_file import parse_yaml
from dqcontrol.reports.run_report import figures_of, write_run_report
from dqcontrol.reports.study_reports import figures_of_runs

if TYPE_CHECKING:
    from matplotlib.figure import Figure


_WORTH_PROCESSES = 3  # runs whose figures take longer than starting processes


def rewrite_reports(
    folders: Sequence[str | Path],
    *,
    jobs: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> list[Path]:
    """Write ``report.html`` and the figures of saved runs anew, in their folders.

    Parameters
    ----------
    folders
        Of runs, or of studies whose runs have folders, for all of them.
    jobs
        Processes that draw in parallel; default: as many as there are processors, or one for few runs.
    progress
        Called with the number of reports written, and of all of them.

    Returns
    -------
    The reports.

    Raises
    ------
    FileFormatError
        If a folder holds no run.
    ValueRangeError
        If a spec brings code, and that is refused.

    Examples
    --------
    >>> rewrite_reports(["results/circle"])  # doctest: +SKIP
    """
    drafts = [
        _Place(run, _root(run)) for folder in map(Path, folders) for run in load_results.run_folders(folder)
    ]
    for place in drafts:
        if not (place.run / "record.mcap").is_file():
            raise FileFormatError(load_results.why_no_run(place.run))
        read_spec(place.run / SPEC_FILE)  # says which code it brings: processes that draw say nothing
    if progress:
        progress(0, len(drafts))
    if jobs is None:
        jobs = joblib.cpu_count() if len(drafts) >= _WORTH_PROCESSES else 1
    done = map(_drawn, drafts) if jobs == 1 else in_processes(_drawn, drafts, jobs)
    written = []
    for files in done:
        written.append(files)
        if progress:
            progress(len(written), len(drafts))
    return written


class _Place(NamedTuple):
    """The folder of a run, and the folder of results that it lies in."""

    run: Path
    root: Path


def _root(run: Path) -> Path:
    """Return the folder of results that a run lies in: its own, or that of its study."""
    inside = (run.resolve().parent / SPEC_FILE).is_file()
    return run.resolve().parent if inside else run.resolve()


def _drawn(place: _Place) -> Path:
    run, outside = (
        load_results.load_run(place.run),
        PARENT if place.root == place.run.resolve() else f"{PARENT}/{PARENT}",
    )
    old = place.run / "report.html"
    if old.is_file() and '<pre class="command">' in old.read_text(encoding="utf-8"):
        run = replace(run, expected=_expected(run.spec))  # it can be run again
    with added_files(place.run.resolve(), place.root) as draft:
        write_run_report(run, draft, outside, recorded=place.run, replayed=True)
    return old


def _expected(spec: str) -> LoopCheck | None:
    data = parse_yaml("spec", spec)
    if "evaluation" in data:
        return None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LimitWarning)
        warnings.simplefilter("ignore", NoteWarning)
        return next(loop_checks(prepare(data)))


def figures_of_results(folders: Sequence[Path]) -> dict[str, Figure]:
    """Return figures by name: of one run, of several runs together, of repeats, or of a parameter study.

    Parameters
    ----------
    folders
        Of runs or studies; a study whose runs have folders of their own stands for all of them.

    Raises
    ------
    FileFormatError
        If a folder holds neither.
    """
    from dqcontrol.figures import repeats_figure, sweep_figure

    if any(map(load_results.is_sweep, folders)):
        return {"sweep": sweep_figure(rank(folders))}
    if any(map(load_results.is_study, folders)):
        return {"repeats": repeats_figure(load_results.load_rows(folders))}
    runs = load_results.load_runs(folders)
    if len(runs) == 1:
        return figures_of(next(iter(runs.values())))
    return figures_of_runs(runs)

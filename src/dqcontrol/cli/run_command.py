"""Run an experiment."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from dqcontrol.cli.options import Force, Out
from dqcontrol.cli.screen import FAILED, print_table, progress_bar

if TYPE_CHECKING:
    from dqcontrol.experiments import Study
    from dqcontrol.experiments.run import Run

RealTime = Annotated[bool, Parameter(negative=())]
Compiled = Annotated[bool, Parameter(negative=())]
Over = Literal["udp", "shared-memory"]


def run(
    spec: Path,
    /,
    *,
    out: Out = None,
    force: Force = False,
    jobs: int | None = None,
    figures: bool | None = None,
    real_time: RealTime = False,
    compiled: Compiled = False,
    over: Over | None = None,
) -> None:
    """Run an experiment and write its table, recordings and plots; rerun it to resume after an interruption.

    The first line says what came of it, the second where the results are. Exit status: 0 if every run did what was
    asked and kept what it was to keep; 1 if one did not; 2 if nothing ran, because something is wrong or out of reach.

    Parameters
    ----------
    spec
        YAML file; its keys are described in docs/experiments.md.
    out
        New folder for the results; default: results/NAME, NAME from the spec.
    force
        Replace an earlier folder of results, and discard an unfinished study of another spec or version.
    jobs
        Processes that work in parallel; default: as many as there are processors, if there is enough to do.
    figures
        Of several runs, also the figures of each one (a second each; later: dqcontrol report); --no-figures draws none.
    real_time
        One run at its control period, recorded while it moves; Ctrl-C stops softly if there is a supervisor.
    compiled
        In real time: law, supervisor and plant step in a thread of C, built now; Python only watches.
    over
        With --compiled: law and supervisor in a process, the plant in another one, which it reaches over this.
    """
    from dqcontrol.cli.kernels_beside import compile_beside
    from dqcontrol.errors import DivergedError, ShapeError
    from dqcontrol.experiments import read_spec, run_study_to
    from dqcontrol.experiments.results_folder import working_folder

    folder = out or Path("results") / read_spec(spec)[0].name
    if compiled and not real_time:
        raise ShapeError("compiled: only with --real-time; other runs are compiled anyway")
    if over and not compiled:
        raise ShapeError("over: only with --real-time --compiled")
    if real_time:
        options = {"over": over} if compiled else None
        _in_real_time(spec, folder, force=force, compiled=options, figures=figures is not False)
        return
    compile_beside()
    try:
        with progress_bar() as progress:
            study = run_study_to(
                spec,
                folder,
                force=force,
                jobs=jobs,
                figures=figures,
                progress=progress,
                computed=lambda computed: _show(computed, folder),
                drawing=lambda done, total: progress(done, total, "reports"),
            )
    except DivergedError as error:  # in the first period: there is nothing to keep
        print(error)
        sys.exit(FAILED)
    except KeyboardInterrupt:
        kept = (
            "; finished trials are kept: rerun the same command to resume" * working_folder(folder).exists()
        )
        raise KeyboardInterrupt(kept) from None
    if not study.is_good:
        sys.exit(FAILED)


def _show(study: Study, folder: Path) -> None:
    """Print what came of a study, before its figures are drawn."""
    print(study.headline)
    print(f"results: {folder}")
    print_table(study.table())
    for line in study.failures():
        print(line)
    sys.stdout.flush()


def _in_real_time(
    spec: Path, folder: Path, *, force: bool, compiled: dict[str, Any] | None, figures: bool
) -> None:
    """Run in real time, in Python or with these options ``compiled``."""
    from dqcontrol.experiments import run_in_real_time, summary
    from dqcontrol.export import run_compiled_in_real_time
    from dqcontrol.figures import timing_table

    def watch(time: float, reasons: tuple[str, ...]) -> None:
        print(f"{time:8.3f} s: {', '.join(reasons) or 'follows the law'}", file=sys.stderr)

    def show(done: Run) -> None:
        print(done.verdict.words)
        print(f"results: {folder}")
        print_table(summary({done.label: done}))
        if done.timing:
            print_table(timing_table(done.timing))
        print(f"ended: {done.record.stopped}")
        sys.stdout.flush()

    options: dict[str, Any] = {"force": force, "figures": figures, "watch": watch, "computed": show}
    if compiled is None:
        done = run_in_real_time(spec, folder, **options)
    else:
        done = run_compiled_in_real_time(spec, folder, **options, **compiled)
    if done.verdict.failure:
        sys.exit(FAILED)

"""Check, plan, run, tune, learn and export: what is done with an experiment's file."""

from __future__ import annotations

import os
import subprocess
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from dqcontrol.cli import options
from dqcontrol.cli.screen import FAILED, joint_columns, joint_values, print_found, print_table, progress_bar

if TYPE_CHECKING:
    from dqcontrol.compiled.compile import Kernel
    from dqcontrol.experiments import Run, Study
    from dqcontrol.planning import PlanTo
    from dqcontrol.tables import Table

# named here: looking at `TARGETS` would load the compiler
Target = Literal["native", "x86-64-v2", "x86-64-v3", "aarch64", "armv7", "riscv64", "cortex-m4f", "cortex-m7"]


def check(spec: Path, /) -> None:
    """Check an experiment without running it, and say how near its loops are to instability.

    Ends with 1 if a loop is expected to be unstable, or a law fails at the start.

    Parameters
    ----------
    spec
        YAML file; its keys are described in docs/experiments.md.
    """
    from dqcontrol.experiments import check as checked

    checks = checked(spec)
    print_found(checks.table(), *([checks.contact] if checks.contact else ()), words=checks.remarks())
    if checks.unstable or any(one.fails for one in checks):
        sys.exit(FAILED)


def plan(spec: Path, /) -> None:
    """Plan the way of an experiment around what stands there, and say what is proved of it.

    Parameters
    ----------
    spec
        YAML file with a reference of kind plan-to; its keys are described in docs/planning.md.
    """
    from dqcontrol.errors import NoteWarning, ShapeError
    from dqcontrol.experiments import prepare
    from dqcontrol.planning.drive_and_plan import DriveAndPlan
    from dqcontrol.planning.plan_to import PlanTo
    from dqcontrol.references import DriveThrough

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NoteWarning)  # what it says is printed below
        setting = prepare(spec)
    for label, scene in setting.scenes.items():
        whole = scene.reference
        ways = whole.ways if isinstance(whole, DriveThrough) else [whole]
        planned = [way for way in ways if isinstance(way, PlanTo | DriveAndPlan)]
        if not planned:
            kind = setting.spec.reference.__struct_config__.tag
            raise ShapeError(
                f"{spec}: reference: expected kind plan-to, got {kind}, which has nothing to plan"
            )
        for way in planned:
            print_table(_points(way.arm if isinstance(way, DriveAndPlan) else way, label or scene.robot.name))
            print(way)


def _points(way: PlanTo, title: str) -> Table:
    """Return the points of a way, one row each."""
    from dqcontrol.tables import Table

    rows = [joint_values(way.robot, q) for q in way.plan.configurations]
    return Table(joint_columns(way.robot), rows, f"{title}: {len(rows)} points")


@contextmanager
def _resumable(folder: Path, kept: str) -> Iterator[None]:
    """Say in an interruption what is kept of what was to go to a folder, if anything is."""
    from dqcontrol.experiments.results_folder import working_folder

    try:
        yield
    except KeyboardInterrupt as interrupt:
        if working_folder(folder).exists():
            interrupt.add_note(f"{kept}: rerun the same command to resume")
        raise


def run(
    spec: Path,
    /,
    *,
    out: options.Out = None,
    force: options.Force = False,
    jobs: options.Jobs = None,
    figures: bool | None = None,
    real_time: options.Switch = False,
    compiled: options.Switch = False,
    over: Literal["udp", "shared-memory"] | None = None,
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
    figures
        Of several runs, also the figures of each one (a second each; later: dqcontrol report); --no-figures draws none.
    real_time
        One run at its control period, recorded while it moves; Ctrl-C stops softly if there is a supervisor.
    compiled
        In real time: law, supervisor and plant step in a thread of C, built now; Python only watches.
    over
        With --compiled: law and supervisor in a process, the plant in another one, which it reaches over this.
    """
    from dqcontrol.errors import DivergedError, ShapeError
    from dqcontrol.experiments import read_spec, run_study_to

    folder = out or Path("results") / read_spec(spec)[0].name
    if compiled and not real_time:
        raise ShapeError("compiled: only with --real-time; other runs are compiled anyway")
    if over and not compiled:
        raise ShapeError("over: only with --real-time --compiled")
    if real_time:
        _in_real_time(
            spec, folder, {"over": over} if compiled else None, force=force, figures=figures is not False
        )
        return
    compile_beside()

    def show(study: Study) -> None:
        print(study.headline)
        print_found(study.table(), folder=folder, words=study.failures())

    try:
        with _resumable(folder, "finished trials are kept"), progress_bar() as progress:
            study = run_study_to(
                spec,
                folder,
                force=force,
                jobs=jobs,
                figures=figures,
                progress=progress,
                computed=show,
                drawing=partial(progress, label="reports"),
            )
    except DivergedError as error:  # in the first period: there is nothing to keep
        print(error)
        sys.exit(FAILED)
    if not study.is_good:
        sys.exit(FAILED)


def _in_real_time(spec: Path, folder: Path, compiled: dict[str, Any] | None, **wanted: bool) -> None:
    """Run in real time, in Python or with these further options ``compiled``."""
    from dqcontrol.experiments import run_in_real_time, summary
    from dqcontrol.export import run_compiled_in_real_time
    from dqcontrol.figures import timing_table

    def watch(time: float, reasons: tuple[str, ...]) -> None:
        print(f"{time:8.3f} s: {', '.join(reasons) or 'follows the law'}", file=sys.stderr)

    def show(done: Run) -> None:
        print(done.verdict.words)
        tables = [summary({done.label: done}), *([timing_table(done.timing)] if done.timing else ())]
        print_found(*tables, folder=folder, words=[f"ended: {done.record.stopped}"])

    run_it = run_in_real_time if compiled is None else run_compiled_in_real_time
    if run_it(spec, folder, watch=watch, computed=show, **wanted, **(compiled or {})).verdict.failure:
        sys.exit(FAILED)


def sweep(
    spec: Path,
    /,
    *,
    out: options.Out = None,
    force: options.Force = False,
    jobs: options.Jobs = None,
    scheduler: str | None = None,
    by: str = "error.integral",
) -> None:
    """Run a parameter study and list its best points; rerun it to resume after an interruption.

    The last line says how many runs failed, and why most of them; exit status as of dqcontrol run.

    Parameters
    ----------
    spec
        YAML file with the key sweep; see docs/sweeps.md.
    out
        New folder for the results; default: results/NAME, NAME from the spec.
    force
        Replace an earlier folder of results, and discard an unfinished study of another spec or version.
    scheduler
        Address of a Dask scheduler, as tcp://127.0.0.1:8786, whose workers run the trials.
    by
        Number that says which points are best, as in runs.parquet.
    """
    from dqcontrol.experiments import run_sweep_to
    from dqcontrol.experiments.sweep import read_sweep

    folder = out or Path("results") / read_sweep(spec).name
    compile_beside()
    with _resumable(folder, "finished parts are kept"), progress_bar() as progress:
        ranking = run_sweep_to(
            spec, folder, force=force, jobs=jobs, scheduler=scheduler, by=by, progress=progress
        )
    if ranking.failures:
        print(ranking.failures)
    print_found(ranking.table(), folder=folder)
    if ranking.failures:
        sys.exit(FAILED)


def gains(
    robot: str,
    /,
    *,
    period: options.Seconds,
    delay: options.Seconds = 0.0,
    lag: options.Seconds = 0.0,
    base_link: options.BaseLink = None,
    tip_link: options.TipLink = None,
) -> None:
    """Say which gains a period, a delay and a lag allow each law, what to expect of them, and why.

    Times are in seconds, or with a unit: 8ms.

    Parameters
    ----------
    robot
        Name, .yaml or .urdf file of an arm.
    period
        Control period.
    delay
        From command to joint and back.
    lag
        Time constant with which joints follow their targets.
    """
    from dqcontrol.experiments.gain_advice import advise_gains

    advice = advise_gains(robot, period, delay, lag, base_link=base_link, tip_link=tip_link)
    kinds: dict[str, list[str]] = {}
    for kind, parameters in advice.parameters.items():
        written = ", ".join(f"{key}: {value:g}" for key, value in parameters.items())
        kinds.setdefault(written, []).append(kind)
    lines = [f"{written}   # {', '.join(laws)}" for written, laws in kinds.items()]
    print_found(advice.table, words=[*lines, *advice.reasons])


def tune(
    spec: Path,
    /,
    *,
    out: options.Out = None,
    force: options.Force = False,
    jobs: options.Jobs = None,
    scheduler: str | None = None,
) -> None:
    """Find the best parameters of every law, under the same budget; rerun it to resume after an interruption.

    Writes winners.json, and best.yaml, which dqcontrol run runs.

    Parameters
    ----------
    spec
        YAML file, perhaps with the key tune; see docs/tune.md.
    out
        New folder for the results; default: results/NAME-tuned, NAME from the spec.
    force
        Replace an earlier folder of results, and discard an unfinished search of another spec or version.
    scheduler
        Address of a Dask scheduler, as tcp://127.0.0.1:8786, whose workers search.
    """
    from dqcontrol.tuning import tune_to
    from dqcontrol.tuning.spec_blocks import read_tune

    folder = out or Path("results") / f"{read_tune(spec).spec.name}-tuned"
    compile_beside()
    with _resumable(folder, "what was evaluated is kept"), progress_bar() as progress:
        tune_to(
            spec,
            folder,
            force=force,
            jobs=jobs,
            scheduler=scheduler,
            progress=partial(progress, label="laws"),
            computed=lambda found: print_found(found.table(), folder=folder, words=found.remarks()),
        )


def learn(
    spec: Path,
    /,
    *ros_arguments: options.RosArguments,
    repeats: int | None = None,
    out: options.Out = None,
    force: options.ReplaceResults = False,
    real_time: options.Switch = False,
    ros2: Literal["velocity", "position", "trajectory"] | None = None,
    network: options.Switch = False,
) -> None:
    """Repeat a motion and learn from each repeat; writes learnt.yaml, which dqcontrol run runs, and its learnt.csv.

    Parameters
    ----------
    spec
        YAML file of one run, perhaps with the key learn; see docs/learn.md.
    repeats
        Most repeats after the first run.
    out
        New folder for the results; default: results/NAME-learnt, NAME from the spec.
    real_time
        Each run on the clock.
    ros2
        Repeat on the robot behind ROS 2 topics, with such commands; see docs/learn.md.
    network
        With --ros2: do not keep to the loopback.
    """
    from dqcontrol.errors import ValueRangeError
    from dqcontrol.tuning import learn_to
    from dqcontrol.tuning.spec_blocks import read_learn

    folder = out or Path("results") / f"{read_learn(spec).spec.name}-learnt"
    runner = None
    if ros2 is not None:
        from dqcontrol.ros2 import middleware

        middleware.check_installed()
        from dqcontrol.ros2.repeated_motion import RobotBehindTopics

        repeated = folder.with_name(f"{folder.name}-repeats")
        runner = RobotBehindTopics(repeated, ros2, network=network, ros_arguments=ros_arguments)
    elif network or ros_arguments:
        what = "--network" if network else ros_arguments[0]
        raise ValueRangeError(
            f"{what}: is for a robot behind topics; give --ros2 velocity, too, or leave it out"
        )
    with progress_bar() as progress:
        learn_to(
            spec,
            folder,
            repeats,
            force=force,
            real_time=real_time,
            runner=runner,
            progress=partial(progress, label="repeats"),
            computed=lambda found: print_found(found.table(), folder=folder, words=found.remarks()),
        )


def export(
    spec: Path,
    /,
    *,
    law: str | None = None,
    target: Target = "native",
    out: Annotated[Path, Parameter(name=["--out", "-o"])],
    force: options.Force = False,
) -> None:
    """Write the controller of a spec as a library in C, with its tests.

    Parameters
    ----------
    spec
        YAML file of a controller.
    law
        Of a spec with several laws: label of the one to export.
    target
        Processor; native is this one.
    out
        New folder for the library.
    force
        Replace an earlier folder.
    """
    from dqcontrol.errors import ShapeError
    from dqcontrol.export import export_controller

    if spec.is_dir():
        raise ShapeError(
            f"{spec}: is a folder; a controller is exported from its spec, {spec / 'spec.yaml'}; "
            f"the signals of a run: dqcontrol convert {spec} log.csv"
        )
    done = export_controller(spec, out, law=law, target=target, force=force)
    print(f"results: {done.folder} (try: make -C {done.folder} test)")
    print(
        f"{done.target}: {done.code / 1024:.0f} kB of code, {done.constants / 1024:.0f} kB of constants, "
        f"{done.controller / 1024:.1f} kB a controller; law {done.law_hash}"
    )


def compile_beside() -> None:
    """Compile what every run needs in a second process, while this one compiles its law's; nobody waits for it.

    Only where these kernels are new and kept, and a processor is left.
    """
    from dqcontrol.compiled import kernel_cache
    from dqcontrol.compiled.compile import IS_PLAIN

    if (
        IS_PLAIN  # kernels are kept by Numba's internals alone
        or kernel_cache.root() is None
        or (os.cpu_count() or 1) < 2
        or kernel_cache.is_kept(_kernels_of_every_run()[2].function)
    ):
        return
    command = [sys.executable, "-P", "-m", __name__]  # -P: no module of the folder that it runs in
    nothing = subprocess.DEVNULL
    subprocess.Popen(command, stdin=nothing, stdout=nothing, stderr=nothing)


def _kernels_of_every_run() -> tuple[Kernel, ...]:
    """Return half of what a first run compiles, in its order."""
    from dqcontrol.loop.record import pose_errors
    from dqcontrol.loop.rollout import rollout
    from dqcontrol.measures.run_numbers import measure_kernel
    from dqcontrol.robots.inverse.inverse_kernels import solve

    return solve, rollout, measure_kernel, pose_errors


if __name__ == "__main__":
    for each in _kernels_of_every_run():
        _ = each.compiled

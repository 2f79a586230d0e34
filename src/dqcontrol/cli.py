"""The command line: thin calls into the library, and errors in one line."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import App, CycloptsError, Parameter
from rich.console import Console

import dqcontrol
from dqcontrol.errors import Error

UNSTABLE, USER_ERROR = 1, 2

app = App(
    name="dqcontrol",
    help="Drive arms along desired poses with dual quaternion control laws: simulate, measure, compare.",
    version=dqcontrol.__version__,
    help_format="plaintext",
    suppress_keyboard_interrupt=False,
)
robots = App(name="robots", help="List the robots that come with dqcontrol, or show one.")
app.command(robots)

Out = Annotated[Path | None, Parameter(name=["--out", "-o"], help="New folder for the results.")]
Force = Annotated[bool, Parameter(negative=(), help="Replace an earlier folder of results.")]


@app.command
def run(spec: Path, /, *, out: Out = None, force: Force = False, jobs: int | None = None) -> None:
    """Run an experiment and write its table, recordings and plots; interrupted, the same command goes on.

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
    """
    from dqcontrol.experiments import read_spec, run_study_to
    from dqcontrol.experiments.conduct import working_folder

    folder = out or Path("results") / read_spec(spec)[0].name
    try:
        with _progress() as progress:
            study = run_study_to(spec, folder, force=force, jobs=jobs, progress=progress)
    except KeyboardInterrupt:
        kept = "; finished trials are kept, the same command goes on" * working_folder(folder).exists()
        raise KeyboardInterrupt(kept) from None
    _wide_console().print(study.table().rich())
    for line in study.failures():
        print(line)
    print(f"results: {folder}")


@app.command
def check(spec: Path, /) -> None:
    """Check an experiment without running it, and say how near its loops are to instability.

    Ends with 1 if a loop is expected to be unstable.

    Parameters
    ----------
    spec
        YAML file; its keys are described in docs/experiments.md.
    """
    from dqcontrol.experiments import check as checked

    checks = checked(spec)
    _wide_console().print(checks.table().rich())
    for remark in checks.remarks():
        print(remark)
    if checks.unstable:
        sys.exit(UNSTABLE)


@app.command
def compare(*folders: Path, out: Out = None, force: Force = False) -> None:
    """Compare saved runs: one table, and plots if --out is given; of studies with repeats, a table of means.

    Parameters
    ----------
    folders
        Folders of runs, or of studies for all their runs.
    out
        New folder for table and plots.
    force
        Replace an earlier folder of results.
    """
    from dqcontrol.experiments import load_rows, load_runs, means_table, summary
    from dqcontrol.experiments.comparison import MEANS, write_comparison
    from dqcontrol.experiments.output import MARK, new_folder
    from dqcontrol.experiments.saved import is_study

    if not folders:
        raise Error("compare: give at least one folder of a run")
    if any(map(is_study, folders)):
        runs, table = {}, means_table(load_rows(folders), MEANS, "comparison")
    else:
        runs = load_runs(folders)
        table = summary(runs, "comparison")
    if out is not None:
        with new_folder(out, force=force) as new:
            (new / MARK).write_text("".join(f"# {folder}\n" for folder in folders), encoding="utf-8")
            write_comparison(table, {label: run.record for label, run in runs.items()}, new)
    _wide_console().print(table.rich())
    if out is not None:
        print(f"results: {out}")


@app.command
def evaluate(
    log: Path,
    /,
    *,
    robot: str | None = None,
    base_link: str | None = None,
    tip_link: str | None = None,
    reference: Path | None = None,
    reference_topic: str | None = None,
    joints: str | None = None,
    joint_topic: str | None = None,
    command_topic: str | None = None,
    angles: Literal["rad", "deg"] | None = None,
    start: float = 0.0,
    duration: float | None = None,
    settle: float | None = None,
    out: Out = None,
    force: Force = False,
) -> None:
    """Measure your own joint log against a reference: table, and plots and report if --out is given.

    Parameters
    ----------
    log
        Table (CSV), MCAP file, ROS 1 or ROS 2 bag, or folder of a run; see docs/own-data.md.
    robot
        Name, .yaml or .urdf file, or example-robot-data:PATH; recordings of dqcontrol name theirs.
    base_link
        Start of the chain in a URDF file.
    tip_link
        End of the chain in a URDF file.
    reference
        YAML file with a reference, points file, or a second log; recordings of dqcontrol hold their own.
    reference_topic
        Topic of PoseStamped with the desired poses, in --reference or else in the log.
    joints
        Names of the robot's joints in the log, if it has others: a,b,c in the robot's order.
    joint_topic
        Topic of JointState with the positions.
    command_topic
        Topic of JointState or Float64MultiArray with the commanded velocities.
    angles
        Unit of columns of a table that do not name theirs.
    start
        When the reference begins, s after the log's first sample.
    duration
        How many seconds from there on are judged.
    settle
        Length of the start that the settled errors leave out, s.
    out
        New folder for record, metrics, plots and report.
    force
        Replace an earlier folder of results.
    """
    from dqcontrol.experiments import summary_table
    from dqcontrol.experiments.evaluation import evaluate_log
    from dqcontrol.experiments.output import check_new

    if out is not None:
        check_new(out, force=force)
    result = evaluate_log(
        log,
        robot,
        reference,
        base_link=base_link,
        tip_link=tip_link,
        reference_topic=reference_topic,
        joints=[name.strip() for name in joints.split(",")] if joints is not None else None,
        joint_topic=joint_topic,
        command_topic=command_topic,
        angles=angles,
        start=start,
        duration=duration,
        settle=settle,
    )
    if out is not None:
        result.save(out, force=force)
    _wide_console().print(summary_table(result.metrics, result.label).rich())
    if out is not None:
        print(f"results: {out}")


@app.command
def export(run: Path, path: Path, /, *, force: Force = False) -> None:
    """Write all signals of a run for other programs.

    Parameters
    ----------
    run
        Folder of a run.
    path
        New file; its suffix chooses the format: .csv, .parquet or .mat.
    force
        Replace an existing file.
    """
    from dqcontrol.experiments import load_run

    print(f"results: {load_run(run).export(path, force=force)}")


@app.command
def reproduce(
    name: str | None = None,
    /,
    *,
    plant: str | None = None,
    out: Out = None,
    force: Force = False,
    jobs: int | None = None,
    samples: int | None = None,
) -> None:
    """Run published experiments again: tables beside the printed ones, and verdicts on what was claimed.

    Parameters
    ----------
    name
        As pereira2016/spiral, or pereira2016 for all; without it the experiments are listed.
    plant
        What the Meka is: servo, or meka-physics, its compliant joints in MuJoCo; default: servo.
    out
        New folder for the results; default: results/NAME, or results/NAME-PLANT for another plant than the default.
    force
        Replace earlier folders of results.
    jobs
        Processes that work in parallel; default: as many as there are processors, if there is enough to do.
    samples
        Of each real-time run of sampling-time; default: 500.
    """
    from dqcontrol.experiments import published
    from dqcontrol.experiments.output import check_new

    if name is None:
        _wide_console().print(published.catalogue_table().rich())
        return
    names, plant = published.names(name), plant or published.PLANT
    top = out or Path("results") / (name if plant == published.PLANT else f"{name}-{plant}")
    folders = {each: top / each if len(names) > 1 else top for each in names}
    for folder in folders.values():
        check_new(folder, force=force)
    for each, folder in folders.items():
        with _progress() as progress:
            done = published.reproduce(
                each,
                plant=plant,
                jobs=jobs,
                samples=published.SAMPLES if samples is None else samples,
                progress=lambda label, count, total, show=progress: show(count, total, label),
            )
        done.save(folder, force=force)
        for table in done.tables:
            _wide_console().print(table.rich())
        print(f"results: {folder}")


@robots.default
def list_robots() -> None:
    """List the robots that come with dqcontrol."""
    from dqcontrol.experiments.tables import Column, Table
    from dqcontrol.robots import describe, load_robot, robot_names

    rows = []
    for name in robot_names():
        about = describe(load_robot(name))
        rows.append([name, about.name, about.bases or None, len(about.joints), about.reach, about.mass])
    columns = (
        Column("name"),
        Column("robot"),
        Column("base"),
        Column("coordinates"),
        Column("reach", "m"),
        Column("moving mass", "kg"),
    )
    _wide_console().print(Table(columns, rows).rich())


@robots.command
def show(
    source: str,
    /,
    *,
    base_link: Annotated[str | None, Parameter(help="Start of the chain in a URDF file.")] = None,
    tip_link: Annotated[str | None, Parameter(help="End of the chain in a URDF file.")] = None,
) -> None:
    """Show a robot's joints and limits.

    Parameters
    ----------
    source
        Name, .yaml or .urdf file, or example-robot-data:PATH.
    """
    from dqcontrol.experiments.tables import Column, Table
    from dqcontrol.robots import describe, load_robot

    about = describe(load_robot(source, base_link, tip_link))
    rows = [[j.name, j.type, j.lower, j.upper, j.velocity, j.effort, j.input or None] for j in about.joints]
    columns = (
        Column("joint"),
        Column("type"),
        Column("lower", "° or m"),
        Column("upper", "° or m"),
        Column("velocity", "°/s or m/s"),
        Column("effort", "N·m or N"),
        Column("input"),
    )
    if not about.bases:  # an arm's inputs are its joints
        rows, columns = [row[:-1] for row in rows], columns[:-1]
    base = f"{about.bases} base, " if about.bases else ""
    mass = f", moving mass {about.mass:.3g} kg" if about.mass is not None else ", no inertia"
    _wide_console().print(Table(columns, rows, f"{about.name}: {base}reach {about.reach:.3g} m{mass}").rich())


def main() -> None:
    """Run the command line; a user's mistake gives one line and exit code 2."""
    warnings.showwarning = _show_warning
    try:
        app(sys.argv[1:], exit_on_error=False, print_error=False, result_action="return_value")
    except (Error, CycloptsError) as error:
        print(f"dqcontrol: {' '.join(str(error).split())}", file=sys.stderr)
        sys.exit(USER_ERROR)
    except KeyboardInterrupt as interrupt:
        print(f"dqcontrol: interrupted{interrupt}", file=sys.stderr)
        sys.exit(130)
    except BrokenPipeError:
        sys.exit(0)
    except OSError as error:  # a full disk, a folder that went away
        print(f"dqcontrol: {error}", file=sys.stderr)
        sys.exit(USER_ERROR)


def _show_warning(message: Warning | str, *_: object, **__: object) -> None:
    print(f"dqcontrol: warning: {' '.join(str(message).split())}", file=sys.stderr)


def _wide_console() -> Console:
    """Return a console that does not squeeze tables when nobody watches."""
    return Console() if sys.stdout.isatty() else Console(width=200)


@contextmanager
def _progress() -> Iterator[Callable[..., None]]:
    """Give what shows a bar for each label on standard error, once there is one."""
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn, TimeRemainingColumn

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(elapsed_when_finished=True),
    )
    bar = Progress(*columns, console=Console(stderr=True))
    tasks: dict[str, TaskID] = {}

    def report(done: float, total: int, label: str = "trials") -> None:
        if not tasks:
            bar.start()  # only now: an error before the first trial prints nothing else
        if label not in tasks:
            if done >= 1:
                print(f"dqcontrol: goes on; {done:g} of {total} trials were finished before", file=sys.stderr)
            tasks[label] = bar.add_task(label, total=total)
        bar.update(tasks[label], completed=done)

    try:
        yield report
    finally:
        if tasks:
            bar.stop()

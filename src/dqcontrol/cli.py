"""The command line: thin calls into the library, and errors in one line."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

from cyclopts import App, CycloptsError, Parameter
from rich.console import Console

import dqcontrol
from dqcontrol.errors import Error

USER_ERROR = 2

app = App(
    name="dqcontrol",
    help="Drive arms along desired poses with dual quaternion control laws: simulate, measure, compare.",
    version=dqcontrol.__version__,
    help_format="plaintext",
)
robots = App(name="robots", help="List the robots that come with dqcontrol, or show one.")
app.command(robots)

Out = Annotated[Path | None, Parameter(name=["--out", "-o"], help="New folder for the results.")]
Force = Annotated[bool, Parameter(negative=(), help="Replace an earlier folder of results.")]


@app.command
def run(spec: Path, /, *, out: Out = None, force: Force = False) -> None:
    """Run an experiment and write its table, recordings and plots.

    Parameters
    ----------
    spec
        YAML file; its keys are described in docs/experiments.md.
    out
        New folder for the results; default: results/NAME, NAME from the spec.
    force
        Replace an earlier folder of results.
    """
    from dqcontrol.experiments import read_spec, run_study
    from dqcontrol.experiments.output import check_new

    folder = out or Path("results") / read_spec(spec)[0].name
    check_new(folder, force=force)
    with _progress() as progress:
        study = run_study(spec, progress=progress)
    single = len(study.runs) == 1
    (next(iter(study.runs.values())) if single else study).save(folder, force=force)
    _wide_console().print(study.table().rich())
    print(f"results: {folder}")


@app.command
def compare(*folders: Path, out: Out = None, force: Force = False) -> None:
    """Compare saved runs: one table, and plots if --out is given.

    Parameters
    ----------
    folders
        Folders of runs, or of studies for all their runs.
    out
        New folder for table and plots.
    force
        Replace an earlier folder of results.
    """
    from dqcontrol.experiments import load_runs, summary
    from dqcontrol.experiments.output import MARK, new_folder
    from dqcontrol.experiments.study import write_comparison

    if not folders:
        raise Error("compare: give at least one folder of a run")
    runs = load_runs(list(folders))
    if out is not None:
        with new_folder(out, force=force) as new:
            (new / MARK).write_text("".join(f"# {folder}\n" for folder in folders), encoding="utf-8")
            write_comparison(runs, new, "comparison")
    _wide_console().print(summary(runs, "comparison").rich())
    if out is not None:
        print(f"results: {out}")


@robots.default
def list_robots() -> None:
    """List the robots that come with dqcontrol."""
    from dqcontrol.experiments.tables import Column, Table
    from dqcontrol.robots import describe, load_robot, robot_names

    rows = []
    for name in robot_names():
        about = describe(load_robot(name))
        rows.append([name, about.name, len(about.joints), about.reach, about.mass])
    columns = (Column("name"), Column("robot"), Column("joints"), Column("reach", "m"), Column("moving mass", "kg"))
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
    rows = [[j.name, j.type, j.lower, j.upper, j.velocity, j.effort] for j in about.joints]
    columns = (
        Column("joint"),
        Column("type"),
        Column("lower", "° or m"),
        Column("upper", "° or m"),
        Column("velocity", "°/s or m/s"),
        Column("effort", "N·m or N"),
    )
    mass = f", moving mass {about.mass:.3g} kg" if about.mass is not None else ", no inertia"
    _wide_console().print(Table(columns, rows, f"{about.name}: reach {about.reach:.3g} m{mass}").rich())


def main() -> None:
    """Run the command line; a user's mistake gives one line and exit code 2."""
    try:
        app(exit_on_error=False, print_error=False, result_action="return_value")
    except (Error, CycloptsError) as error:
        print(f"dqcontrol: {' '.join(str(error).split())}", file=sys.stderr)
        sys.exit(USER_ERROR)
    except KeyboardInterrupt:
        print("dqcontrol: interrupted", file=sys.stderr)
        sys.exit(130)
    except BrokenPipeError:
        sys.exit(0)


def _wide_console() -> Console:
    """Return a console that does not squeeze tables when nobody watches."""
    return Console() if sys.stdout.isatty() else Console(width=200)


@contextmanager
def _progress() -> Iterator[object]:
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=False) as bar:
        tasks: dict[str, int] = {}

        def report(label: str, done: int, total: int) -> None:
            if label not in tasks:
                tasks[label] = bar.add_task(label, total=total)
            bar.update(tasks[label], completed=done)

        yield report

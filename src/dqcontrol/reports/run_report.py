"""The figures of a run, and its report."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dqcontrol.errors import MissingExtraError
from dqcontrol.experiments.result_pages import replay
from dqcontrol.experiments.results_folder import PARENT, SPEC_FILE
from dqcontrol.experiments.run import Run, units_of
from dqcontrol.experiments.run_comparison import unit_of_way
from dqcontrol.files.yaml_file import parse_yaml
from dqcontrol.loop.record import has_failed
from dqcontrol.measures.lyapunov import Certificate
from dqcontrol.measures.metric_tables import metrics_tables
from dqcontrol.reports.about import about_run
from dqcontrol.reports.provenance import RERUN_FOLDER, command, evaluation_command, origins
from dqcontrol.reports.run_verdicts import interventions_tables, run_verdicts

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MOST_BYTES = 3_000_000  # of a replay in a report: what mail and browsers take without a wait


def figures_of(run: Run) -> dict[str, Figure]:
    """Return all figures of a run by name, as wide as `dqcontrol.figures.column_width` says.

    Examples
    --------
    >>> figures_of(dqc.run("examples/circle.yaml"))["errors"].savefig("errors.pdf")  # doctest: +SKIP
    """
    return _figures(run, Certificate.recorded(run.record))


def write_run_report(
    run: Run,
    folder: Path,
    outside: str = PARENT,
    *,
    figures: bool = True,
    recorded: Path | None = None,
    replayed: bool = False,
) -> None:
    """Write ``report.html``, unless told otherwise with the figures of a run, into an existing folder.

    ``outside`` leads from there out of all results; ``recorded`` is the folder of its recording, if that is another.
    ``replayed`` lets the run move on the page, where viser is installed and 3 MB suffice.
    """
    from dqcontrol.figures import robot_picture, timing_table
    from dqcontrol.reports import write_report

    data: dict[str, Any] = parse_yaml("spec", run.spec)
    certificate, stopped = Certificate.recorded(run.record), run.record.stopped
    drawn = _figures(run, certificate) if figures else {}
    tables = [*metrics_tables(run.metrics, unit_of_way([run.robot])), *interventions_tables(run.record)]
    if run.timing and len(run.timing.begin) > 1:
        tables.append(timing_table(run.timing))
    write_report(
        folder,
        _title(run, data, alone=outside == PARENT),
        facts=f"{run.label} · {run.record.duration:.4g} s · {len(run.record)} samples · ended: {stopped}",
        about=about_run(run, folder if (folder / "record.mcap").is_file() else recorded or folder),
        picture=robot_picture(run.robot, run.record) if figures else None,
        moving=_moving(run) if replayed else "",
        notice=f"The run {stopped}" if has_failed(stopped) else "",
        command=_command(run, data, outside),
        verdicts=[run_verdicts(run, certificate)],
        tables=tables,
        figures=drawn,
        later="" if figures else command("report", "."),
        spec=run.spec,
        origins=origins(data),
    )


def _moving(run: Run) -> str:
    """Return a page that plays the run; empty if that cannot be, or takes too much to send."""
    with suppress(MissingExtraError):
        page = replay({run.label: run})
        if len(page.encode()) <= _MOST_BYTES:
            return page
    return ""


def _title(run: Run, data: dict[str, Any], *, alone: bool) -> str:
    """Return the name of what was run; of one of several runs also which it is."""
    name = data.get("name", run.label)
    return name if alone else f"{name}: {run.label}"


def _figures(run: Run, certificate: Certificate | None) -> dict[str, Figure]:
    from dqcontrol.figures import run_figures

    units = units_of(run.robot)
    draw = run_figures(
        run.record,
        run.robot.limits,
        **units,
        robot=run.robot,
        timing=run.timing,
        certificate=certificate,
        constraints=run.surroundings,
    )
    return {name: each() for name, each in draw.items()}


def _command(run: Run, data: dict[str, Any], outside: str) -> str:
    """Return the line that gives the run again; none of one that somebody's end effector or another process drove."""
    if "evaluation" in data:
        return evaluation_command(data["evaluation"])
    if run.expected is None:
        return ""
    return command("run", SPEC_FILE, real_time=run.timing is not None, out=f"{outside}/{RERUN_FOLDER}")

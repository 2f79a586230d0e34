"""The figures of a run, and its report."""

from __future__ import annotations

import io
import math
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dqcontrol.errors import MissingExtraError
from dqcontrol.experiments.check import LoopCheck, judged
from dqcontrol.experiments.result_pages import replay
from dqcontrol.experiments.results_folder import PARENT, SPEC_FILE
from dqcontrol.experiments.run import Run
from dqcontrol.experiments.run_comparison import unit_of_way
from dqcontrol.files.yaml_file import parse_yaml
from dqcontrol.loop import Record, Timing, has_failed
from dqcontrol.loop.signals import DISTANCE, ROOM, SLACK
from dqcontrol.measures.held import deadlocks, plans_of_run
from dqcontrol.measures.lyapunov import Certificate
from dqcontrol.measures.metric_tables import metrics_tables
from dqcontrol.measures.metrics import UNSEEN
from dqcontrol.measures.task_range import RANGE, TaskRange
from dqcontrol.measures.task_result import TaskResult
from dqcontrol.plants.mujoco.gripper import GRIP_FORCE
from dqcontrol.plants.plant import command_mode
from dqcontrol.reports.about import RERUN_FOLDER, about_run, command, evaluation_command, origins
from dqcontrol.reports.report import write_report
from dqcontrol.supervisor import list_interventions
from dqcontrol.supervisor.interventions import INTERVENTIONS
from dqcontrol.tables.number_texts import angle_text, length_text, number_text, percent_text
from dqcontrol.tables.tables import Cell, Column, Table, VerdictCell

if TYPE_CHECKING:
    from matplotlib.figure import Figure


_ROUND_OFF = 1e-9  # as a share of a velocity limit
_STUCK = 0.9  # share of the twist asked for, in the measure of the law's inverse, that the robot cannot give
_CROSSED = 1e-9  # m or rad
_CLOSING = 0.1  # s in which end effectors close on what they carry
_ENDED = 0.1  # s before the end of a run
_RISE = 1e-3  # of V in a sample, as a share of its first value

Row = list[Cell]


def run_verdicts(run: Run, certificate: Certificate | None) -> Table:
    """Return one row a question: the verdict, and the number that decides it.

    Parameters
    ----------
    run
        The run.
    certificate
        Of its Lyapunov function; None where there is none.
    """
    rows = [
        *_end(run),
        *_task(run.task, gave_way=not run.verdict.failure),
        *_joint_limits(run),
        *_velocity_limits(run),
        *_plans(run.record),
        *_kept(run.record),
        *_held_box(run.record),
        *_interventions(run.record),
        *_range(run),
        *_periods(run.timing),
    ]
    if certificate is not None:
        rows.append(_lyapunov(certificate))
    if run.expected is not None:
        rows.append(_loop_gains(run.expected))
    return Table([Column("Question"), Column("Verdict"), Column("Number")], rows)


def interventions_tables(record: Record) -> list[Table]:
    """Return when a supervisor intervened, and why, as one table; none where it never did, or there is none."""
    if INTERVENTIONS not in record.readings:
        return []
    found = list_interventions(record.time, record.readings[INTERVENTIONS].values)
    columns = [Column("from", "s", ".3f"), Column("to", "s", ".3f"), Column("reason")]
    table = Table(columns, [list(row) for row in found], "Interventions of the supervisor")
    return [table] if found else []


def _end(run: Run) -> Iterator[Row]:
    failure = run.verdict.failure
    words = "failed" if failure == "ended" else "fell short" if failure else "succeeded"
    yield ["End", VerdictCell(words, not failure), f"{run.record.stopped}; {run.record.duration:.4g} s"]


def _task(task: TaskResult, *, gave_way: bool) -> Iterator[Row]:
    """Yield how the task ended; one that was left only for what is to be kept did not fail."""
    if task.error:
        allowed = [length_text(task.position_tolerance)] * math.isfinite(task.position)
        allowed += [angle_text(task.orientation_tolerance)] * math.isfinite(task.orientation)
        good = "reached" if task.at_rest else "followed"
        verdict = VerdictCell(task.outcome, task.succeeded)
        if gave_way and not task.succeeded:
            verdict = VerdictCell("gave way to constraints", None)
        yield ["Task", verdict, f"{task.error}; counts as {good} up to {', '.join(allowed)}"]


def _joint_limits(run: Run) -> Iterator[Row]:
    margin, joint = run.metrics.limit_margin, run.metrics.limit_joint
    if joint:
        unit = "rad" if run.robot.joint_types[run.record.joint_names.index(joint)] == "revolute" else "m"
        where = f"{joint}: {abs(margin):.3g} {unit} {'left' if margin >= 0 else 'beyond'}"
        yield ["Joint limits", VerdictCell.of(margin >= -UNSEEN, "kept", "exceeded"), where]


def _velocity_limits(run: Run) -> Iterator[Row]:
    shares = np.abs(run.record.command) / run.robot.limits.velocity
    if not np.isfinite(shares).all() or not shares.any():  # no commands, no limits, or a diverged run
        return
    joint = int(shares.max(axis=0).argmax())
    if run.plant is not None and command_mode(run.plant) == "measured":
        return  # an offset of the target, which also carries gravity: no velocity
    kept = bool(shares.max() <= 1 + _ROUND_OFF)
    words = f"{run.record.input_names[joint]}: commands up to {percent_text(shares.max(), 3)} of its limit"
    if at_limits := float(np.mean(shares[:-1].max(axis=1) >= 1 - _ROUND_OFF)):
        words += f", there or beyond in {percent_text(at_limits)} of the samples"
    yield ["Velocity limits", VerdictCell.of(kept, "kept", "exceeded"), words]


def _kept(record: Record) -> Iterator[Row]:
    """Yield whether constraints were crossed, what gave way, and what held the end effector."""
    if ROOM not in record.readings:
        return
    room, distance = record.readings[ROOM], record.readings[DISTANCE]
    least = np.nanmin(room.values, axis=0)
    i = int(np.argmin(least))
    at = int(np.nanargmin(room.values[:, i]))
    crossed = [name for name, value in zip(room.parts, least, strict=True) if value < -_CROSSED]
    near, asked = distance.values[at, i], distance.values[at, i] - room.values[at, i]
    if room.units[i] == "m":
        words = f"{room.parts[i]}: least distance {1e3 * near:.4g} mm, asked {1e3 * asked:.4g}"
    else:
        words = f"{room.parts[i]}: least room of the angle {math.degrees(near):.3g}°"
    if crossed:
        words += f"; crossed: {', '.join(crossed)}"
    yield ["Constraints", VerdictCell.of(not crossed, "no constraint crossed", "crossed"), words]
    slack = record.readings[SLACK]
    if gave := [slack.parts[k] for k in np.flatnonzero((slack.values > 0).any(axis=0))]:
        yield ["Rows that gave way", VerdictCell("some", None), ", ".join(gave)]
    if found := deadlocks(record):
        longest = max(found, key=lambda each: each.end - each.begin)
        words = f"{longest.begin:.2f} … {longest.end:.2f} s by {', '.join(longest.names)}"
        lasts = found[-1].end >= record.time[-1] - _ENDED
        yield ["Deadlock", VerdictCell("held" if lasts else "left", None), words]


def _plans(record: Record) -> Iterator[Row]:
    """Yield each plan: what is proved of its way, and why there was another."""
    for made in plans_of_run(record):
        words = f"{made.cause}; {made.proof}" if made.cause else made.proof
        yield ["Plan", VerdictCell("made again" if made.cause else "made", None), words]


def _held_box(record: Record) -> Iterator[Row]:
    """Yield whether both end effectors pressed a box since they closed, and their least internal force."""
    if GRIP_FORCE not in record.readings:
        return
    internal = record.readings[GRIP_FORCE].values.min(axis=1)
    closed = int(np.argmax((internal > 0) & (record.time >= _CLOSING)))
    least = float(internal[closed:].min())
    words = f"internal force {least:.3g} N at least, after {record.time[closed]:.2g} s"
    yield ["Box", VerdictCell.of(least > 0, "held", "let go"), words]


def _interventions(record: Record) -> Iterator[Row]:
    if INTERVENTIONS not in record.readings:
        return
    found = list_interventions(record.time, record.readings[INTERVENTIONS].values)
    if not found:
        yield ["Supervisor", VerdictCell("never intervened", True), ""]
        return
    times = "once" if len(found) == 1 else f"{len(found)} times"
    words = f"{times}, first at {found[0][0]:.3f} s: {found[0][2]}"
    yield ["Supervisor", VerdictCell("intervened", None), words]


def _range(run: Run) -> Iterator[Row]:
    if RANGE not in run.record.readings:
        return
    last = float(TaskRange.recorded(run.record).share[-1])
    stuck = last > _STUCK and not run.task.succeeded
    words = f"{percent_text(last)} of the twist asked for at the end lies outside the range of J"
    yield ["Range of J", VerdictCell.of(not stuck, "not stuck", "stuck"), words]


def _periods(timing: Timing | None) -> Iterator[Row]:
    if timing is not None:
        words = f"{timing.missed} of {len(timing.begin)} missed, {timing.overruns} began late"
        yield ["Control periods", VerdictCell.of(not timing.missed, "kept", "missed"), words]


def _lyapunov(certificate: Certificate) -> Row:
    rise = certificate.largest_rise
    words = f"largest rise {rise:.2g} of its first value"
    return ["Lyapunov function V", VerdictCell.of(rise < _RISE, "falls", "rises"), words]


def _loop_gains(found: LoopCheck) -> Row:
    words = found.unknown
    if found.loops:
        worst = found.worst
        words = (
            f"{worst.gain.loop}: k = {number_text(abs(worst.gain.value))} 1/s, limit "
            f"{number_text(worst.limits.stable / found.period)} 1/s, overshoot {percent_text(found.overshoot)}"
        )
    return ["Loop gains", judged(found), words]


_MOST_BYTES = 3_000_000  # of a replay in a report: what mail and browsers take without a wait


def figures_of(run: Run) -> dict[str, Figure]:
    """Return all figures of a run by name, as wide as `dqcontrol.figures.column_width` says.

    Examples
    --------
    >>> figures_of(dqc.run("examples/circle.yaml"))["errors"].savefig("errors.pdf")  # doctest: +SKIP
    """
    from dqcontrol.figures import run_figures

    return {name: draw() for name, draw in run_figures(run).items()}


def path_picture(record: Record) -> bytes:
    """Return the path of the end effector as a PNG file."""
    from dqcontrol.figures.paths import path_3d

    picture = io.BytesIO()
    path_3d(record).savefig(picture, format="png", dpi=100)
    return picture.getvalue()


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

    data: dict[str, Any] = parse_yaml("spec", run.spec)
    certificate, stopped = Certificate.recorded(run.record), run.record.stopped
    tables = [*metrics_tables(run.metrics, unit_of_way([run.robot])), *interventions_tables(run.record)]
    if run.timing and len(run.timing.begin) > 1:
        tables.append(timing_table(run.timing))
    write_report(
        folder,
        # Of one of several runs the name says also which it is.
        data.get("name", run.label) + ("" if outside == PARENT else f": {run.label}"),
        facts=f"{run.label} · {run.record.duration:.4g} s · {len(run.record)} samples · ended: {stopped}",
        about=about_run(run, folder if (folder / "record.mcap").is_file() else recorded or folder),
        picture=robot_picture(run.robot, run.record) if figures else None,
        moving=_moving(run) if replayed else "",
        notice=f"The run {stopped}" if has_failed(stopped) else "",
        command=_command(run, data, outside),
        verdicts=[run_verdicts(run, certificate)],
        tables=tables,
        figures=figures_of(run) if figures else {},
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


def _command(run: Run, data: dict[str, Any], outside: str) -> str:
    """Return the line that gives the run again; none of one that somebody's end effector or another process drove."""
    if "evaluation" in data:
        return evaluation_command(data["evaluation"])
    if run.expected is None:
        return ""
    return command("run", SPEC_FILE, real_time=run.timing is not None, out=f"{outside}/{RERUN_FOLDER}")

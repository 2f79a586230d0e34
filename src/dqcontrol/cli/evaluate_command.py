"""Measure a user's own log."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from dqcontrol.cli.options import DEFAULT_LOG_OPTIONS, SECONDS, Force, LogOptions, Out, Seconds, in_unit
from dqcontrol.cli.screen import FAILED, print_table


def evaluate(
    log: Path,
    /,
    *,
    robot: str | None = None,
    options: LogOptions = DEFAULT_LOG_OPTIONS,
    reference: Path | None = None,
    reference_topic: str | None = None,
    reference_joints: str | None = None,
    missing: Literal["interpolate", "skip"] = "interpolate",
    start_time: Seconds = 0.0,
    align: Annotated[bool, Parameter(negative=())] = False,
    duration: Annotated[float | None, SECONDS] = None,
    skip_initial: Annotated[float | None, SECONDS] = None,
    low_pass: Annotated[float | None, in_unit("Hz", "10Hz")] = None,
    out: Out = None,
    force: Force = False,
) -> None:
    """Measure your own joint log against a reference: table, and plots and report if --out is given.

    It begins with the verdict. Exit status: 0 if the end effector did what was asked, 1 if it did not, 2 if nothing was
    measured, because something is wrong.

    Parameters
    ----------
    log
        Table (CSV), MCAP file, ROS 1 or ROS 2 bag, or folder of a run; see docs/own-data.md.
    robot
        Name, .yaml or .urdf file, or example-robot-data:PATH; recordings of dqcontrol name theirs.
    reference
        YAML file with a reference, points file, or a second log; recordings of dqcontrol hold their own.
    reference_topic
        Topic of PoseStamped with the desired poses, or of JointState with the commanded positions, in --reference or
        else in the log.
    reference_joints
        Columns of the log with the commanded positions: what their names begin with (target_), or a,b,c.
    missing
        What to do with samples of a table that lack a position: join their neighbours linearly, or skip them.
    start_time
        When the reference begins, s after the log's first sample.
    align
        Find the start at which the reference fits the log best.
    duration
        How many seconds from there on are judged.
    skip_initial
        Length of the start that the settled errors leave out, s.
    low_pass
        Cut-off of the filter behind speeds and accelerations, Hz; 0 for none; default 10, none for own recordings.
    out
        New folder for record, metrics, plots and report.
    force
        Replace an earlier folder of results.
    """
    from dqcontrol.experiments.results_folder import check_new
    from dqcontrol.logs.evaluation import evaluate_log
    from dqcontrol.measures import summary_table

    if out is not None:
        check_new(out, force=force)
    result = evaluate_log(
        log,
        robot,
        reference,
        reference_topic=reference_topic,
        reference_joints=reference_joints,
        **options.arguments(),
        missing=missing,
        start=start_time,
        align=align,
        duration=duration,
        skip_initial=skip_initial,
        low_pass=low_pass,
    )
    if out is not None:
        result.save(out, force=force)
    filtered = ""
    if result.low_pass is not None:
        filtered = f"; speeds, accelerations and joint steps low-passed at {result.low_pass:g} Hz"
    print(result.verdict.words)
    if out is not None:
        print(f"results: {out}")
    print_table(summary_table(result.metrics, f"{result.label}{filtered}"))
    if result.verdict.failure:
        sys.exit(FAILED)

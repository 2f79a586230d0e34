"""Estimate what the servos of a robot are from its logs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from dqcontrol.cli.options import DEFAULT_LOG_OPTIONS, Force, LogOptions, Out
from dqcontrol.cli.screen import print_table


def identify(
    logs: list[Path],
    /,
    *,
    robot: str,
    options: LogOptions = DEFAULT_LOG_OPTIONS,
    targets: str | None = None,
    target_topic: str | None = None,
    replay: Annotated[bool, Parameter(negative=())] = False,
    out: Out = None,
    force: Force = False,
) -> None:
    """Find lag, delay, gain, sag and encoder of each joint from logs of commands and measured positions.

    Parameters
    ----------
    logs
        Tables (CSV), MCAP files, ROS 1 or ROS 2 bags of one robot; see docs/identify.md.
    robot
        Name, .yaml or .urdf file, or example-robot-data:PATH.
    targets
        Columns with the commanded positions: what their names begin with (target_), or a,b,c.
    target_topic
        Topic of JointState or Float64MultiArray with the commanded positions.
    replay
        Also run the commands of the first log on the plant: OUT/log and OUT/replay are runs to compare and to view.
    out
        New folder for identification.json, plant.yaml and report.html.
    force
        Replace these files in an existing folder.
    """
    from dqcontrol.errors import ValueRangeError
    from dqcontrol.experiments.results_folder import check_new
    from dqcontrol.logs.servos import identify as identify_servos
    from dqcontrol.reports.identification_report import write_identification_report

    if out is not None and not force:
        check_new(out, force=False)
    if replay and out is None:
        raise ValueRangeError("--replay: needs a folder for its runs; give --out")
    found = identify_servos(
        logs,
        robot,
        targets=targets,
        target_topic=target_topic,
        **options.arguments(),
    )
    if out is not None:
        print(f"results: {out}")
    print_table(found.table)
    for remark in found.remarks:
        print(remark)
    if out is not None:
        found.save(out, force=force)
        write_identification_report(found, out)
        if replay and found.fitted:
            print(found.save_replay(out))
            print(f"beside each other: dqcontrol compare {out / 'log'} {out / 'replay'}")
        if not found.fitted:
            print("no plant.yaml: no joint could be identified")

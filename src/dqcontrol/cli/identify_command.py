"""Find what the servos of a robot are from its logs."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from dqcontrol.cli.options import Force, Out
from dqcontrol.cli.screen import print_table


def identify(
    logs: list[Path],
    /,
    *,
    robot: str,
    base_link: str | None = None,
    tip_link: str | None = None,
    targets: str | None = None,
    target_topic: str | None = None,
    joints: str | None = None,
    joint_topic: str | None = None,
    command_topic: str | None = None,
    angles: Literal["rad", "deg"] | None = None,
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
    base_link
        Start of the chain in a URDF file.
    tip_link
        End of the chain in a URDF file.
    targets
        Columns with the commanded positions: what their names begin with (target_), or a,b,c.
    target_topic
        Topic of JointState or Float64MultiArray with the commanded positions.
    joints
        Names of the robot's joints in the log, if it has others: a,b,c in the robot's order.
    joint_topic
        Topic of JointState with the measured positions.
    command_topic
        Topic of JointState or Float64MultiArray with the commanded velocities.
    angles
        Unit of columns of a table that do not name theirs.
    out
        New folder for identification.json and plant.yaml.
    force
        Replace these two files in an existing folder.
    """
    from dqcontrol.experiments.results_folder import check_new
    from dqcontrol.logs.servos import identify as identify_servos

    if out is not None and not force:
        check_new(out, force=False)
    found = identify_servos(
        logs,
        robot,
        base_link=base_link,
        tip_link=tip_link,
        targets=targets,
        target_topic=target_topic,
        joints=[name.strip() for name in joints.split(",")] if joints is not None else None,
        joint_topic=joint_topic,
        command_topic=command_topic,
        angles=angles,
    )
    print_table(found.table)
    for remark in found.remarks:
        print(remark)
    if out is not None:
        found.save(out, force=force)
        print(f"results: {out}")
        if not found.fitted:
            print("no plant.yaml: no joint could be identified")

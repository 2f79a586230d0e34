"""Correct the geometry of an arm from measured poses of its end effector."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from dqcontrol.cli.options import BaseLink, Force, Out, TipLink
from dqcontrol.cli.screen import print_table


def calibrate(
    log: Path,
    /,
    *,
    robot: str,
    base_link: BaseLink = None,
    tip_link: TipLink = None,
    joints: Annotated[
        str | None,
        Parameter(
            help="Names of the robot's joints in the file, if it has others: a,b,c in the robot's order."
        ),
    ] = None,
    angles: Literal["rad", "deg"] | None = None,
    joint_topic: str | None = None,
    pose_topic: str | None = None,
    out: Out = None,
    force: Force = False,
) -> None:
    """Correct DH parameters, base and tool frame of an arm from measured poses of its end effector.

    Parameters
    ----------
    log
        Table (CSV) of joint positions and measured poses x, y, z, qw, qx, qy, qz; or a recording with both.
    robot
        Name, .yaml or .urdf file, or example-robot-data:PATH.
    angles
        Unit of the joints' columns that do not name theirs.
    joint_topic
        Topic of JointState with the measured positions.
    pose_topic
        Topic of PoseStamped with the measured poses.
    out
        New folder for robot.yaml, the corrected arm, and calibration.json.
    force
        Replace these two files in an existing folder.
    """
    from dqcontrol.experiments.results_folder import check_new
    from dqcontrol.logs.calibration import calibrate as calibrate_arm

    if out is not None and not force:
        check_new(out, force=False)
    found = calibrate_arm(
        log,
        robot,
        base_link=base_link,
        tip_link=tip_link,
        joints=[name.strip() for name in joints.split(",")] if joints is not None else None,
        angles=angles,
        joint_topic=joint_topic,
        pose_topic=pose_topic,
    )
    if out is not None:
        found.save(out, force=force)
        print(f"results: {out}")
    print_table(found.table)
    print_table(found.error_table)
    for remark in found.remarks:
        print(remark)

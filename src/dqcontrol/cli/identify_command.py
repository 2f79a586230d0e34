"""Estimate what the servos of a robot are from its logs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from cyclopts import App, Parameter

from dqcontrol.cli.options import DEFAULT_LOG_OPTIONS, Force, LogOptions, Out, Seconds, numbers
from dqcontrol.cli.screen import print_table

identify: App = App(
    name="identify",
    help="Estimate what a robot is from its logs: servos, or the tool on its force sensor.",
    help_format="plaintext",
)

SensorPosition = Annotated[
    str | None,
    Parameter(help="Of the force sensor as seen from the hand: x,y,z in m.", allow_leading_hyphen=True),
]
SensorTurn = Annotated[
    str | None, Parameter(help="Its roll, pitch, yaw: a,b,c in rad.", allow_leading_hyphen=True)
]


@identify.default
def servos(
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
    from dqcontrol.reports.study_reports import write_identification_report

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


@identify.command
def tool(
    logs: list[Path],
    /,
    *,
    robot: str,
    known: Path | None = None,
    sensor_position: SensorPosition = None,
    sensor_rpy: SensorTurn = None,
    wrench_topic: str | None = None,
    options: LogOptions = DEFAULT_LOG_OPTIONS,
    out: Out = None,
    force: Force = False,
) -> None:
    """Find mass, centre and bias of the tool on a force sensor, from logs in which the robot rests in several poses.

    Parameters
    ----------
    logs
        Runs, tables with columns fx, fy, fz, tx, ty, tz beside the joints, or recordings of ROS.
    robot
        Name, .yaml or .urdf file, or example-robot-data:PATH.
    known
        File of a tool whose mass and centre are kept: a tare, for which one rest in the air is enough.
    wrench_topic
        Topic of WrenchStamped, the only one if omitted.
    out
        New file for contact.sensor.tool and supervisor.payload of specs.
    force
        Replace that file.
    """
    from dqcontrol.contact import load_tool
    from dqcontrol.errors import ValueRangeError
    from dqcontrol.logs import tool_from_logs
    from dqcontrol.robots import load_robot

    chosen = options.arguments()
    if chosen["command_topic"] is not None:
        raise ValueRangeError("--command-topic: a tool is found at rest; leave it out")
    found = tool_from_logs(
        logs,
        load_robot(robot, chosen["base_link"], chosen["tip_link"]),
        _sensor(sensor_position, sensor_rpy),
        known=None if known is None else load_tool(known),
        wrench_topic=wrench_topic,
        joints=chosen["joints"],
        angles=chosen["angles"],
        joint_topic=chosen["joint_topic"],
    )
    if out is not None:
        print(f"results: {found.save(out, force=force)}")
    print_table(found.table)


@identify.command
def tool_motion(
    robot: str,
    /,
    *,
    start: Annotated[
        str | None,
        Parameter(help="Configuration about which it moves: a,b,c in rad or m, or with units: 90deg,0."),
    ] = None,
    sensor_position: SensorPosition = None,
    sensor_rpy: SensorTurn = None,
    period: Seconds = 0.008,
    out: Out = None,
    force: Force = False,
) -> None:
    """Propose a motion that rests where the tool on a force sensor can be told, and say how well.

    Parameters
    ----------
    robot
        Name, .yaml or .urdf file, or example-robot-data:PATH.
    period
        Control period, s.
    out
        New folder for motion.csv and tool.yaml, which runs it.
    force
        Replace these files in an existing folder.
    """
    from dqcontrol.logs import tool_motion as propose

    found = propose(
        robot, numbers("start", start, "rad or m"), _sensor(sensor_position, sensor_rpy), period=period
    )
    if out is not None:
        print(f"results: {found.save(out, force=force)}")
    print_table(found.table)
    if out is not None:
        print(f"run it: dqcontrol run {out / 'tool.yaml'} --out RESULTS")
        print(f"then:   dqcontrol identify tool RESULTS --robot {robot} --out my_tool.yaml")


def _sensor(position: str | None, rpy: str | None) -> Any:
    from dqcontrol.contact import ForceSensor

    given = {
        "position": numbers("sensor-position", position, "m"),
        "rpy": numbers("sensor-rpy", rpy, "rad"),
    }
    told: dict[str, Any] = {key: tuple(value) for key, value in given.items() if value is not None}
    return ForceSensor(**told)

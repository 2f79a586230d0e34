"""The ROS graph of [P16 4.5]: its nodes and topics, as processes of our controller and simulated robots."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from dqcontrol.errors import unknown_name
from dqcontrol.ros2 import launch_pair
from dqcontrol_theses.pereira2016 import published_spec

CONTROLLER = "robot_controlling_node"
_TRAJECTORY = "/joint_trajectory_controller/joint_trajectory"


class Side(NamedTuple):
    """A robot of the graph.

    Attributes
    ----------
    node
        Of the robot.
    experiment
        Of [P16], that it runs.
    command
        Topic of its commands.
    interface
        What they are.
    wrench
        Node and topic of its force sensor, if it has one.
    supervisor
        What its supervisor has that is not as usual.
    """

    node: str
    experiment: str
    command: str
    interface: str
    wrench: tuple[str, str] | None
    supervisor: dict[str, float]


SIDES = {
    # Its springs let it sag by 0.7 rad at its start, at up to 2.1 times its velocity limits.
    "meka": Side(
        "hum_controller",
        "spiral",
        "/humanoid_command",
        "humanoid",
        ("loadx6_publisher", "/loadx6_right_state"),
        {"overspeed": 4.0},
    ),
    # It starts 70 mm off with k = 50 1/s, on an arm whose acceleration nothing bounds: within 10 rad/s², the default,
    # its servos' lag would let it swing about the circle for ever, by 0.15 m.
    "kuka": Side("vrep", "iiwa-circle", "/vrep_robot", "trajectory", None, {"acceleration": 50.0}),
}


def graph_spec(side: Side, law: str, plant: str) -> dict[str, Any]:
    """Return the spec of one run of a robot's experiment with one of its laws.

    Raises
    ------
    UnknownNameError
        If there is no such law or plant.
    """
    spec = published_spec(side.experiment, plant)
    laws = spec.pop("laws")
    if law not in laws:
        raise unknown_name("law", law, laws)
    for key in ("parameter_sets", "repeats"):
        spec.pop(key, None)
    return {**spec, "law": laws[law], "supervisor": dict(side.supervisor)}


def node_options(side: Side, plant: str) -> tuple[list[str], list[str], list[str]]:
    """Return what ROS is told to rename, and the options of robot and controller."""
    renamed = ["-r", "/joint_states:=/humanoid_state"]
    if side.interface == "trajectory":
        renamed += ["-r", f"{_TRAJECTORY}:={side.command}"]
    robot = ["--name", side.node, "--interface", side.interface]
    if side.wrench and plant != "servo":
        robot += ["--wrench-node", side.wrench[0]]
        renamed += ["-r", f"/force_torque_sensor_broadcaster/wrench:={side.wrench[1]}"]
    return renamed, robot, ["--name", CONTROLLER, "--interface", side.interface]


def launch(robot: str, law: str, plant: str, options: Sequence[str] = ()) -> int:
    """Run robot and controller in processes of their own until one ends; return the controller's exit code.

    Parameters
    ----------
    robot
        A key of `SIDES`.
    law
        Label of the experiment's law.
    plant
        What the Meka is: ``servo`` or ``meka-physics``; with the latter it has a force sensor.
    options
        Further options of the controller's command line.

    Raises
    ------
    UnknownNameError
        If there is no such robot, law or plant.
    """
    if robot not in SIDES:
        raise unknown_name("robot", robot, SIDES)
    side = SIDES[robot]
    renamed, for_robot, for_controller = node_options(side, plant)
    return launch_pair(graph_spec(side, law, plant), for_robot, [*for_controller, *options], renamed)

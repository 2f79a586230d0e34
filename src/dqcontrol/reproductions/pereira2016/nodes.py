"""The ROS graph of [P16 4.5]: its nodes and topics, as processes of our controller and simulated robots."""

from __future__ import annotations

import ctypes
import signal
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from dqcontrol.errors import unknown_name
from dqcontrol.loop.clock import allows_real_time
from dqcontrol.loop.interrupts import counted_interrupts
from dqcontrol.reproductions.pereira2016 import published_spec

CONTROLLER = "robot_controlling_node"
_PRIORITY = (
    20  # of both processes, where that is allowed: their periods are 8 ms, and their work is a tenth of it
)
_SET_DEATH_SIGNAL = 1  # PR_SET_PDEATHSIG of prctl(2)
_LOOK = 0.2  # s between two looks at whether a user wants it to end
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
    wrench
        Node and topic of its force sensor, if it has one.
    supervisor
        What its supervisor has that is not as usual.
    """

    node: str
    experiment: str
    command: str
    wrench: tuple[str, str] | None
    supervisor: dict[str, float]


SIDES = {
    # Its springs let it sag by 0.7 rad at its start, at up to 2.1 times its velocity limits.
    "meka": Side(
        "hum_controller",
        "spiral",
        "/humanoid_command",
        ("loadx6_publisher", "/loadx6_right_state"),
        {"overspeed": 4.0},
    ),
    # It starts 70 mm off with k = 50 1/s, on an arm whose acceleration nothing bounds: within 10 rad/s², the default,
    # its servos' lag would let it swing about the circle for ever, by 0.15 m.
    "kuka": Side("vrep", "iiwa-circle", "/vrep_robot", None, {"acceleration": 50.0}),
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


def commands(side: Side, spec: Path, plant: str) -> tuple[list[str], list[str]]:
    """Return the command lines of robot and controller."""
    renamed = ["-r", "/joint_states:=/humanoid_state", "-r", f"{_TRAJECTORY}:={side.command}"]
    robot = ["robot", str(spec), "--name", side.node, "--interface", "trajectory"]
    if side.wrench and plant != "servo":
        robot += ["--wrench-node", side.wrench[0]]
        renamed += ["-r", f"/force_torque_sensor_broadcaster/wrench:={side.wrench[1]}"]
    controller = ["controller", str(spec), "--name", CONTROLLER, "--interface", "trajectory", "--autostart"]
    return [*robot, "--", *renamed], [*controller, "--", *renamed]


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
    spec = graph_spec(side, law, plant)
    scheduling = ["--priority", str(_PRIORITY)] if allows_real_time(_PRIORITY) else []
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"{side.experiment}.yaml"
        path.write_text(yaml.safe_dump(spec, allow_unicode=True), encoding="utf-8")
        for_robot, for_controller = commands(side, path, plant)
        both = (
            [*for_robot[:2], *scheduling, *for_robot[2:]],
            [*for_controller[:2], *scheduling, *options, *for_controller[2:]],
        )
        return _run(both)


def _run(lines: Sequence[Sequence[str]]) -> int:
    """Run robot and controller until one ends, or the user wants it; return the exit code of what failed."""
    with counted_interrupts() as interrupts:
        interrupts.only_count()
        running = [  # in sessions of their own: Ctrl-C is for this process, which ends them in order
            subprocess.Popen(
                [sys.executable, "-m", "dqcontrol", "ros2", *words],
                start_new_session=True,
                preexec_fn=_end_with_parent,
            )
            for words in lines
        ]
        robot, controller = running
        told = 0
        try:
            while controller.poll() is None and robot.poll() is None:
                if told < interrupts.count:
                    told += 1
                    controller.terminate()  # not SIGINT, which processes in the background ignore while they start
                with suppress(subprocess.TimeoutExpired):
                    controller.wait(_LOOK)
            survived = robot.poll() is None
        finally:
            for process in (controller, robot):
                process.terminate()
                process.wait()
        code = controller.returncode or (0 if survived else robot.returncode)
        return code if code >= 0 else 128 - code


def _end_with_parent() -> None:
    """Ask for SIGTERM when the launching process is killed, on Linux: no robot moves on with nobody to stop it."""
    if sys.platform == "linux":
        with suppress(OSError, AttributeError):  # a C library without it
            ctypes.CDLL(None).prctl(_SET_DEATH_SIGNAL, signal.SIGTERM)

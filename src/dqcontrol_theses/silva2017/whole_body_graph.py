"""A ROS graph of [S17]: its mobile manipulator and its whole-body controller as processes.

S17 does not print names of nodes or topics; those of the topics are the usual ones of its drivers.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from dqcontrol.errors import unknown_name
from dqcontrol.ros2 import launch_pair
from dqcontrol_theses.silva2017.specs import spec_data

ROBOT, CONTROLLER = "little_john", "whole_body_controller"
# v, ω and the joints: both wheels brake at 10 m/s², from their fastest in one period, so that they stand within 0.1 s
_ACCELERATION = [10.0, 10.0 / 0.13, *[10.0] * 5]  # m/s², rad/s²


def graph_spec(law: str, plant: str) -> dict[str, Any]:
    """Return the spec of one run of S17's comparison.

    Raises
    ------
    UnknownNameError
        If there is no such law or plant.
    """
    spec = spec_data("comparison")
    for key, name in (("law", law), ("plant", plant)):
        allowed = spec.pop(f"{key}s")
        if name not in allowed:
            raise unknown_name(key, name, allowed)
        spec[key] = allowed[name]
    spec["supervisor"] = {"acceleration": _ACCELERATION}
    return spec


def launch(law: str, plant: str, options: Sequence[str] = ()) -> int:
    """Run robot and controller in processes of their own until one ends; return the controller's exit code.

    Parameters
    ----------
    law
        Label of the comparison's law.
    plant
        ``camera`` or ``ideal``.
    options
        Further options of the controller's command line.

    Raises
    ------
    UnknownNameError
        If there is no such law or plant.
    """
    return launch_pair(graph_spec(law, plant), ["--name", ROBOT], ["--name", CONTROLLER, *options])

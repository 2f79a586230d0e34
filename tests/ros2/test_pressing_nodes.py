"""A controller behind topics that presses: by the wrench that the robot publishes, and without one it rests."""

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="needs ROS 2: pip install 'dqcontrol[ros2]'")

from nodes import UNHURRIED
from rclpy.parameter import Parameter

from dqcontrol.errors import Error
from dqcontrol.plants.sensors import TOUCH_FORCE
from dqcontrol.ros2.loading import load

PRESS = {
    "start": [0, 0.6, 0, -1.6, 0, 0.9, 0],
    "reference": {"kind": "set-point"},
    "duration": 100,
    "law": {"kind": "proportional-feedforward", "gain": 1},
    "contact": {
        "axes": "base",
        "translation": {"damping": 200, "stiffness": ["rigid", "rigid", 0]},
        "force": {"z": 2},
        "limits": {"speed": 0.05},
    },
    "world": {"board": {"box": [0.4, 0.4, 0.04], "position": [0.55, 0, 0.284], "stiffness": 500}},
    "plant": {"kind": "servo", "time_constant": 0.02, "wrist": {}},
}


def test_it_presses_by_the_wrench_of_the_robot(spec, node):
    from dqcontrol.ros2.controller_node import ControllerNode
    from dqcontrol.ros2.robot_node import RobotNode

    path = spec(**PRESS)
    robot = RobotNode(load(path))
    node.host(robot)
    controller = ControllerNode(path)
    controller.configure()
    for name, value in {**UNHURRIED, "start_tolerance": 3.0}.items():
        (done,) = controller.set_parameters([Parameter(name, value=value)])
        assert done.successful, done.reason
    node.host(controller)
    following = controller.following

    def tries():
        try:
            following.activate()
        except Error:
            return False
        return True

    assert node.serve(tries)
    channels, plant = robot._plant.channels, robot._plant
    sizes = [channel.size for channel in channels]
    first = sum(sizes[: [channel.name for channel in channels].index(TOUCH_FORCE)])
    assert node.serve(lambda: abs(plant.readings[first + 2] - 2.0) < 0.2), controller.outcome
    assert following._wrench_input.wrench.shape == (6,)
    (done,) = controller.set_parameters([Parameter("contact.force.z", value=3.0)])  # goes on where it is
    assert done.successful, done.reason
    assert node.serve(lambda: abs(plant.readings[first + 2] - 3.0) < 0.2), controller.outcome
    (refused,) = controller.set_parameters([Parameter("contact.translation.damping", value=0.3)])
    assert "contact: unstable against the stiffest body" in refused.reason
    assert following.loaded.law.contact.translation.damping == 200.0
    following._wrench_input._heard = -np.inf  # the last one is long ago
    assert following._wrench_input.wrench.size == 0
    assert following._wrench_input.wrench_age == 0.0  # which stops nothing: the contact stage retreats

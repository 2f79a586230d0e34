"""An impedance behind topics: efforts out, joint states in; the arm here, its controller in another process."""

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="needs ROS 2: pip install 'dqcontrol[ros2]'")

from nodes import PATIENT

import dqcontrol as dqc
from dqcontrol import algebra
from dqcontrol.errors import Error
from dqcontrol.ros2.loading import load

STIFFNESS, PUSH = 800.0, 8.0  # N/m and N
SOFT = {
    "start": [0, 0.6, 0, -1.6, 0, 0.9, 0],
    "reference": {"kind": "set-point"},
    "duration": 100,
    "law": {"kind": "proportional-feedforward", "gain": 1},
    "plant": {
        "kind": "mujoco",
        "impedance": {"axes": "base", "stiffness": STIFFNESS, "turn_stiffness": 30},
    },
}


def test_it_gives_way_by_force_over_stiffness_and_a_killed_controller_leaves_it_at_rest(spec, start, node):
    from dqcontrol.ros2.robot_node import RobotNode

    path = spec(**SOFT, period=0.005)
    robot = RobotNode(load(path), interface="effort")
    node.host(robot)
    plant, arm = robot._plant, dqc.load_robot("iiwa7")
    begin = algebra.translation(arm.fkm(plant.q))
    controller = start(
        "controller", path, "--interface", "effort", "--autostart", *PATIENT, "-p", "start_tolerance:=3.0"
    )
    assert node.serve(lambda: robot._is_driven)
    row, force, ways = int(arm.ends[0]), np.array([0, 0, -PUSH]), []

    def pushed():
        place = algebra.translation(arm.fkm(plant.q))
        plant.push(row, place, force)
        ways.append(place - begin)
        wanted = force / STIFFNESS
        return len(ways) > 50 and np.abs(np.array(ways[-50:]) - wanted).max() < 0.03 * PUSH / STIFFNESS

    assert node.serve(pushed), ways[-50:]
    force = np.zeros(3)
    assert node.serve(pushed), ways[-50:]  # and comes back
    force = np.array([0, PUSH, 0])
    assert node.serve(lambda: pushed() or ways[-1][1] > 2e-3)  # while it moves,
    controller.kill()
    assert node.serve(lambda: robot._condition()[1] == "holds: no commands")  # it is left alone
    plant.push(row, begin, np.zeros(3))
    rates = []
    assert node.serve(lambda: rates.append(np.abs(plant.velocity).max()) or max(rates[-30:]) < 1e-4)
    rests = plant.q.copy()
    ticks = robot._ticks
    assert node.serve(lambda: robot._ticks > ticks + 100)
    np.testing.assert_allclose(plant.q, rests, atol=1e-5)


def test_who_takes_or_gives_no_efforts_says_so(spec):
    stiff = load(spec(**{**SOFT, "plant": {"kind": "servo"}}))
    with pytest.raises(
        Error, match="'effort' needs joints that take torques, and those of plant 'servo' take none"
    ):
        stiff.by_effort()
    with pytest.raises(
        Error, match=r"'effort' sends the torques of plant\.impedance, and plant 'servo' has none"
    ):
        stiff.impedance("effort")
    assert stiff.impedance("velocity") is None
    shaped = {**SOFT["plant"]["impedance"], "mass": 5.0, "turn_inertia": 0.1}
    shaped = load(spec(**{**SOFT, "plant": {"kind": "mujoco", "impedance": shaped, "wrist": {}}}))
    with pytest.raises(Error, match=r"plant\.impedance\.mass: takes a wrench as fresh as the torque"):
        shaped.impedance("effort")
    slow = load(spec(**SOFT, period=0.1))
    with pytest.raises(Error, match=r"plant\.impedance: is too stiff for a torque every 100 ms"):
        slow.impedance("effort")
    assert load(spec(**SOFT, period=0.005)).impedance("effort") is not None

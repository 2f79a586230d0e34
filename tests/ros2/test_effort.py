"""An impedance behind topics: efforts out, joint states in; the arm here, its controller in another process."""

import time

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="needs ROS 2: pip install 'dqcontrol[ros2]'")

from nodes import PATIENT
from rclpy.parameter import Parameter
from std_msgs.msg import Float64MultiArray

import dqcontrol as dqc
from dqcontrol import algebra
from dqcontrol.errors import Error
from dqcontrol.loop.control import Phase
from dqcontrol.ros2.loading import load

STIFFNESS, PUSH = 300.0, 3.0  # N/m and N: as soft as late messages of a busy machine ask for
SOFT = {
    "start": [0, 0.6, 0, -1.6, 0, 0.9, 0],
    "reference": {"kind": "set-point"},
    "duration": 100,
    "law": {"kind": "proportional-feedforward", "gain": 1},
    "plant": {
        "kind": "mujoco",
        "impedance": {
            "axes": "base",
            "stiffness": STIFFNESS,
            "turn_stiffness": 5,
            "damping_ratio": 0.6,
            "posture": 0.5,
        },
    },
}


@pytest.mark.slow
def test_it_gives_way_by_force_over_stiffness_and_a_killed_controller_leaves_it_at_rest(spec, start, node):
    from dqcontrol.ros2.robot_node import RobotNode

    path = spec(**SOFT)
    robot = RobotNode(load(path), interface="effort")
    robot.set_parameters([Parameter("command_timeout", value=0.5)])  # a busy machine has efforts late
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


def test_a_compliant_arm_holds_by_angles_until_efforts_come(spec, node):
    from dqcontrol.ros2.robot_node import RobotNode

    robot = RobotNode(load(spec(plant={"kind": "compliant", "mode": "TORQUE_GC"})), interface="effort")
    node.host(robot)
    assert node.serve(lambda: robot._plant.mode == "THETA_GC")
    efforts = node.create_publisher(Float64MultiArray, "/forward_effort_controller/commands", 1)
    none = Float64MultiArray(data=[0.0] * 7)
    assert node.publish(efforts, none, lambda: robot._plant.mode == "TORQUE_GC")
    assert node.serve(lambda: robot._plant.mode == "THETA_GC")
    assert robot._condition()[1] == "holds: no commands"


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
    slow = load(spec(**SOFT, period=0.2))
    with pytest.raises(Error, match=r"plant\.impedance: is too stiff for a torque every 200 ms"):
        slow.impedance("effort")
    assert load(spec(**SOFT)).impedance("effort") is not None


def test_a_fault_ends_efforts_at_once_and_a_soft_stop_does_not(spec, node):
    from dqcontrol.ros2.controller_node import ControllerNode

    controller = ControllerNode(spec(**SOFT, supervisor={"stale_after": 5.0}), interface="effort")
    controller.configure()
    following, told = controller.following, []
    assert following
    following._commands.send, following._commands.claim = lambda *each: told.append(each), lambda: None
    start = following.loaded.case.scene.start

    def step(measured):
        following._step(following._passed + 0.01, measured, time.monotonic())
        return len(told)

    following._latest, following._measured = (time.monotonic(), 0.0), start.copy()
    following.activate()
    assert step(start) == 2
    assert step(None) == 2  # joints that nobody saw
    following.control.deactivate()
    assert step(start) == 3
    following._latest = (time.monotonic(), 0.0)
    while following.control.phase is Phase.STOPPING:
        step(start)
    following.activate()
    count = len(told)
    assert step(start) == count + 1
    following.control.emergency_stop()
    assert step(start) == count + 1
    assert following.control.phase is not Phase.ACTIVE
    controller.destroy_node()

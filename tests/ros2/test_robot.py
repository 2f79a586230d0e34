"""The simulated robot's node: its wrench is what its plant senses, and commands that cannot be right move nothing."""

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="needs ROS 2: pip install 'dqcontrol[ros2]'")

from geometry_msgs.msg import WrenchStamped
from nodes import PATIENCE
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from dqcontrol.errors import FallenError
from dqcontrol.plants.compliant import joint_columns as column
from dqcontrol.ros2 import robot_node
from dqcontrol.ros2.loading import load
from dqcontrol.ros2.messages import nanoseconds

MEKA = {"robot": "meka-a2", "plant": {"kind": "compliant", "hand": True, "payload": {"mass": 1.5}}}
TOPIC = "/force_torque_sensor_broadcaster/wrench"


def sensed(path, periods):
    """Return force and torque of the spec's plant, held still, after each period."""
    loaded = load(path)
    plant = loaded.case.plant.start(loaded.robot, loaded.case.scene.start, loaded.period, periods, 0)
    sizes = [channel.size for channel in plant.channels]
    first = sum(sizes[: [channel.name for channel in plant.channels].index("wrist_force")])
    rows = []
    for _ in range(periods):
        plant.step(np.zeros(7))
        rows.append(plant.readings[first : first + 6].copy())
    return np.array(rows)


def test_the_wrench_on_the_topic_is_what_the_plant_senses_and_wrong_commands_move_nothing(
    spec, node, diagnostics, capfd
):
    from dqcontrol.ros2.robot_node import RobotNode

    path, wrenches = spec(**MEKA), []
    robot = RobotNode(load(path), wrench_node="loadx6_publisher")
    for one in robot.nodes:
        node.host(one)
    node.create_subscription(WrenchStamped, TOPIC, wrenches.append, 100)
    commands = node.create_publisher(Float64MultiArray, "/forward_velocity_controller/commands", 1)
    for data, why in (
        ([0.1] * 6, "velocity: expected 7 numbers, got 6"),
        ([0.1] * 6 + [np.nan], "velocity: number 7 is not finite"),
    ):
        wrong = Float64MultiArray(data=data)
        assert node.publish(commands, wrong, lambda why=why: last_refused(diagnostics) == why), why
        assert f"refused: {why}" in capfd.readouterr().err
    change = node.create_client(SetParameters, "/robot/set_parameters")
    assert change.wait_for_service(PATIENCE)
    wrong = Parameter("command_timeout", value=5.0).to_parameter_msg()
    answer = change.call_async(SetParameters.Request(parameters=[wrong]))
    assert node.serve(answer.done)
    assert not answer.result().results[0].successful
    assert node.serve(lambda: "command_timeout: expected a number 0.002 … 1" in last_refused(diagnostics))
    assert "refused: parameter command_timeout: expected a number" in capfd.readouterr().err
    assert diagnostics["/robot"][0] == "holds: no commands"

    assert node.serve(lambda: len(wrenches) > 30)
    (publisher,) = node.get_publishers_info_by_topic(TOPIC)
    assert publisher.node_name == "loadx6_publisher"
    assert {message.header.frame_id for message in wrenches} == {"tool0"}
    told = [[getattr(v, axis) for v in (m.wrench.force, m.wrench.torque) for axis in "xyz"] for m in wrenches]
    rows = sensed(path, robot._ticks).tolist()  # as if nothing had come; its noise makes each one different
    order = [rows.index(one) for one in told]
    assert order == sorted(set(order))
    assert np.linalg.norm(told[-1][:3]) > 1.5 * 9.8  # and it bears the hand too


def test_without_commands_it_brakes_and_holds(spec, node):
    from dqcontrol.ros2.robot_node import RobotNode

    robot = RobotNode(load(spec()))
    node.host(robot)
    commands = node.create_publisher(Float64MultiArray, "/forward_velocity_controller/commands", 1)
    command = Float64MultiArray(data=[0.1] * 7)
    assert node.publish(commands, command, lambda: robot._supervisor.rate(robot._state).max() > 0.05)
    assert node.serve(lambda: robot._condition()[1] == "holds: no commands")
    assert node.serve(lambda: not robot._supervisor.rate(robot._state).any())


def test_the_humanoid_node_takes_mode_and_stiffness_with_each_command_and_passes_states_on_at_its_own_rate(
    spec, node, diagnostics
):
    from dqcontrol.ros2.robot_node import RobotNode

    plant = {"kind": "compliant", "command_mode": "measured", "exchange_period": 0.01, "encoder_noise": 1e-3}
    robot, told = RobotNode(load(spec(robot="meka-a2", period=0.008, plant=plant)), interface="humanoid"), []
    node.host(robot)
    node.create_subscription(JointState, "/joint_states", told.append, 1000)
    commands = node.create_publisher(JointTrajectory, "/humanoid_command", 1)
    command = JointTrajectory(joint_names=list(robot._joints))
    command.points = [JointTrajectoryPoint(positions=robot._plant.measured.tolist(), effort=[0.6] * 7)]
    command.header.frame_id = "THETA_GC_MJ"
    assert node.publish(commands, command, lambda: robot._plant.mode == "THETA_GC_MJ")
    assert (robot._plant.memory.constants[:, column.STIFFNESS] == 0.6).all()
    command.header.frame_id = "TORK"
    assert node.publish(commands, command, lambda: "mode: unknown name 'TORK'" in last_refused(diagnostics))
    assert node.serve(lambda: len(told) > 20)
    since = np.array([nanoseconds(message.header.stamp) - robot._origin for message in told])
    assert not (since % 10_000_000).any()  # 100 a second, not the 125 of the spec's period
    assert (np.diff(since) > 0).all()
    assert len({message.position[1] for message in told}) == len(told)  # each of them new


def test_a_controller_of_a_robot_with_a_pace_of_its_own_steps_by_its_clock_from_the_last_states(
    spec, node, monkeypatch
):
    from dqcontrol.ros2.controller_node import ControllerNode

    plant = {"kind": "compliant", "command_mode": "measured", "exchange_period": 0.01}
    path = spec(robot="meka-a2", period=0.008, plant=plant, supervisor={"stale_after": 1000.0})
    controller = ControllerNode(path, interface="humanoid")
    node.host(controller)
    controller.configure()
    node.create_subscription(JointTrajectory, "/humanoid_command", print, 1)
    assert node.serve(lambda: controller.count_subscribers("/humanoid_command"))
    following, steps = controller.following, []
    assert following
    state = JointState(name=list(following.loaded.robot.joint_names))
    start = following.loaded.case.scene.start

    def hear(exchange):
        state.position = (start + 1e-3 * exchange).tolist()
        state.header.stamp.sec, state.header.stamp.nanosec = 5, 10_000_000 * exchange
        following._hear_joints(state)

    hear(0)
    following._step_by_clock()  # nothing before it is active
    following.activate()
    monkeypatch.setattr(following, "_step", lambda passed, measured, now: steps.append((passed, measured)))
    hear(1)
    assert not steps
    following._step_by_clock()
    following._step_by_clock()
    hear(2)
    following._step_by_clock()
    (first, a), (second, b), (third, c) = steps
    assert 0 < first < second < third
    np.testing.assert_allclose([a - start, b - start, c - start], [[1e-3] * 7, [1e-3] * 7, [2e-3] * 7])


def last_refused(diagnostics, name="/robot"):
    return diagnostics.get(name, ("", {}))[1].get("last refused", "")


def test_a_robot_that_has_fallen_says_so_and_is_silent(spec, node):
    from dqcontrol.ros2.robot_node import RobotNode

    def fall(command):
        raise FallenError("toppled at 1 s")

    robot, heard = RobotNode(load(spec())), []
    node.host(robot)
    node.create_subscription(JointState, "/joint_states", heard.append, 10)
    assert node.serve(lambda: heard)
    robot._plant.step = fall
    assert node.serve(lambda: robot._condition()[:2] == ("error", "broken: toppled at 1 s"))
    node.serve(seconds=0.1)
    heard.clear()
    node.serve(seconds=0.1)
    assert not heard


def test_trajectories_that_do_not_fit_are_refused(spec, node, diagnostics, capfd):
    from dqcontrol.ros2.robot_node import RobotNode

    loaded = load(spec())
    robot = RobotNode(loaded, interface="trajectory")
    node.host(robot)
    commands = node.create_publisher(JointTrajectory, "/joint_trajectory_controller/joint_trajectory", 1)
    assert node.serve(lambda: commands.get_subscription_count())
    names, start = list(loaded.robot.joint_names), loaded.case.scene.start
    point = JointTrajectoryPoint(positions=(start + 0.5).tolist())
    for joints, points, why in (
        (names, [point, point], "trajectory: expected 1 point, got 2"),
        ([*names[:6], "grip"], [point], f"trajectory: has no joint '{names[6]}'"),
        ([*names[:6], names[0]], [point], f"trajectory: joint '{names[0]}' is there twice"),
        (names[:6], [point], "trajectory: 6 names, but 7 positions"),
        (names, [JointTrajectoryPoint(positions=[np.inf] * 7)], "trajectory: number 1 is not finite"),
    ):
        wrong = JointTrajectory(joint_names=joints, points=points)
        assert node.publish(commands, wrong, lambda why=why: last_refused(diagnostics).startswith(why)), why
        assert f"refused: {why}" in capfd.readouterr().err
    np.testing.assert_array_equal(robot._plant.q, start)


class MadeTime:
    """A time that passes when it is told to."""

    def __init__(self):
        self.now = 100.0

    def monotonic(self):
        return self.now


def test_a_robot_that_stood_still_does_not_jump_to_the_positions_that_it_missed(spec, node, monkeypatch):
    """Its controller went on for a while: it braked then, or goes on still."""
    made, loaded, period = MadeTime(), load(spec(plant={"kind": "integrator"})), 0.01
    monkeypatch.setattr(robot_node, "time", made)
    robot = robot_node.RobotNode(loaded, interface="position")
    node.host(robot)
    start, path, speed, goal = loaded.case.scene.start, [], 0.2 * period, 0.0

    def tick(step):
        nonlocal goal
        made.now, goal = made.now + period, goal + step
        obeyed = robot._obeyed["joints"]
        obeyed.asked, obeyed._heard = start + goal * np.eye(7)[0], made.now
        robot._tick()
        path.append(robot._supervisor.position(robot._state)[0])

    for seconds, goes_on in ((0.079, False), (1.5, True)):
        for k in range(60):
            tick(min(k / 20, 1.0) * speed)
        assert path[-1] == pytest.approx(goal, abs=1e-9)
        path.clear()
        made.now += seconds
        tick(6 * speed)
        path.clear()  # a robot that stood still for less than a second makes up for its periods at once
        for _ in range(130):
            tick(goes_on * speed)
        assert np.diff(path).max() <= 1.2 * speed  # four times as fast without
        assert path[-1] == pytest.approx(goal, abs=1e-6)
        for k in range(30):
            tick(goes_on * max(1 - k / 20, 0.0) * speed)

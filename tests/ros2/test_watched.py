"""A robot that is watched: signals, controllers that stand still, clocks that jump, strangers, heartbeat, enabling."""

import os
import signal
import subprocess
import sys
import time
from contextlib import suppress

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="needs ROS 2: pip install 'dqcontrol[ros2]'")

from forks import Forks
from geometry_msgs.msg import WrenchStamped
from nodes import PATIENT, UNHURRIED, read_until
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, Float64MultiArray

import dqcontrol as dqc
from dqcontrol.errors import Error
from dqcontrol.experiments import load_run
from dqcontrol.experiments.run import Run
from dqcontrol.loop.clock import allows_real_time
from dqcontrol.loop.control import Phase
from dqcontrol.loop.interrupts import Interrupts
from dqcontrol.ros2.interfaces import COMMANDS, JOINT_STATES, WRENCH
from dqcontrol.ros2.loading import load
from dqcontrol.ros2.messages import NANOSECONDS

MOTIONS = sorted(COMMANDS.keys() - {"effort"})  # torques end as test_effort.py says
CIRCLE = {"kind": "circle", "radius": 0.05, "duration": 60.0, "turns": 10}  # 0.052 m/s
SPEED = 2 * np.pi * CIRCLE["radius"] * CIRCLE["turns"] / CIRCLE["duration"]
IIWA = dqc.load_robot("iiwa7")


@pytest.fixture
def pair(spec, node):
    """Return what makes a configured controller and a robot in this process, and what makes another controller."""
    from dqcontrol.ros2.controller_node import ControllerNode
    from dqcontrol.ros2.robot_node import RobotNode

    def make(**changes):
        path = spec(reference=CIRCLE, **changes)
        robot = RobotNode(load(path))
        node.host(robot)
        return configured(path), robot

    def configured(path, name="dqcontrol"):
        controller = ControllerNode(path, name=name)
        controller.configure()
        for name, value in {
            **UNHURRIED,
            "start_tolerance": 3.0,
        }.items():  # who comes later finds the arm anywhere
            (done,) = controller.set_parameters([Parameter(name, value=value)])
            assert done.successful, done.reason
        node.host(controller)
        return controller

    return make, lambda: configured(spec(reference=CIRCLE), "second")


def activated(node, controller):
    """Activate as soon as that is allowed."""

    def tries():
        try:
            controller.following.activate()
        except Error:
            return False
        return True

    assert node.serve(tries)
    assert node.serve(lambda: np.abs(controller.following.control.rate).max() > 0.05)


def test_a_controller_that_stood_still_stops_and_says_so_and_its_reference_has_waited(pair, node):
    controller, _ = pair[0]()
    activated(node, controller)
    control, reached = controller.following.control, controller.following.control.desired[-1]
    controller.following._stepped -= 2000.0  # as if SIGSTOP had come so long ago
    assert node.serve(lambda: controller.phase is Phase.STOPPED)
    assert controller.outcome == "stop category 2: gap in time"
    assert controller.following.longest_period > 2000.0
    assert control.desired[-1] - reached < 1.0
    control.reset()
    controller.following.let_go()
    activated(node, controller)


def test_stamps_that_jump_stop_it(pair, node):
    controller, robot = pair[0]()
    activated(node, controller)
    before = controller.following.control.desired[-1]
    robot._origin += 2000 * NANOSECONDS
    assert node.serve(lambda: controller.phase is Phase.STOPPED)
    assert controller.outcome == "stop category 2: gap in time"
    assert controller.following.control.desired[-1] - before < 1.5


def test_a_robot_obeys_one_controller_and_is_heard_from_one_place(pair, node):
    make, another = pair
    (controller, robot), second = make(), another()
    activated(node, controller)
    with pytest.raises(
        Error, match=r"activate: /dqcontrol publishes on /forward_velocity_controller/commands too"
    ):
        second.following.activate()
    stranger = node.create_publisher(Float64MultiArray, "/forward_velocity_controller/commands", 1)
    assert node.serve(lambda: controller.phase is Phase.STOPPED)
    assert controller.outcome == (
        "stop category 1: emergency stop: /probe publishes on /forward_velocity_controller/commands too; "
        "a robot obeys one at a time"
    )
    assert node.serve(lambda: "several publish on" in robot._condition()[1])
    node.destroy_publisher(stranger)
    controller.following.control.reset()
    controller.following.let_go()
    activated(node, second)
    node.create_publisher(JointState, "/joint_states", 1)
    assert node.serve(lambda: second.phase is Phase.STOPPED)
    assert second.outcome == (
        "stop category 1: emergency stop: several publish on /joint_states: /probe, /robot"
    )
    second.following.control.reset()
    second.following.let_go()
    with pytest.raises(Error, match=r"activate: several publish on /joint_states"):
        second.following.activate()


def test_it_moves_only_while_enabled_and_its_heart_beats_while_it_does(pair, node):
    controller, _ = pair[0]()
    controller.set_parameters([Parameter("enable_timeout", value=1.0)])
    following = controller.following
    beats = []
    node.create_subscription(Bool, "/dqcontrol/heartbeat", lambda m: beats.append(m.data), 100)
    enable = node.create_publisher(Bool, "/dqcontrol/enable", 1)
    assert node.serve(lambda: len(beats) > 3)
    assert not any(beats)
    with pytest.raises(Error, match="activate: not enabled"):
        controller.following.activate()
    assert node.publish(enable, Bool(data=True), lambda: following._enabled > 0)
    following._enabled = np.inf  # a busy machine would be late with the next one
    activated(node, controller)
    assert node.serve(lambda: all(beats[-3:]))
    following._enabled = time.monotonic() - 1.01  # when the last one came
    assert node.serve(lambda: controller.phase is Phase.STOPPED)
    assert controller.outcome == "stop category 1: emergency stop: not enabled"
    assert node.serve(lambda: not any(beats[-3:]))


def test_efforts_and_the_wrench_are_supervised_where_they_are_bounded_and_each_stop_leaves_its_last_seconds(
    spec, node, diagnostics, tmp_path, monkeypatch
):
    from dqcontrol.ros2.controller_node import ControllerNode

    monkeypatch.setattr(Run, "write", lambda run, folder, **_: run.write_data(folder))  # without pictures
    bounds = {"effort": 50.0, "contact_force": 20.0, **{k.partition(".")[2]: v for k, v in UNHURRIED.items()}}
    bounds["jump"] = bounds["tracking_error"] = "1000 rad"  # more than a turn, which needs its unit
    bounds["payload"] = {"mass": 3.0, "center": [0.0, 0.0, 0.1]}
    path, out = spec(supervisor=bounds), tmp_path / "out"
    controller = ControllerNode(path, source="twist", out=out)
    controller.configure()
    node.host(controller)
    following, wrench = controller.following, WrenchStamped()
    assert following is not None
    told = JointState(name=list(IIWA.joint_names), position=following.loaded.case.scene.start.tolist())
    states, wrenches = (node.create_publisher(kind, topic, 1) for kind, topic in (
        (JointState, JOINT_STATES), (WrenchStamped, WRENCH),
    ))  # fmt: skip
    node.create_subscription(COMMANDS["velocity"][1], COMMANDS["velocity"][0], lambda _: None, 1)

    def tell():
        told.header.stamp = node.get_clock().now().to_msg()
        states.publish(told)
        if wrench.header.frame_id:
            wrenches.publish(wrench)

    def is_active():
        if controller.phase is Phase.INACTIVE:
            with suppress(Error):
                following.activate()
        return controller.phase is Phase.ACTIVE

    node.create_timer(0.01, tell)
    assert node.serve(lambda: "7 names, but 0 efforts" in last_refused(diagnostics))
    told.effort = [10.0] * 7
    assert node.serve(lambda: following.age < 0.5)
    with pytest.raises(Error, match=r"activate: no wrench on /force_torque_sensor_broadcaster/wrench"):
        following.activate()
    hand = dqc.algebra.rotation(IIWA.fkm(following.loaded.case.scene.start))
    weight = dqc.algebra.matrix_from_rotation(hand).T @ [0.0, 0.0, -3.0 * 9.81]
    wrench.wrench.force.x, wrench.wrench.force.y, wrench.wrench.force.z = weight.tolist()
    wrench.header.frame_id = "wrist"
    assert node.serve(lambda: "wrench: in frame 'wrist', but the payload is" in last_refused(diagnostics))
    wrench.header.frame_id = "tool0"
    assert node.serve(is_active)
    wrench.wrench.force.z += 30.0
    assert node.serve(lambda: controller.phase is Phase.STOPPED)
    assert controller.outcome == "stop category 1: contact"
    assert node.serve(lambda: diagnostics["/dqcontrol"][1]["stop category"].startswith("1: "))
    wrench.wrench.force.z -= 30.0
    assert node.serve(lambda: following._wrench_input.wrench[2] == pytest.approx(weight[2]))
    following.control.reset()
    assert node.serve(is_active)
    told.effort = [10.0] * 6 + [60.0]
    assert node.serve(lambda: controller.phase is Phase.STOPPED)
    assert controller.recorder is not None
    controller.recorder.save()
    for name, reason in (("black-box", "contact"), ("black-box-2", "joint effort too large")):
        assert load_run(out / name).record.stopped == f"halted: stop category 1: {reason}"


def last_refused(diagnostics):
    return diagnostics.get("/dqcontrol", ("", {}))[1].get("last refused", "")


def test_gains_that_would_make_it_unstable_are_refused_while_it_moves(pair, node):
    controller, _ = pair[0]()
    activated(node, controller)
    (done,) = controller.set_parameters([Parameter("law.gain", value=1e6)])
    assert not done.successful
    assert done.reason == (
        "law: position unstable: k = 1e+06 1/s, spectral radius 1.81e+03; the parameter allow_unstable lets it through"
    )
    (done,) = controller.set_parameters([Parameter("law.gain", value=6.0)])
    assert done.successful
    assert controller.phase is Phase.ACTIVE


def test_whatever_breaks_its_loop_off_the_last_command_is_rest(pair, node, monkeypatch):
    controller, _ = pair[0]()
    topic, message_type = COMMANDS["velocity"]
    rates = []
    node.create_subscription(message_type, topic, lambda m: rates.append(np.abs(m.data).max()), 1000)
    activated(node, controller)
    assert node.serve(lambda: rates and rates[-1] > 0.05)

    def breaks(*_, **__):
        raise RuntimeError("what nobody thought of")

    monkeypatch.setattr(controller.following.control, "step", breaks)
    with pytest.raises(RuntimeError, match="what nobody thought of"):
        controller.serve(Interrupts())
    assert node.serve(lambda: rates[-1] == 0.0)
    assert controller.outcome == "broken off while it moved"


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["controller", "robot"])
def test_signals_at_random_moments_end_it_cleanly_with_the_robot_at_rest(spec, start, node, tmp_path, kind):
    """So many as SIGNALS in the environment says; each node was once sent 1000."""
    count, seed = int(os.environ.get("SIGNALS", "25")), time.time_ns() % 100_000
    print("seed", seed)
    rng, path, commands, speeds = np.random.default_rng(seed), spec(reference=CIRCLE), [], []
    topic, message_type = COMMANDS["velocity"]
    node.create_subscription(message_type, topic, lambda m: commands.append(m.data), 1000)
    node.create_subscription(
        JointState, "/joint_states", lambda m: speeds.append(np.abs(m.velocity).max()), 10
    )
    words, moved = (kind, path), 0
    if kind == "controller":
        start("robot", path, until="serves")
        words = (
            *words,
            "--autostart",
            *PATIENT,
            "-p",
            "start_tolerance:=3.0",
        )  # whoever was before left it anywhere
    with Forks(path, tmp_path) as forks:
        for trial in range(count):
            commands.clear()
            child = forks.start(words, background := bool(rng.random() < 0.5))
            if (
                kind == "controller" and rng.random() < 0.5
            ):  # else, on a busy machine, hardly one would have moved
                assert node.serve(lambda: any(any(command) for command in commands))
            node.serve(seconds=rng.uniform(0.05, 3.0 if kind == "controller" else 1.0))
            number = signal.SIGINT if rng.random() < 0.5 else signal.SIGTERM
            forks.kill(child, number)
            code, log = forks.end(child)
            about = f"trial {trial}, {number.name}, background {background}, code {code}:\n{log}"
            # Before there is a node it is 130; before its first line the system may have ended it.
            stopped_before = code == 2 and "stopped: stop category" in log  # by a machine that was too busy
            assert code in (0, 130) or stopped_before or (code == -number and not log), about
            for word in ("Traceback", "ignored in", "terminate called"):
                assert word not in log, about
            if kind == "controller":
                speeds.clear()
                assert node.serve(
                    lambda: speeds and speeds[-1] == 0.0 and not (commands and any(commands[-1]))
                ), about
                moved += any(any(command) for command in commands)
    assert kind == "robot" or moved > count / 10
    print("moved in", moved)


@pytest.mark.slow
@pytest.mark.parametrize("interface", MOTIONS)
@pytest.mark.parametrize("pause", [1.0, 3.0])
def test_a_frozen_controller_never_lunges(spec, start, node, interface, pause):
    path, heard = spec(reference=CIRCLE, plant={"kind": "integrator"}), []

    def hear(message):
        heard.append((message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec, *message.position))

    node.create_subscription(JointState, "/joint_states", hear, 1000)
    start("robot", path, "--interface", interface)
    words = (
        "controller",
        path,
        "--interface",
        interface,
        "--autostart",
        "--",
        "-p",
        "supervisor.stale_after:=0.3",
    )
    controller = start(*words, until="active")
    node.serve(seconds=1.5)  # past the start's ramp, which may be faster
    frozen = len(heard)
    controller.send_signal(signal.SIGSTOP)
    node.serve(seconds=pause)
    controller.send_signal(signal.SIGCONT)
    assert "gap in time" in read_until(controller, "stopped:")
    node.serve(seconds=0.5)
    times, joints = np.array(heard)[frozen:, 0], np.array(heard)[frozen:, 1:]
    hand = dqc.algebra.translation(IIWA.fkm(joints))
    speeds = np.linalg.norm(np.diff(hand, axis=0), axis=1) / np.diff(times)
    print(f"{interface}, {pause} s: {speeds.max() / SPEED:.3f} of the reference's speed")
    assert speeds.max() <= 1.1 * SPEED
    assert speeds[-1] == 0.0


@pytest.mark.slow
@pytest.mark.parametrize("interface", MOTIONS)
def test_when_the_robot_dies_on_a_busy_machine_commands_come_to_rest_within_a_tenth_of_a_second(
    spec, start, node, interface
):
    path, moving = spec(reference=CIRCLE), []
    before = [np.zeros(7)]

    def hear(message, info):
        if interface in ("position", "humanoid"):
            position = np.array(message.data if interface == "position" else message.points[0].positions)
            rate, before[0] = np.abs(position - before[0]), position
        else:
            rate = np.abs(message.data if interface == "velocity" else message.points[0].velocities)
        if rate.max() > 0:
            moving.append(info["source_timestamp"] * 1e-9)

    topic, kind = COMMANDS[interface]
    node.create_subscription(kind, topic, hear, 1000)
    priority = ["--priority", 20] if allows_real_time(20) else []
    robot = start("robot", path, "--interface", interface, *priority)
    controller = start("controller", path, "--interface", interface, "--autostart", *priority, until="active")
    assert node.serve(lambda: len(moving) > 100)
    busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(10)]
    try:
        node.serve(seconds=0.5)
        assert controller.poll() is None
        killed = time.time()
        robot.kill()
        node.serve(seconds=2.0)
    finally:
        for one in busy:
            one.kill()
    print(f"{interface}: {1e3 * (moving[-1] - killed):.0f} ms")
    assert moving[-1] - killed < 0.1


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="other systems tell no child that its parent was killed")
def test_the_graph_of_pereira_ends_with_its_launcher_even_if_that_is_killed(start):
    launch = start("pereira2016", "kuka", until="robot_controlling_node]: active")
    launch.kill()
    log = launch.stdout.read()  # until both have ended, whose output it is too
    assert "robot_controlling_node]: stopping" in log
    assert "Traceback" not in log


LAUNCHED = """
import os, sys, time
from dqcontrol.loop.interrupts import counted_interrupts

launcher = os.getppid()
with counted_interrupts() as interrupts:
    interrupts.only_count()
    print("runs", file=sys.stderr, flush=True)
    while not interrupts.count:
        time.sleep(0.01)
    print("was told", file=sys.stderr, flush=True)
    while os.getppid() == launcher:
        time.sleep(0.01)
    print("stop requests:", interrupts.count)
"""
LAUNCHER = f"""
import subprocess, sys, threading, time
from dqcontrol.ros2.repeated_motion import end_with_parent

def launch():
    global launched
    launched = subprocess.Popen(
        [sys.executable, "-c", {LAUNCHED!r}], stderr=subprocess.PIPE, text=True,
        start_new_session=True, preexec_fn=end_with_parent,
    )
    print(launched.stderr.readline(), end="", flush=True)

thread = threading.Thread(target=launch)
thread.start()
thread.join()
print(launched.stderr.readline(), end="", flush=True)
time.sleep(1000)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="other systems tell no child that its parent was killed")
def test_a_launcher_that_is_killed_is_one_stop_request_however_many_threads_it_had(start):
    """The kernel tells a child when the thread that started it ends, and each time that its next parent does."""
    launcher = start(
        program=[sys.executable, "-c", LAUNCHER], until="was told"
    )  # as its first thread has ended
    launcher.kill()
    assert launcher.stdout.read() == "stop requests: 1\n"

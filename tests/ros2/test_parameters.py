"""Parameters given at the start and later: wrong ones are refused in one line, and none is left out silently."""

import gc
import signal
import sys
import traceback

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2: pip install 'dqcontrol[ros2]'")

from nodes import PATIENCE, read_until
from rclpy.exceptions import InvalidHandle
from rclpy.node import Node
from rclpy.parameter import Parameter

from dqcontrol.cli import main
from dqcontrol.errors import Error, ValueRangeError
from dqcontrol.ros2 import middleware
from dqcontrol.ros2.loading import load
from dqcontrol.ros2.tuning import check_stable


@pytest.fixture
def made():
    """Return what makes a node of ours with ROS arguments; it, or what is left of it, ends with the test, then ROS."""
    contexts, nodes = [], []

    def make(build, *arguments):
        contexts.append(middleware.ros(arguments))
        contexts[-1].__enter__()
        nodes.append(build())
        return nodes[-1]

    yield make
    for node in nodes:
        node.destroy_node()
    gc.collect()  # nodes whose construction failed: later, a thread of pytest's would end them beside others' start
    for context in contexts:
        context.__exit__(None, None, None)


@pytest.mark.parametrize("name", ["controller", "robot"])
def test_a_node_whose_construction_fails_has_left_ros(spec, made, name):
    left = []
    with pytest.raises(Error) as caught:
        made(lambda: {"controller": controller, "robot": robot}[name](spec()), "-p", "nothing:=3")
    for frame, _ in traceback.walk_tb(caught.tb):
        left += [one for one in frame.f_locals.values() if isinstance(one, Node)]
    assert left
    for one in left:
        with pytest.raises(InvalidHandle), one.handle:
            pass


def controller(path, **options):
    from dqcontrol.ros2.controller_node import ControllerNode

    return ControllerNode(path, autostart=True, **options)


def robot(path):
    from dqcontrol.ros2.robot_node import RobotNode

    return RobotNode(load(path))


@pytest.mark.parametrize(
    ("build", "given", "message"),
    [
        (controller, "linear_speed:=50.0", "parameter linear_speed: expected a number 0.001 … 2, got 50.0"),
        (controller, "law.gain:=.nan", "parameter law.gain: expected a number 0 … 1e+06, got nan"),
        (controller, "linear_speed:=fast", "parameter linear_speed: expected a number 0.001 … 2, got fast"),
        (controller, "linear_sped:=0.1", "unknown name 'linear_sped'; did you mean 'linear_speed'?"),
        (controller, "supervisor.aceleration:=1.0", "did you mean 'supervisor.acceleration'?"),
        (controller, "supervisor.velocity:=0.0", "supervisor.velocity: must be > 0, got 0"),
        (controller, "joint_names:=[a, b]", "joint_names: expected 7 names, got 2"),
        (controller, "joint_names:=3", "parameter joint_names: expected names, got 3"),
        (controller, "law.gain:=100000.0", "position unstable: k = 100000 1/s, limit 2007 1/s"),
        (controller, "allow_unstable:=3", "parameter allow_unstable: expected true or false, got 3"),
        (controller, "base_frame:=3", "parameter base_frame: expected a name, got 3"),
        (robot, "command_timeout:=9.0", "parameter command_timeout: expected a number 0.002 … 1, got 9.0"),
        (robot, "command_timeot:=0.1", "did you mean 'command_timeout'?"),
    ],
)
def test_wrong_ones_at_the_start_end_it_in_one_line(spec, made, build, given, message):
    with pytest.raises(Error) as caught:
        made(lambda: build(spec()), "-p", given)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_number_that_the_spec_does_not_have_counts_at_the_start_and_later(spec, made):
    """Of a supervisor's velocity the spec says nothing: the robot's own limits count."""
    given = ("supervisor.velocity:=0.2", "linear_speed:=1", "supervisor.payload.mass:=1.5")
    node = made(lambda: controller(spec()), *(word for one in given for word in ("-p", one)))
    loaded = node.following.loaded
    assert (loaded.supervisor.velocity, loaded.speeds.linear) == (0.2, 1.0)
    assert node.set_parameters([Parameter("supervisor.payload.center.z", value=-0.1)])[0].successful
    assert (loaded.payload.mass, tuple(loaded.payload.center)) == (1.5, (0.0, 0.0, -0.1))
    assert loaded.supervisor.jerk is None
    for name, value, success in (
        ("supervisor.jerk", 40, True),
        ("supervisor.jerk", "much", False),
        ("supervisor.jerk", -1.0, False),
        ("linear_speed", 2, True),
        ("linear_speed", None, False),
    ):
        (result,) = node.set_parameters([Parameter(name, value=value)])
        assert result.successful is success, name
    assert (loaded.supervisor.jerk, loaded.speeds.linear) == (40.0, 2.0)
    assert node.get_parameter("linear_speed").value == 2.0


def test_what_could_not_be_configured_may_be_mended_and_configured_again(spec, made):
    from dqcontrol.ros2.controller_node import ControllerNode

    given = ("-p", "law.gain:=-1.0", "-p", "joint_names:=[a, b, c, d, e, f, g]")
    node = made(lambda: ControllerNode(spec()), *given)
    for _ in range(2):
        with pytest.raises(Error, match=r"law\.gain: expected a number"):
            node.configure()
    node.set_parameters([Parameter("law.gain", value=7.0)])
    node.configure()
    (refused,) = node.set_parameters([Parameter("law.gain", value=1e6)])
    assert not refused.successful
    assert "position unstable: k = 1e+06 1/s" in refused.reason
    assert "largest recommended k" in refused.reason
    node.set_parameters([Parameter("allow_unstable", value=True)])
    (taken,) = node.set_parameters([Parameter("law.gain", value=1e6)])
    assert taken.successful
    node.set_parameters([Parameter("law.gain", value=7.0)])
    assert node.following.loaded.law.gain == 7.0


def test_a_law_that_cannot_be_judged_is_said_or_refused(spec, made, capfd):
    delayed = {"kind": "servo", "delay": "2 s"}
    made(lambda: controller(spec(plant=delayed)))
    assert (
        "law: proportional · servo: cannot be decided: plant and supervisor have a model of"
        in capfd.readouterr().err
    )
    law = {"kind": "published-linearization", "stiffness": 20.0, "damping": 9.0, "logarithm": "inertial"}
    loaded = load(spec(law=law))
    prepared = loaded.prepared_law("spec")
    assert check_stable(loaded, loaded.law, prepared, loaded.supervisor, moves=False) == ""
    with pytest.raises(ValueRangeError, match="its loop gains are unknown, so it may be changed only while"):
        check_stable(loaded, loaded.law, prepared, loaded.supervisor, moves=True)
    fast = load(spec(law={**law, "damping": 900.0}))
    with pytest.raises(ValueRangeError, match="unstable"):
        check_stable(fast, fast.law, fast.prepared_law("spec"), fast.supervisor, moves=False)


def refused(monkeypatch, capsys, *words):
    """Return what the command line says of its own words."""
    monkeypatch.setattr("sys.argv", ["dqcontrol", "ros2", *map(str, words)])
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    return said


@pytest.mark.parametrize("name", ["two words", "1st"])
def test_names_that_ros_does_not_allow(spec, monkeypatch, capsys, name):
    said = refused(monkeypatch, capsys, "controller", spec(), "--name", name)
    assert said.startswith("dqcontrol: ros2: Invalid node name: node name must not ")


def test_a_spec_that_is_not_there_is_said_at_once(tmp_path, monkeypatch, capsys):
    said = refused(monkeypatch, capsys, "controller", tmp_path / "none.yaml")
    assert "none.yaml: no such file" in said


def test_without_ros_one_line_says_what_to_install(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "rclpy", None)
    assert "pip install 'dqcontrol[ros2]'" in refused(monkeypatch, capsys, "robot", "x.yaml")


@pytest.mark.slow
def test_time_of_a_simulation_that_stands_still_stops_no_watch(spec, start):
    """Nobody publishes /clock: a robot that falls silent is noticed nevertheless, and Ctrl-C is heard."""
    path = spec(reference={"kind": "circle", "radius": 0.05, "duration": 60.0, "turns": 20})
    words = ("--autostart", "--", "-p", "use_sim_time:=true", "-p", "supervisor.stale_after:=0.5")
    waiting = start("controller", path, "--name", "waiting", *words, until="configured")
    robot = start("robot", path, "--", "-p", "use_sim_time:=true")
    read_until(waiting, "active")
    robot.kill()
    assert "measurement stale" in read_until(waiting, "stopped:")
    assert waiting.wait(PATIENCE) == 2
    idle = start("controller", path, "--", "-p", "use_sim_time:=true", until="unconfigured")
    idle.send_signal(signal.SIGINT)
    assert idle.wait(PATIENCE) in (0, 130), "130 before it spins"


def test_a_number_stays_when_another_one_changes(spec, node):
    from dqcontrol.ros2.controller_node import ControllerNode

    controller = ControllerNode(spec(), source="pose")
    controller.configure()
    for name, value in (("pose_timeout", 2.0), ("linear_speed", 0.2)):
        (done,) = controller.set_parameters([Parameter(name, value=value)])
        assert done.successful, done.reason
    following = controller.following
    assert following
    assert following.target.timeout == 2.0
    controller.destroy_node()

"""A run as one goal of FollowJointTrajectory, to an arm in this process that offers that action and no more."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import built_messages
import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline

import dqcontrol as dqc
from dqcontrol.errors import MissingExtraError, ShapeError, ValueRangeError
from dqcontrol.experiments import load_run

START = [0, 0.6, 0, 1.6, 0, 0.6, 0]
SPEC = {
    "name": "sent", "robot": "iiwa7", "start": START, "period": 0.02,
    "reference": {"kind": "circle", "radius": 0.05, "duration": 2.0, "ramp": 0.5},
    "law": {"kind": "proportional-feedforward", "gain": 5}, "plant": {"kind": "servo"},
}  # fmt: skip
ACTION = "/arm/follow"


@pytest.fixture(scope="module")
def control_msgs(tmp_path_factory, domain):
    """The package, importable here and in processes that a test starts."""
    if not built_messages.is_possible():
        pytest.skip("control_msgs is in no wheel, and no compiler is there to build it")
    folder = tmp_path_factory.mktemp("messages")
    with pytest.MonkeyPatch.context() as patch:
        environment = {**os.environ, "AMENT_PREFIX_PATH": sys.prefix}
        build = [sys.executable, built_messages.__file__, str(folder)]
        subprocess.run(build, check=True, env=environment, capture_output=True, timeout=240)
        patch.syspath_prepend(folder)
        inherited = os.environ.get("PYTHONPATH", "")
        patch.setenv("PYTHONPATH", os.pathsep.join(filter(None, [str(folder), inherited])))
        yield folder
    for name in [name for name in sys.modules if name.partition(".")[0] == "control_msgs"]:
        del sys.modules[name]  # it is not all of the package


@pytest.fixture(scope="module")
def run_folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs") / "run"
    dqc.run(SPEC).save(folder, figures=False)
    return folder


class Arm:
    """Goes along the points as fast as it is asked to, or as the test says; knows how it was asked."""

    def __init__(self, node, q, pace=0.01):
        from control_msgs.action import FollowJointTrajectory
        from rclpy.action import ActionServer, CancelResponse, GoalResponse
        from rclpy.task import Future
        from sensor_msgs.msg import JointState

        self.names = [f"A{i}" for i in range(1, 8)]
        self.kind, self.q, self.goals, self.fails, self.accepts = (
            FollowJointTrajectory,
            np.array(q),
            [],
            0,
            True,
        )
        self.future, self.states = Future, node.create_publisher(JointState, "/joint_states", 1)
        self.node, self.pace, self.is_canceled = node, pace, False
        node.create_timer(0.01, self.tell)
        self.server = ActionServer(
            node, FollowJointTrajectory, ACTION, self.execute,
            goal_callback=lambda _: GoalResponse.ACCEPT if self.accepts else GoalResponse.REJECT,
            cancel_callback=lambda _: CancelResponse.ACCEPT,
        )  # fmt: skip

    def tell(self):
        from sensor_msgs.msg import JointState

        self.states.publish(JointState(name=self.names, position=self.q.tolist()))

    async def execute(self, handle):
        goal, result = handle.request, self.kind.Result()
        self.goals.append(goal)
        for point in goal.trajectory.points:
            await self.waited()
            if handle.is_cancel_requested:
                self.is_canceled = True
                handle.canceled()
                return result
            self.q = np.array(point.positions)
            if self.fails and len(self.goals[-1].trajectory.points) > 1:
                result.error_code, result.error_string = self.fails, "joint A2 is held"
                handle.abort()
                return result
        handle.succeed()
        return result

    async def waited(self):
        done = self.future()
        timer = self.node.create_timer(self.pace, lambda: done.done() or done.set_result(None))
        await done
        self.node.destroy_timer(timer)


@pytest.fixture
def arm_at(control_msgs, node):
    """What makes an arm that stands somewhere."""
    made = []

    def make(q, **options):
        made.append(Arm(node, q, **options))
        return made[0]

    yield make
    made[0].server.destroy()


def sent(start, run, *words, until=None):
    own = [f"joint_names:=[{', '.join(f'A{i}' for i in range(1, 8))}]"]
    return start("send", run, "--action", ACTION, "--", "-p", *own, *words, until=until)


def ended(node, process):
    assert node.serve(lambda: process.poll() is not None)
    return process.returncode, process.stdout.read()


@pytest.mark.slow  # builds the package of messages
def test_a_run_is_one_goal_that_the_arm_follows(arm_at, run_folder, node, start):
    arm, record = arm_at(START), load_run(run_folder).record
    code, said = ended(node, sent(start, run_folder, "-p", "tolerance:=0.05"))
    assert code == 0, said
    assert f"done: {len(record) + 1} points in 2." in said  # of the run, and one where it has braked
    (goal,) = arm.goals
    points = goal.trajectory.points
    assert goal.trajectory.joint_names == arm.names
    q, rates = (
        np.array([list(getattr(each, name)) for each in points]) for name in ("positions", "velocities")
    )
    time = np.array([point.time_from_start.sec + 1e-9 * point.time_from_start.nanosec for point in points])
    np.testing.assert_array_equal(q[:-1], record.q)
    np.testing.assert_allclose(time[:-1], record.time, atol=1e-9)
    assert (rates[[0, -1]] == 0).all()
    # Cubic pieces through positions and velocities, as a controller lays them: evenly braked at 1 rad/s² at last.
    pieces = CubicHermiteSpline(time, q, rates)
    assert np.abs(pieces(time[1:-2] + 0.01) - (q[1:-2] + q[2:-1]) / 2).max() < 1e-4
    braking = pieces(np.linspace(time[-2], time[-1], 20)[:-1], 2)
    np.testing.assert_allclose(braking, np.tile(-rates[-2] / (time[-1] - time[-2]), (19, 1)), atol=1e-6)
    assert np.abs(braking).max() == pytest.approx(1.0, abs=1e-6)
    assert {bound.position for bound in [*goal.path_tolerance, *goal.goal_tolerance]} == {0.05}
    np.testing.assert_array_equal(arm.q, q[-1])


@pytest.mark.slow
def test_an_arm_that_stands_elsewhere_gets_no_goal(arm_at, run_folder, node, start):
    arm = arm_at(np.add(START, [0, 0, 0, 0.02, 0, 0, 0]))
    code, said = ended(node, sent(start, run_folder))
    assert (code, arm.goals) == (2, [])
    assert "A4 is at 1.62, 0.02 rad or m from where the run starts; at most 0.01 is allowed" in said


@pytest.mark.slow
@pytest.mark.parametrize(
    ("accepts", "fails", "words"),
    [(False, 0, "/arm/follow refused the goal"), (True, -4, "path tolerance violated: joint A2 is held")],
)
def test_what_an_arm_says_is_said(arm_at, run_folder, node, start, accepts, fails, words):
    arm = arm_at(START)
    arm.accepts, arm.fails = accepts, fails
    code, said = ended(node, sent(start, run_folder))
    assert (code, words in said) == (2, True), said


@pytest.mark.slow
def test_an_interrupt_cancels_the_motion(arm_at, run_folder, node, start):
    arm = arm_at(START, pace=0.2)
    process = sent(start, run_folder)
    assert node.serve(lambda: np.abs(arm.q - START).max() > 0)
    process.send_signal(signal.SIGINT)
    code, said = ended(node, process)
    assert (code, "canceled" in said, arm.is_canceled) == (2, True, True), said
    assert len(arm.goals) == 1


@pytest.mark.slow
def test_nobody_there_is_said(control_msgs, run_folder, start):
    process = sent(start, run_folder)
    assert "nobody offers action /arm/follow" in process.communicate(timeout=120)[0]
    assert process.returncode == 2


def test_motions_that_no_arm_can_follow_are_refused(run_folder):
    pytest.importorskip("rclpy")
    from dqcontrol.ros2.trajectory_goal import trajectory_of

    moving = dqc.run({**SPEC, "reference": {"kind": "circle", "radius": 0.05, "duration": 2.0}})
    with pytest.raises(ValueRangeError, match=r"starts on the way, a joint at .* give its reference a ramp"):
        trajectory_of(moving, ["A"] * 7)
    base = dqc.run(Path(__file__).parents[2] / "examples/mobile.yaml")
    with pytest.raises(ShapeError, match="is no arm alone"):
        trajectory_of(base, ["A"] * 7)


def test_without_the_package_a_line_says_where_it_is(run_folder, monkeypatch):
    pytest.importorskip("rclpy")
    from dqcontrol.ros2 import trajectory_goal

    monkeypatch.setitem(sys.modules, "control_msgs.action", None)
    with pytest.raises(MissingExtraError, match=r"cannot import control_msgs .* source a ROS 2 installation"):
        trajectory_goal.TrajectoryGoal(load_run(run_folder))

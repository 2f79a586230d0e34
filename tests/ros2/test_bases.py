"""Mobile bases over ROS 2: velocities out, odometry in; what is wrong with it is refused, and stops the robot."""

import signal
import time

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="needs ROS 2: pip install 'dqcontrol[ros2]'")

from forks import Forks
from geometry_msgs.msg import TransformStamped, Twist, TwistStamped
from nav_msgs.msg import Odometry
from nodes import UNHURRIED
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

import dqcontrol as dqc
from dqcontrol.errors import Error, ShapeError, ValueRangeError
from dqcontrol.experiments import load_run
from dqcontrol.loop.control import Phase
from dqcontrol.ros2 import controller_node, localisation as localisation_module, messages
from dqcontrol.ros2.controller_node import ControllerNode
from dqcontrol.ros2.interfaces import BASE_COMMANDS, base_port
from dqcontrol.ros2.loading import RobotParts, load
from dqcontrol.ros2.messages import NANOSECONDS, stamp_of
from dqcontrol.ros2.robot_node import RobotNode
from dqcontrol_theses.silva2017.whole_body_graph import graph_spec

START = [0.2, -0.1, 0.4, 0, -0.9, 0.9, 0.9, 0]
JOHN = dqc.load_robot("little-john")
DRIVEN = {
    "robot": "little-john",
    "start": START,
    "period": 0.02,
    "reference": {"kind": "set-point", "offset": {"translation": [0.3, 0.05, 0.0]}},
    "duration": 60.0,
    "law": {"kind": "feedback-linearization", "stiffness": 2.0, "damping": 2.0},
    "plant": {"kind": "integrator"},
}
CART = """
name: cart
angles: radians
parts:
  - {kind: differential-drive, wheel_radius: 0.05, half_track: 0.15, rim_speed: 0.6, displacement: 0.1}
"""


def patient(controller, **others):
    values = {**UNHURRIED, "odometry_timeout": 2.0, "start_tolerance": 3.0, **others}
    for name, value in values.items():
        (done,) = controller.set_parameters([Parameter(name, value=value)])
        assert done.successful, done.reason


@pytest.fixture
def pair(spec, node):
    """Return what makes a configured controller and a robot in this process."""

    def make(robot="little-john", base_interface="twist", source="spec", **changes):
        path = spec(**{**DRIVEN, "robot": robot, **changes})
        made = RobotNode(load(path), base_interface=base_interface)
        node.host(made)
        controller = ControllerNode(path, source=source, base_interface=base_interface)
        controller.configure()
        patient(controller)
        node.host(controller)
        return controller, made

    return make


def activated(node, controller):
    def tries():
        try:
            controller.following.activate()
        except Error:
            return False
        return True

    assert node.serve(tries)


@pytest.mark.parametrize(
    "base_interface",
    ["twist", *(pytest.param(each, marks=pytest.mark.slow) for each in BASE_COMMANDS if each != "twist")],
)
def test_arm_and_base_go_where_the_hand_is_to_be(pair, node, base_interface):
    controller, robot = pair(base_interface=base_interface)
    activated(node, controller)
    goal = controller.following.loaded.case.scene.samples[-1, :8]
    far = np.linalg.norm(dqc.algebra.translation(JOHN.fkm(START)) - dqc.algebra.translation(goal))
    heard = []
    topic, kind = BASE_COMMANDS[base_interface]
    node.create_subscription(kind, topic, heard.append, 1)
    assert far > 0.25

    def is_near():
        hand = dqc.algebra.translation(JOHN.fkm(robot._plant.q))
        return np.linalg.norm(hand - dqc.algebra.translation(goal)) < 0.8 * far

    assert node.serve(is_near), controller.outcome
    assert controller.phase is Phase.ACTIVE
    np.testing.assert_allclose(controller.following.control.measured, robot._plant.measured, atol=0.05)
    assert heard


def test_a_base_without_an_arm_follows_its_odometry_alone(pair, node, tmp_path):
    (tmp_path / "cart.yaml").write_text(CART)
    controller, robot = pair(
        robot=str(tmp_path / "cart.yaml"),
        start=[0.0, 0.0, 0.3],
        law={"kind": "proportional", "gain": 1.0},
        limits={"velocity": True},
        supervisor={"slow_below": 0.0, "hold_below": 0.0},
    )
    assert robot._joint_states is None
    activated(node, controller)
    assert node.serve(lambda: robot._plant.q[0] > 0.05), controller.outcome
    assert "last odometry" in controller.following.last_heard
    assert "joint states" not in controller.following.last_heard


def transforms():
    """Return topic and type of transforms here: tf's, or ours."""
    return messages.transform_topic(messages.BASE_TRANSFORM)


class Spoken:
    """Says of a robot that stands still where it is, and what else it is told to say."""

    def __init__(self, node):
        self.place, self.frame, self.ahead = list(START[:3]), "odom", 0.0
        self.deviation, self.is_silent, self.turn = 0.0, False, None
        self.correction: list[float] = []  # of odometry in a map: x, y, heading
        self._node = node
        self._states = node.create_publisher(JointState, "/joint_states", 1)
        self._odometry = node.create_publisher(Odometry, "/odom", 1)
        topic, kind = transforms()
        self._say = node.create_publisher(kind, topic, 1)
        for topic, kind in (
            ("/cmd_vel", Twist),
            ("/forward_velocity_controller/commands", Float64MultiArray),
        ):
            node.create_subscription(kind, topic, lambda _: None, 1)
        node.create_timer(0.02, self.speak)

    def speak(self):
        now = time.time_ns()
        states = JointState(name=list(JOHN.joint_names[3:]), position=START[3:])
        stamp_of(now, states.header.stamp)
        self._states.publish(states)
        if self.is_silent:
            return
        odometry = Odometry()
        odometry.header.frame_id = self.frame
        stamp_of(now + round(self.ahead * NANOSECONDS), odometry.header.stamp)
        pose = odometry.pose.pose
        pose.position.x, pose.position.y = self.place[:2]
        pose.orientation.w, pose.orientation.z = np.cos(self.place[2] / 2), np.sin(self.place[2] / 2)
        if self.turn is not None:
            pose.orientation.w, pose.orientation.x = np.cos(self.turn / 2), np.sin(self.turn / 2)
            pose.orientation.z = 0.0
        odometry.pose.covariance[0] = self.deviation**2
        self._odometry.publish(odometry)
        if self.correction:
            self.say_correction()

    def say_correction(self):
        message = TransformStamped(child_frame_id="odom")
        message.header.frame_id = "map"
        stamp_of(time.time_ns() + NANOSECONDS, message.header.stamp)  # as AMCL does: it counts until then
        x, y, heading = self.correction
        place, turn = message.transform.translation, message.transform.rotation
        place.x, place.y, turn.w, turn.z = x, y, np.cos(heading / 2), np.sin(heading / 2)
        kind = transforms()[1]
        self._say.publish(message if kind is TransformStamped else kind(transforms=[message]))


def last_refused(diagnostics):
    return diagnostics.get("/dqcontrol", ("", {}))[1].get("last refused", "")


def test_odometry_that_cannot_be_right_is_refused_and_the_robot_stopped(spec, node, diagnostics):
    said = Spoken(node)
    controller = ControllerNode(spec(**DRIVEN), source="twist")
    controller.configure()
    patient(controller, **{"supervisor.overspeed": 1.5})
    node.host(controller)
    following = controller.following
    assert following is not None
    assert following._localisation is not None
    localisation = following._localisation

    def starts():
        said.__dict__.update(
            place=list(START[:3]), frame="odom", ahead=0.0, deviation=0.0, is_silent=False, turn=None
        )
        if controller.phase is Phase.STOPPED:
            following.control.reset()
            following.let_go()
        controller.set_parameters([Parameter("odometry_timeout", value=2.0)])
        assert node.serve(lambda: localisation.pose[0] == START[0])
        activated(node, controller)

    for field, value, why in (
        ("frame", "map", "odometry: unknown frame 'map' (allowed: odom)"),
        ("ahead", 3.0, "odometry: its stamp is 3 s ahead of its clock"),
        ("deviation", 0.8, "odometry: its standard deviation is 0.8 m; odometry_deviation is 0.5"),
        ("turn", 1.0, "odometry: the base is tilted by 57.3°; at most 20° are a plane"),
        ("place", [np.nan, 0.0, 0.0], "odometry: position: number 1 is not finite"),
        ("is_silent", True, ""),
    ):
        starts()
        assert following.control.measured[0] == START[0]
        setattr(said, field, value)
        assert node.serve(lambda why=why: last_refused(diagnostics).startswith(why)), why
        controller.set_parameters([Parameter("odometry_timeout", value=0.01)])  # the time has come
        assert node.serve(lambda: controller.phase is Phase.STOPPED), why
        assert controller.outcome == "stop category 1: measurement stale or impossible"
        np.testing.assert_array_equal(following.control.measured[:3], START[:3])
    starts()
    said.place[0] += 3.0
    assert node.serve(lambda: controller.phase is Phase.STOPPED)
    assert controller.outcome == "stop category 1: measured base jumped"
    starts()
    said.place[2] += 2 * np.pi  # the same heading
    node.serve(seconds=0.2)
    assert controller.phase is Phase.ACTIVE


@pytest.mark.slow
def test_the_correction_of_a_localisation_is_heard_and_its_jumps_and_silence_stop(spec, node, diagnostics):
    """The base is where map → odom and odom → base_link together say, whatever odometry's own deviation."""
    said = Spoken(node)
    controller = ControllerNode(spec(**DRIVEN), source="twist")
    for name, frame in (("base_frame", "map"), ("odometry_frame", "odom")):
        controller.declare_parameter(name, frame)
    controller.configure()
    patient(controller, correction_timeout=60.0, **{"supervisor.overspeed": 1.5})
    node.host(controller)
    following = controller.following
    assert following is not None
    localisation = following._localisation
    assert localisation is not None
    missing = f"no transform map → odom on {transforms()[0]}"
    why = f"odometry: {missing}, which corrects it"
    assert node.serve(lambda: last_refused(diagnostics) == why)
    assert localisation.silence == missing
    turn, shift = 0.7, np.array([0.3, -0.5])
    c, s = np.cos(turn), np.sin(turn)
    x, y, heading = START[:3]
    said.place = [
        c * (x - shift[0]) + s * (y - shift[1]),
        c * (y - shift[1]) - s * (x - shift[0]),
        heading - turn,
    ]
    said.deviation, said.correction = 5.0, [*shift, turn]
    assert node.serve(lambda: np.allclose(localisation.pose, START[:3], atol=1e-12))
    activated(node, controller)
    said.correction[0] += 0.05  # a small one is driven with
    assert node.serve(lambda: abs(localisation.pose[0] - START[0] - 0.05) < 1e-9)
    assert "jumped" not in controller.outcome
    outcomes = []
    while "stop category 1: measured base jumped" not in outcomes:
        said.correction[0] += 3.0
        assert node.serve(lambda: controller.phase is Phase.STOPPED)
        outcomes.append(controller.outcome)  # or, on a busy machine, that it was silent just then
        assert len(outcomes) < 5, outcomes
        said.correction[0] -= 3.0
        assert node.serve(lambda: abs(localisation.pose[0] - START[0] - 0.05) < 1e-9)
        following.control.reset()
        following.let_go()
        activated(node, controller)
    said.correction = []
    controller.set_parameters([Parameter("correction_timeout", value=0.05)])  # the time has come
    assert node.serve(lambda: controller.phase is Phase.STOPPED)
    assert controller.outcome == "stop category 1: measurement stale or impossible"


class Later:
    """A clock that can be set on."""

    def __init__(self):
        self.by = 0.0

    def monotonic(self):
        return time.monotonic() + self.by


@pytest.mark.parametrize("stale_after", [None, 0.3])
def test_a_base_rolls_on_without_messages_for_as_long_as_somebody_says(spec, node, monkeypatch, stale_after):
    """Nothing comes for 0.15 s, which stops it by itself, and then for 0.4 s, which is too long for both."""
    clock = Later()
    for module in (controller_node, localisation_module):
        monkeypatch.setattr(module, "time", clock)
    Spoken(node)
    controller = ControllerNode(spec(**DRIVEN, supervisor={"stale_after": stale_after}), source="twist")
    controller.configure()
    following = controller.following
    assert following is not None
    assert following.loaded.longest_advance == (stale_after or 0.05)
    node.host(controller)
    activated(node, controller)
    assert following._latest is not None
    begun = following._latest[0]

    def goes_without_messages_until(seconds):
        clock.by += begun + seconds - clock.monotonic()
        for _ in range(3):  # of a process that has slept the first look does nothing
            following._watch()
            clock.by += 0.02

    goes_without_messages_until(0.15)
    assert (controller.phase is Phase.ACTIVE) == (stale_after is not None)
    goes_without_messages_until(0.4)
    assert controller.phase in (Phase.STOPPING, Phase.STOPPED)
    assert "measurement stale" in following.control.reason


@pytest.mark.slow
def test_odometry_that_drifts_says_how_much(spec, node):
    robot = RobotNode(load(spec(**DRIVEN)))
    node.host(robot)
    for name, value in (("way", 0.05), ("heading_by_way", 0.02)):
        (done,) = robot.set_parameters([Parameter(f"odometry_drift.{name}", value=value)])
        assert done.successful
    velocities = node.create_publisher(Twist, "/cmd_vel", 1)
    heard = []
    node.create_subscription(Odometry, "/odom", heard.append, 10)
    ahead = Twist()
    ahead.linear.x = 0.4
    assert node.publish(velocities, ahead, lambda: np.linalg.norm(robot._plant.q[:2] - START[:2]) > 0.3)
    assert node.serve(lambda: heard and heard[-1].twist.twist.linear.x == 0.0)
    place, covariance = heard[-1].pose.pose.position, np.reshape(heard[-1].pose.covariance, (6, 6))
    way = np.linalg.norm(robot._plant.q[:2] - START[:2])
    along = np.array([np.cos(START[2]), np.sin(START[2])])
    assert along @ covariance[:2, :2] @ along == pytest.approx(0.05**2 * way, rel=0.1)
    assert covariance[5, 5] == pytest.approx(0.02**2 * way, rel=1e-6)
    off = np.linalg.norm([place.x - robot._plant.q[0], place.y - robot._plant.q[1]])
    assert 0.0 < off < 6 * 0.05 * np.sqrt(way)


@pytest.mark.slow
def test_a_base_brakes_before_a_keep_out_zone(pair, node):
    """The hand is asked for what stands behind a column; the robot's own limits know nothing of it."""
    ahead = {"kind": "set-point", "offset": {"translation": [0.9, 0.35, 0.0]}}
    column = {"cylinder": [0.1, 1], "position": [0.85, 0.17, 0.5]}
    zones = {"keep_out": {"footprint": 0.15, "margin": 0.05}}
    controller, robot = pair(
        reference=ahead, world={"column": column}, supervisor={**zones, "acceleration": 2.0}
    )
    activated(node, controller)
    supervisor, least = controller.following.control.supervisor, [1.0]

    def is_braked():
        least[0] = min(least[0], float(np.linalg.norm(robot._plant.q[:2] - column["position"][:2])) - 0.1)
        return "keep-out zone" in reasons(controller.following.control)

    def reasons(control):
        return supervisor.reasons(control._state)

    assert node.serve(is_braked), controller.outcome
    node.serve(lambda: is_braked() and False, seconds=1.0)
    assert least[0] > 0.15
    assert controller.phase is Phase.ACTIVE


def test_a_robot_s_base_brakes_without_commands_and_its_arm_goes_on(spec, node, diagnostics):
    robot = RobotNode(load(spec(**DRIVEN)))
    node.host(robot)
    velocities = node.create_publisher(Twist, "/cmd_vel", 1)
    odometry = []
    node.create_subscription(Odometry, "/odom", odometry.append, 1)
    ahead = Twist()
    ahead.linear.x = 9.0  # beyond what its rims can do
    assert node.publish(velocities, ahead, lambda: odometry and odometry[-1].twist.twist.linear.x > 0.45)
    assert max(m.twist.twist.linear.x for m in odometry) <= 0.5 * (1 + 1e-6)
    assert "joints: no commands" in robot._condition()[1]
    assert node.serve(lambda: odometry[-1].twist.twist.linear.x == 0.0)
    place = odometry[-1].pose.pose
    assert 2 * np.arctan2(place.orientation.z, place.orientation.w) == pytest.approx(START[2])
    moved = np.array([place.position.x, place.position.y]) - START[:2]
    assert moved @ [-np.sin(START[2]), np.cos(START[2])] == pytest.approx(0.0, abs=1e-9)
    sideways = Twist()
    sideways.linear.y = 0.1
    why = "cmd_vel: linear.y: the base cannot move so; expected 0, got 0.1"
    refused = lambda: diagnostics.get("/robot", ("", {}))[1].get("last refused", "") == why  # noqa: E731
    assert node.publish(velocities, sideways, refused)
    (tell,) = [robot._obeyed["joints"]]
    tell.asked, tell._heard = np.full(5, 0.2), np.inf
    before = robot._plant.q.copy()
    assert node.serve(lambda: robot._plant.q[3] > before[3] + 0.02)
    np.testing.assert_array_equal(robot._plant.q[:3], before[:3])


def test_the_transform_of_a_base_is_its_odometry(spec, node):
    robot = RobotNode(load(spec(**DRIVEN)))
    node.host(robot)
    odometry, heard = [], []
    node.create_subscription(Odometry, "/odom", odometry.append, 10)
    topic, kind = transforms()
    node.create_subscription(kind, topic, lambda m: heard.append(getattr(m, "transforms", [m])[0]), 10)
    assert node.serve(lambda: odometry and heard)
    transform, place = heard[-1], odometry[-1].pose.pose
    assert (transform.header.frame_id, transform.child_frame_id) == ("odom", "base_link")
    assert (transform.transform.translation.x, transform.transform.translation.y) == (
        place.position.x,
        place.position.y,
    )
    assert transform.transform.rotation == place.orientation


def test_a_navigation_stack_drives_there_and_hands_over(pair, node):
    """A double of one publishes on /cmd_vel; the whole body waits until it has let go of the topic."""
    controller, robot = pair()
    stack = node.create_publisher(Twist, "/cmd_vel", 1)
    ahead = Twist()
    ahead.linear.x = 0.3
    begun = robot._plant.q[:2].copy()
    assert node.publish(stack, ahead, lambda: np.linalg.norm(robot._plant.q[:2] - begun) > 0.05)
    assert node.serve(lambda: controller.following.age < 1.0)
    with pytest.raises(Error, match="publishes on /cmd_vel too"):
        controller.following.activate()
    node.destroy_publisher(stack)
    activated(node, controller)
    assert controller.phase is Phase.ACTIVE
    arm = robot._plant.q[3:].copy()
    assert node.serve(lambda: np.abs(robot._plant.q[3:] - arm).max() > 1e-3), controller.outcome


class Clocked:
    """A node of which only the clock is asked."""

    def get_clock(self):
        return self

    def now(self):
        return self

    def to_msg(self):
        return TwistStamped().header.stamp


@pytest.mark.parametrize("name", ["little-john", "youbot"])
@pytest.mark.parametrize("form", ["constrained", "unconstrained"])
def test_what_is_sent_moves_the_base_as_the_inputs_do(name, form):
    body = dqc.load_robot(name).in_form(form)
    parts, rng = RobotParts(body), np.random.default_rng(5)
    port = base_port(parts, "twist", Clocked(), "base_link")
    for _ in range(20):
        q, u = rng.uniform(-2, 2, body.configuration_size), rng.uniform(-1, 1, body.input_size)
        driven = parts.followed(q, u)
        twist = port.message(driven, driven, q)
        moved = parts.driven.integrate(q, driven, 1e-6)
        c, s = np.cos(q[2]), np.sin(q[2])
        rate = (moved - q)[:3] / 1e-6
        sent = [twist.linear.x, twist.linear.y, twist.angular.z]
        np.testing.assert_allclose(
            sent, [c * rate[0] + s * rate[1], c * rate[1] - s * rate[0], rate[2]], atol=1e-5
        )
        asked = np.array([twist.linear.x, twist.linear.y, twist.angular.z])
        np.testing.assert_allclose(parts.base_rates(q, asked), driven[parts.base_inputs], atol=1e-12)


def test_wheels_on_rollers_are_commanded_one_by_one(spec):
    base = dqc.MecanumBase(wheel_radius=0.05, half_track=0.15, half_wheelbase=0.25, rim_speed=0.8)
    parts, rng = RobotParts(dqc.WholeBody([base])), np.random.default_rng(7)
    port = base_port(parts, "wheels", Clocked(), "base_link")
    for _ in range(5):
        q, u = rng.uniform(-2, 2, (2, 3))
        speeds = port.message(u, u, q).data
        assert len(speeds) == 4
        np.testing.assert_allclose(parts.base_rates(q, base.from_wheel_speeds(speeds)), u, atol=1e-12)


def test_what_has_no_topics_is_refused_in_a_line(spec, node):
    youbot = dict(DRIVEN, robot="youbot", start=[0, 0, 0, 0.1, 0.5, -0.5, 0.5, 0.1])
    with pytest.raises(
        ValueRangeError, match="'wheels' needs a differential drive, mecanum or omni wheels; youbot has none"
    ):
        RobotNode(load(spec(**youbot)), base_interface="wheels")
    two = dqc.WholeBody([dqc.HolonomicBase(), dqc.HolonomicBase()], name="two")
    with pytest.raises(ShapeError, match="two has 2 mobile bases; ROS 2 tells of one"):
        RobotParts(two)


SOON = 0.1  # s, in which wheels are to stand when the other process is killed
TRIALS = 3


class CountedBase(RobotNode):
    """Keeps of each of its periods the time of the command that it obeyed, and whether the wheels rolled.

    Those that a busy machine had kept for later, and that it makes up for at once, are marked.
    """

    def __init__(self, loaded):
        self.periods, self._late = [], False
        super().__init__(loaded)

    def _move(self):
        super()._move()
        rolled = np.abs(self._plant.q[:3] - self._was[:3]).max() > 1e-9
        self.periods.append((self._obeyed["base"]._heard, rolled, self._late))
        self._late = True

    def _tick(self):
        self._late = False
        super()._tick()


@pytest.mark.slow
def test_wheels_stand_within_100_ms_of_the_last_command_of_a_killed_controller(node, spec, tmp_path):
    """By the robot's own periods, so whatever else a machine does: it rolls two of 50 ms at most."""
    path = spec(**graph_spec("ours", "ideal"))
    loaded = load(path)
    with Forks(path, tmp_path) as forks:
        for _ in range(TRIALS):
            robot = CountedBase(loaded)
            node.host(robot)
            child = forks.start(("controller", path, "--autostart"), False)
            assert node.serve(lambda: sum(rolled for _, rolled, _ in robot.periods) > 5), forks.log  # noqa: B023
            forks.kill(child, signal.SIGKILL)
            node.serve(seconds=0.5)
            forks.end(child)
            last = robot._obeyed["base"]._heard
            after = [rolled and not late for heard, rolled, late in robot.periods if heard == last]
            assert not robot.periods[-1][1]
            rolling = loaded.period * sum(after)
            print(f"controller killed: the wheels roll for {1e3 * rolling:.0f} ms after its last command")
            assert rolling <= SOON + 1e-9
            node.unhost(robot)
            assert node.serve(
                lambda: not node.count_publishers("/cmd_vel")
            )  # who was killed counts for a while


class CountedController(ControllerNode):
    """Keeps of each of its steps when it was due at the latest, whether it had a measurement, and the base's rates."""

    def configure(self):
        super().configure()
        self.steps, following = [], self.following
        assert following is not None
        step = following._step

        def counted(passed, measured, now):
            step(passed, measured, now)
            rate = np.abs(following.control.rate[:2]).max()
            self.steps.append((measured is not None, rate, following._due - time.monotonic()))

        following._step = counted


@pytest.mark.slow
def test_wheels_are_told_to_stand_within_100_ms_of_the_last_word_of_a_killed_robot(node, spec, tmp_path):
    """Its first step without a word tells the wheels to stand, and is due within 100 ms of the last word."""
    path = spec(**graph_spec("ours", "ideal"))
    controller = CountedController(path)
    controller.configure()
    node.host(controller)
    following = controller.following
    assert following is not None

    def is_rolling():
        if controller.phase is Phase.STOPPED:
            following.control.reset()
            following.let_go()
        if controller.phase is Phase.INACTIVE:
            try:
                following.activate()
            except Error:
                return False
            controller.steps.clear()
        return len(controller.steps) > 5 and controller.steps[-1][1] > 0.05

    with Forks(path, tmp_path) as forks:
        for _ in range(TRIALS):
            child = forks.start(("robot", path), False)
            assert node.serve(is_rolling), forks.log
            forks.kill(child, signal.SIGKILL)
            assert node.serve(lambda: controller.phase is Phase.STOPPED)
            forks.end(child)
            last = max(k for k, (heard, *_) in enumerate(controller.steps) if heard)
            assert not any(rate for _, rate, _ in controller.steps[last + 1 :])
            due = controller.steps[last][2]
            print(f"robot killed: the step that tells the wheels to stand is due {1e3 * due:.0f} ms later")
            assert due <= SOON


@pytest.mark.slow
def test_the_graph_of_silva_drives_and_ends_when_it_is_asked_to(start, node):
    launch = start("silva2017", until="whole_body_controller]: active")
    speeds = []
    node.create_subscription(Odometry, "/odom", lambda m: speeds.append(m.twist.twist.linear.x), 1)
    assert node.serve(lambda: speeds and abs(speeds[-1]) > 0.02)
    assert {"little_john", "whole_body_controller"} <= set(node.get_node_names())
    launch.terminate()
    assert launch.wait() == 0
    assert "Traceback" not in launch.stdout.read()


TIAGO = """
name: tiago
angles: radians
parts:
  - {kind: mobile-robot, robot: "example-robot-data:tiago_description/robots/tiago_no_hand.urdf"}
"""
UNRUSHED = {"stale_after": 1.0, "frozen_after": 1.0}  # what a busy machine delays is not judged here
CIRCLE = {"kind": "circle", "radius": 0.1, "duration": 8.0}
ALWAYS = ("--", "-p", "command_timeout:=1.0")  # the robot's own watch, as patient as the controller's


@pytest.mark.slow
@pytest.mark.parametrize("robot", ["little-john", "tiago"])
def test_two_processes_follow_a_circle_as_well_as_one(robot, start, spec, tmp_path):
    """little-john at 20 Hz and TIAGo at 100 Hz, the base by odometry: mean error of the hand within 10 %."""
    changes = {**DRIVEN, "period": 0.05, "plant": {"kind": "servo"}, "supervisor": UNRUSHED}
    changes |= {"reference": CIRCLE, "duration": CIRCLE["duration"]}
    if robot == "tiago":
        (tmp_path / "tiago.yaml").write_text(TIAGO)
        home = [0.0, 0.0, 0.0, 0.17, 1.0, -0.3, -1.0, 1.0, 0.0, 0.3, 0.0]
        changes |= {"robot": str(tmp_path / "tiago.yaml"), "start": home, "period": 0.01}
    path = spec(**changes)
    alone = dqc.run(path).record
    start("robot", path, *ALWAYS)
    out = tmp_path / "out"
    controller = start("controller", path, "--autostart", "--out", out)
    said, _ = controller.communicate()
    assert controller.returncode == 0, said
    together = load_run(out).record
    mean = []
    for record in (alone, together):
        error = np.linalg.norm(record.position - record.desired_position, axis=1)
        assert record.time[-1] > CIRCLE["duration"] - 0.2
        mean.append(float(error[record.time <= CIRCLE["duration"]].mean()))
    print(
        f"{robot}: mean error of the hand {1e3 * mean[0]:.2f} mm in one process, {1e3 * mean[1]:.2f} mm in two"
    )
    assert mean[1] == pytest.approx(mean[0], rel=0.1)

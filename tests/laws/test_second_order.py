"""Feed-forward of second order: what it adds, how the error falls with the period, and what it leaves alone."""

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.errors import Error
from dqcontrol.laws import (
    HInfinityTracking,
    LinearQuadraticDQ,
    ProportionalFeedforward,
)
from dqcontrol.references import Circle, Previewed
from dqcontrol.robots import PoseTask

PANDA = np.array([0, -0.6, 0, -2.2, 0, 1.6, 0.8])
UR5 = np.array([0, -1.2, 1.5, -1.2, -1.5, 0.3])
BASE = np.array([0.2, -0.1, 0.4, 0.3, -0.8, 1.2, 0.6, 0.4])  # little-john
TURN = 2 * np.pi  # s, of a circle at 1 rad/s
LAWS = {
    "K+FF": lambda **more: ProportionalFeedforward(gain=10.0, **more),
    "K+FF with an integral": lambda **more: ProportionalFeedforward(gain=10.0, integral_gain=5.0, **more),
    "HIRT": lambda **more: HInfinityTracking(orientation_gain=20.0, translation_gain=10.0, **more),
    "HIRT left": lambda **more: HInfinityTracking(
        orientation_gain=20.0, translation_gain=10.0, form="left", **more
    ),
    "LQR-DQ": lambda **more: LinearQuadraticDQ(error_weight=100.0, control_weight=1.0, **more),
    "LQR-DQ left": lambda **more: LinearQuadraticDQ(
        error_weight=100.0, control_weight=1.0, error="left", **more
    ),
}


def circle(robot, q, duration=TURN):
    return Circle(robot.fkm(q), radius=0.1, duration=duration)


def error(robot, q, law, period, reference=None, plant=None, after=1.0, until=5.0, **more):
    reference = reference or circle(robot, q)
    record = dqc.simulate(robot, reference, law, plant or dqc.plants.Integrator(), q, period, until, **more)
    return 1e6 * np.sqrt(np.mean(record.position_error[record.time > after] ** 2))


def as_prepared(law, robot, period, q, last):
    prepared = law.prepare(robot, None, period)
    state = prepared.initial_state(q)
    prepared.sent(state, last)
    return prepared, state


@pytest.mark.parametrize(("robot", "q"), [("panda", PANDA), ("little-john", BASE), ("ur5", UR5)])
def test_what_is_added_moves_the_jacobian_by_half_a_period(robot, q):
    """With J⁺ undamped and no error, J u = ξ_d + h (ξ̇_d − J̇(u⁻) u⁻), J̇u⁻ by differences of J along the motion."""
    robot, rng = dqc.load_robot(robot), np.random.default_rng(3)
    last, h, step = rng.uniform(-0.2, 0.2, robot.input_size), 0.005, 1e-4
    ahead, behind = (robot.twist_jacobian(robot.integrate(q, last, by)) @ last for by in (step, -step))
    rate = np.array([0.02, -0.01, 0.03, 0.01, 0.02, 0.01])
    wanted = robot.twist_jacobian(q) @ np.full(robot.input_size, 0.3)
    law = ProportionalFeedforward(gain=10.0, null_space=None)
    prepared, state = as_prepared(law, robot, 2 * h, q, last)
    u = prepared.command(q, dqc.Sample(robot.fkm(q), wanted, rate), state)
    expected = wanted + h * (rate - (ahead - behind) / (2 * step))
    assert np.abs(robot.twist_jacobian(q) @ u - expected).max() < 1e-9
    assert np.abs(expected - wanted).max() > 1e-4


@pytest.mark.parametrize(
    ("task", "knows"),
    [("left", True), ("relative", True), ("absolute", False), (PoseTask("frame", ("right",)), True)],
)
def test_trees_carry_their_columns_in_their_own_order(task, knows):
    arms, rng = dqc.load_robot("two-pandas").with_task(task), np.random.default_rng(5)
    q, last, h, step = np.tile(PANDA, 2), rng.uniform(-0.2, 0.2, 14), 0.005, 1e-4
    change = arms.twist_jacobian(q + step * last) - arms.twist_jacobian(q - step * last)
    wanted = arms.twist_jacobian(q) @ np.full(14, 0.3) + 0.1
    prepared, state = as_prepared(ProportionalFeedforward(gain=10.0), arms, 2 * h, q, last)
    u = prepared.command(q, dqc.Sample(arms.fkm(q), wanted), state)
    expected = wanted - knows * h * change @ last / (2 * step)
    assert np.abs(arms.twist_jacobian(q) @ u - expected).max() < 1e-9


@pytest.mark.parametrize("law", LAWS)
def test_the_error_falls_with_the_square_of_the_period(law):
    robot = dqc.load_robot("panda")
    printed, coarse, fine = (
        error(robot, PANDA, LAWS[law](feedforward=kind), period)
        for kind, period in (("printed", 0.01), ("second-order", 0.02), ("second-order", 0.01))
    )
    assert 3.5 < coarse / fine < 4.6
    assert fine < printed / 15


@pytest.mark.parametrize(("period", "most"), [(0.005, 0.3), (0.01, 1.5)])
def test_a_circle_is_followed_closer_than_by_going_to_the_next_pose(period, most):
    """Going to the next pose at once, u = J⁺ log(x* x_d(t + T))/T, is what other programs do."""
    robot = dqc.load_robot("panda")
    reference = circle(robot, PANDA)
    samples, q, apart = reference.samples(period * np.arange(1, int(5 / period))), PANDA.copy(), []
    for k, sample in enumerate(samples):
        twist = dqc.algebra.log_inertial(
            dqc.algebra.multiply(sample[:8], dqc.algebra.conjugate(robot.fkm(q)))
        )
        q = q + np.linalg.pinv(robot.twist_jacobian(q)) @ (2 * twist)
        if k * period > 1:
            apart.append(dqc.algebra.translation(robot.fkm(q)) - dqc.algebra.translation(sample[:8]))
    deadbeat = 1e6 * np.sqrt(np.mean(np.sum(np.square(apart), axis=1)))
    found = error(robot, PANDA, LAWS["K+FF"](), period)
    assert found < most
    assert found < deadbeat / 3


@pytest.mark.parametrize("law", LAWS)
def test_a_goal_at_rest_is_reached_by_the_same_bits(law):
    robot, goal = dqc.load_robot("panda"), dqc.references.SetPoint(dqc.load_robot("panda").fkm(PANDA + 0.3))
    commands = [
        dqc.simulate(
            robot, goal, LAWS[law](feedforward=kind), dqc.plants.Integrator(), PANDA, 0.01, 1.0
        ).command
        for kind in ("second-order", "printed")
    ]
    assert np.array_equal(*commands)


def test_where_a_path_turns_back_the_rate_counts():
    """There ξ_d is 0 for a sample: fed forward without its rate it left 9 µm and a jerk 30 times the path's."""
    robot, rate = dqc.load_robot("panda"), np.array([0.0, 0.0, 0.0, -0.3, 0.0, 0.0])
    prepared, state = as_prepared(ProportionalFeedforward(gain=10.0), robot, 0.01, PANDA, np.zeros(7))
    u = prepared.command(PANDA, dqc.Sample(robot.fkm(PANDA), np.zeros(6), rate), state)
    assert np.abs(robot.twist_jacobian(PANDA) @ u - 0.005 * rate).max() < 1e-12


def test_what_is_added_is_at_most_half_of_the_desired_twist():
    robot, last = dqc.load_robot("panda"), np.full(7, 40.0)
    sample = dqc.Sample(robot.fkm(PANDA), [0.0, 0.0, 0.0, 0.1, 0.0, 0.0])
    prepared, state = as_prepared(ProportionalFeedforward(gain=10.0), robot, 0.01, PANDA, last)
    asked = robot.hand_jacobian(PANDA) @ prepared.command(PANDA, sample, state)
    change = (asked - [0, 0, 0, 0.1, 0, 0]) * [0.3, 0.3, 0.3, 1, 1, 1]
    assert np.linalg.norm(change) == pytest.approx(0.05)


@pytest.mark.parametrize("law", ["K+FF", "HIRT left", "LQR-DQ"])
@pytest.mark.parametrize("limits", [None, dqc.limits.CommandLimits(position=dqc.limits.ModifiedClamping())])
def test_compiled_and_interpreted_loops_agree_to_the_last_bit(law, limits):
    robot = dqc.load_robot("panda")
    for plant in (dqc.plants.Integrator(), dqc.plants.Servo(time_constant=0.05, delay=0.02)):
        runs = [
            dqc.simulate(
                robot,
                circle(robot, PANDA, 2.0),
                LAWS[law](),
                plant,
                PANDA,
                0.01,
                0.3,
                limits=limits,
                supervisor=dqc.supervisor.Supervisor(),
                interpreted=interpreted,
            )
            for interpreted in (False, True)
        ]
        assert np.array_equal(runs[0].command, runs[1].command)


def test_the_last_command_is_the_one_that_left():
    robot, sample = (
        dqc.load_robot("panda"),
        dqc.Sample(dqc.load_robot("panda").fkm(PANDA), [0, 0, 0, 0.1, 0, 0]),
    )
    prepared = ProportionalFeedforward(gain=10.0).prepare(robot, None, 0.05)
    stopped, moving = prepared.initial_state(PANDA), prepared.initial_state(PANDA)
    for state in (stopped, moving):
        first = prepared.command(PANDA, sample, state)
    prepared.sent(stopped, np.zeros(7))
    assert np.array_equal(prepared.command(PANDA, sample, stopped), first)
    assert not np.array_equal(prepared.command(PANDA, sample, moving), first)


@pytest.mark.parametrize("turning", [False, True])
def test_lagging_joints_are_led_with_their_jacobian(turning):
    robot, servo = dqc.load_robot("panda"), dqc.plants.Servo(time_constant=0.05, delay=0.02)
    path = circle(robot, PANDA)
    if turning:
        way = PANDA + 0.3 * np.sin(np.linspace(0, 1.5, 7))[:, None] * np.array([1, 1, -1, 1, 1, -1, 1])
        path = dqc.references.ViaPoints(np.linspace(0, 6, 7), robot.fkm(way))
    printed, previewed, second = (
        error(robot, PANDA, LAWS["K+FF"](feedforward=kind), 0.01, reference, servo)
        for kind, reference in (
            ("printed", path),
            ("printed", Previewed(path, delay=0.025, lag=0.05)),
            ("second-order", Previewed(path, delay=0.025, lag=0.05)),
        )
    )
    unled = error(robot, PANDA, LAWS["K+FF"](), 0.01, path, servo)
    assert second < previewed / 4 < printed
    assert unled < printed / 4


def test_the_rate_of_a_previewed_twist_is_its_derivative():
    robot = dqc.load_robot("panda")
    poses = robot.fkm(PANDA + np.linspace(0, 0.5, 5)[:, None])
    ahead = Previewed(dqc.references.ViaPoints([0.0, 1.0, 2.0, 3.0, 4.0], poses), delay=0.02, lag=0.05)
    times, step = np.linspace(0.3, 3.5, 40), 1e-5
    slope = (ahead.samples(times + step) - ahead.samples(times - step))[:, 8:14] / (2 * step)
    assert np.abs(ahead.samples(times)[:, 14:20] - slope).max() < 1e-5


def test_another_word_is_refused():
    with pytest.raises(Error, match=r"feedforward: .*printed"):
        ProportionalFeedforward(gain=1.0, feedforward="print").prepare(dqc.load_robot("panda"), None, 0.01)

import numpy as np
import pytest
from algebra_samples import SPECIAL_ANGLES, cases, error, poses, random_poses, rotation_about
from hypothesis import strategies as st

from dqcontrol import algebra

PAIRS = {
    "screw": (algebra.log_screw, algebra.exp_screw),
    "body": (algebra.log_body, algebra.exp_body),
    "inertial": (algebra.log_inertial, algebra.exp_inertial),
}
ONE = np.array([1.0, 0, 0, 0, 0, 0, 0, 0])


@pytest.mark.parametrize("name", PAIRS)
@cases(x=poses())
def test_exp_inverts_log(name, x):
    log, exp = PAIRS[name]
    assert error(exp(log(x)), x) < 1e-12


@pytest.mark.parametrize("name", PAIRS)
def test_both_ways_up_to_almost_a_full_turn(name):
    log, exp = PAIRS[name]
    rng = np.random.default_rng(10)
    turn = np.concatenate([SPECIAL_ANGLES, np.linspace(0, 2 * np.pi - 1e-3, 5000)])
    axis, dual = rng.normal(size=(2, len(turn), 3))
    axis /= np.linalg.norm(axis, axis=1)[:, None]
    dual /= np.linalg.norm(dual, axis=1)[:, None]
    x = algebra.pose(rotation_about(axis, turn), dual)
    assert error(exp(log(x)), x) < 1e-12
    g = np.concatenate([0.5 * turn[:, None] * axis, dual], axis=1)
    lost = np.where(
        2 * np.pi - turn < 0.02, 3e-12, 1e-12
    )  # the screw logarithm magnifies 6000 times at the end
    assert (np.abs(log(exp(g)) - g).max(axis=1) < lost).all()


def test_screw_log_agrees_with_pinocchio():
    pin = pytest.importorskip("pinocchio", reason="Pinocchio is the reference")
    for x in algebra.short(random_poses(np.random.default_rng(11), 50)):
        motion = pin.log6(algebra.se3_from_pose(x))
        assert error(2 * algebra.log_screw(x), np.concatenate([motion.angular, motion.linear])) < 1e-12


def test_inertial_pair_is_the_one_of_dq_robotics():
    dqrobotics = pytest.importorskip("dqrobotics", reason="DQ Robotics is the reference for this pair")
    for x in algebra.short(random_poses(np.random.default_rng(12), 50)):
        theirs = dqrobotics.log(algebra.dqrobotics_from_pose(x))
        assert error(algebra.unvec(algebra.log_inertial(x)), theirs.vec8()) < 1e-12
        assert error(algebra.exp_inertial(algebra.log_inertial(x)), dqrobotics.exp(theirs).vec8()) < 1e-12


def test_decoupled_logs_hold_half_the_positions():
    x = random_poses(np.random.default_rng(13), 30)
    assert error(algebra.log_body(x)[:, 3:], algebra.body_translation(x) / 2) < 1e-15
    assert error(algebra.log_inertial(x)[:, 3:], algebra.translation(x) / 2) < 1e-15
    assert error(algebra.log_body(x)[:, :3], algebra.log_screw(x)[:, :3]) == 0


def test_log_keeps_its_digits_near_one():
    angle = np.array([1e-3, 1e-6, 1e-9, 1e-12, 1e-100])
    g = algebra.log_screw(algebra.pose(rotation_about([[0.0, 0, 1]] * 5, angle), np.zeros(3)))
    assert np.abs(2 * g[:, 2] / angle - 1).max() < 1e-15


def test_series_join_the_closed_forms():
    """Across the bounds of the series the logarithm and the exponential stay smooth."""
    for bound in (1e-7, 1e-4, 0.3):
        for side in (bound * (1 - 1e-12), bound, bound * (1 + 1e-12)):
            for angle in (side, 2 * side, side / 2):
                g = np.array([0.6 * angle, 0.8 * angle, 0.0, 1.0, -2.0, 3.0])
                assert error(algebra.log_screw(algebra.exp_screw(g)), g) < 1e-14


@cases(poses(largest_angle=np.pi), st.floats(-3, 3), st.floats(-3, 3))
def test_powers(x, s, t):
    assert error(algebra.power(x, 2), algebra.multiply(x, x)) < 1e-13
    assert error(algebra.power(x, 0), np.broadcast_to(ONE, x.shape)) == 0
    assert error(algebra.power(x, 1), x) < 1e-14
    assert error(algebra.power(x, -1), algebra.conjugate(x)) < 1e-14
    both = algebra.multiply(algebra.power(x, s), algebra.power(x, t))
    assert error(algebra.power(x, s + t), both) < 1e-13


@cases(poses())
def test_the_square_beyond_half_a_turn(x):
    assert error(algebra.power(x, 2), algebra.multiply(x, x)) < 1e-11


def test_power_broadcasts():
    x = random_poses(np.random.default_rng(14), 3, 1)
    t = np.linspace(0, 1, 5)
    out = algebra.power(x, t)
    assert out.shape == (3, 5, 8)
    assert error(out[2, 3], algebra.power(x[2, 0], t[3])) == 0


def test_sclerp_is_one_screw():
    rng = np.random.default_rng(15)
    t = np.linspace(0, 1, 21)
    for x1, x2 in zip(random_poses(rng, 20), random_poses(rng, 20), strict=True):
        path = algebra.sclerp(x1, x2, t)
        assert error(path[0], x1) < 1e-14
        assert error(algebra.short(algebra.multiply(algebra.conjugate(path[-1]), x2)), ONE) < 1e-14
        assert (
            np.linalg.norm(algebra.log_screw(algebra.multiply(algebra.conjugate(x1), path[-1]))[:3])
            <= np.pi / 2
        )
        steps = algebra.multiply(algebra.conjugate(path[:-1]), path[1:])
        assert error(steps, np.broadcast_to(steps[0], steps.shape)) < 1e-14
        h = 1e-5
        rate = (algebra.sclerp(x1, x2, t + h) - algebra.sclerp(x1, x2, t - h)) / (2 * h)
        twist = 2 * algebra.multiply(rate, algebra.conjugate(path))  # ẋ = ½ξx
        assert error(twist, np.broadcast_to(twist[0], twist.shape)) < 1e-8
        # The endpoint's sign does not matter.
        assert error(algebra.sclerp(x1, -x2, t), path) < 1e-14


def test_twists_are_the_derivative_of_the_pose():
    """ẋ = ½ξx = ½xξ_b with ξ = ω + ε(ṗ + p × ω), against central differences."""
    n = np.array([2.0, -1, 2]) / 3

    def angle(t):
        return 0.4 + 1.3 * t + 0.5 * t**2

    def position(t):
        return np.stack([np.sin(t), 0.3 * t**2, np.cos(2 * t)], axis=-1)

    def x(t):
        return algebra.pose(algebra.rotation_from_axis_angle(n, angle(t)), position(t))

    t, h = np.linspace(0, 2, 40), 1e-5
    omega = n * (1.3 + t)[:, None]
    velocity = np.stack([np.cos(t), 0.6 * t, -2 * np.sin(2 * t)], axis=-1)
    twist = np.concatenate([omega, velocity + np.cross(position(t), omega)], axis=1)
    rate = (x(t + h) - x(t - h)) / (2 * h)
    assert error(0.5 * algebra.multiply(algebra.unvec(twist), x(t)), rate) < 1e-9
    body = algebra.adjoint_twist(algebra.conjugate(x(t)), twist)
    assert error(0.5 * algebra.multiply(x(t), algebra.unvec(body)), rate) < 1e-9
    turned = algebra.vec3(
        algebra.adjoint(algebra.unvec(algebra.rotation(algebra.conjugate(x(t)))), algebra.unvec(velocity))
    )
    assert error(body[:, 3:], turned) < 1e-12  # the dual part of the body twist is the velocity in body axes


def test_constant_twist_is_integrated_exactly():
    rng = np.random.default_rng(16)
    x0, twist, duration = random_poses(rng), rng.normal(size=6), 0.7
    x = x0
    for _ in range(2000):  # fourth-order steps of ẋ = ½ξx

        def rate(y):
            return 0.5 * algebra.multiply(algebra.unvec(twist), y)

        h = duration / 2000
        k1 = rate(x)
        k2 = rate(x + h / 2 * k1)
        k3 = rate(x + h / 2 * k2)
        x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + rate(x + h * k3))
    exact = algebra.multiply(algebra.exp_screw(duration * twist / 2), x0)
    assert error(exact, x) < 1e-12

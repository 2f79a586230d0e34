"""Parts of laws against their formulas in NumPy, at poses whose axes are no axes of the base."""

import numpy as np
import pytest
from hand_twist import hand_jacobian

import dqcontrol as dqc
from dqcontrol import algebra
from dqcontrol.laws import FilteredInverse, OpenLoop, Proportional
from dqcontrol.laws.integral import integral_state
from dqcontrol.laws.pose_error import _LONGEST_LEVER, _with_short_lever, shorten_lever

SEED = 20261128
T = 0.01
ARM = dqc.load_robot("iiwa7")


def bent(rng):
    """Return a configuration away from singularities, where inverses are exact."""
    while True:
        q = 0.7 * rng.uniform(ARM.limits.lower, ARM.limits.upper)
        weight = np.diag([0.3] * 3 + [1.0] * 3)
        if np.linalg.svd(weight @ hand_jacobian(ARM, q), compute_uv=False)[-1] > 0.08:
            return q


def test_a_lever_beyond_three_lengths_is_shortened_along_itself():
    rng, beyond = np.random.default_rng(SEED), 0
    inverse = np.array(FilteredInverse(growth=1.0).parameters())
    for _ in range(40):
        pose, desired = (
            algebra.pose(r / np.linalg.norm(r), rng.uniform(-2, 2, 3)) for r in rng.normal(size=(2, 4))
        )
        error = rng.uniform(-1, 1, 6)
        p, p_d = algebra.translation(pose), algebra.translation(desired)
        lever = error[3:] + np.cross(error[:3], p) - (p - p_d)
        longest = _LONGEST_LEVER * 0.3
        kept = min(1.0, longest / np.linalg.norm(lever))
        beyond += kept < 1
        expected = np.r_[error[:3], error[3:] - (1 - kept) * lever]
        shorten_lever(error, pose, desired, inverse)
        assert error == pytest.approx(expected, abs=1e-12)
    assert 10 < beyond < 40


def test_a_velocity_s_lever_turns_no_faster_than_that_of_a_length():
    rng, shortened = np.random.default_rng(SEED), 0
    for _ in range(60):
        omega, velocity, away = rng.uniform(-1, 1, (3, 3))
        turned = np.cross(omega, away)
        straight = velocity + turned
        most = 0.3 * np.linalg.norm(straight) / np.linalg.norm(away)
        kept = min(1.0, most / np.linalg.norm(turned))
        shortened += kept < 1
        found = _with_short_lever(tuple(omega), tuple(velocity), tuple(away), 0.3)
        assert found == pytest.approx(straight - kept * turned, abs=1e-12)
    assert 20 < shortened < 60


@pytest.mark.usefixtures("without_growth")
def test_the_integral_of_one_sample_is_the_error_in_the_axes_of_the_end_effector():
    """2 Im(x* x_d) and the position in them, of either sign of the target; it adds their twist in the base's axes."""
    rng = np.random.default_rng(SEED)
    plain, summing = Proportional(gain=2.0), Proportional(gain=2.0, integral_gain=3.0)
    plain, summing = (law.prepare(ARM, None, T) for law in (plain, summing))
    for k in range(10):
        q = bent(rng)
        goal = ARM.fkm(q + rng.uniform(-0.2, 0.2, 7))
        relative = algebra.short(algebra.multiply(algebra.conjugate(ARM.fkm(q)), goal))
        error = np.r_[2 * relative[1:4], algebra.translation(relative)]
        state, sample = summing.initial_state(q), dqc.Sample((-1) ** k * goal)
        u = summing.command(q, sample, state)
        total = integral_state(state).total
        assert total == pytest.approx(3.0 * T * error, abs=1e-12)
        turn = algebra.matrix_from_rotation(algebra.rotation(ARM.fkm(q)))
        more = hand_jacobian(ARM, q) @ (u - plain.command(q, sample, plain.initial_state(q)))
        assert more == pytest.approx(np.r_[turn @ total[:3], turn @ total[3:]], abs=1e-9)


@pytest.mark.usefixtures("without_growth")
def test_without_feedback_the_rate_of_the_target_is_followed_whatever_its_sign():
    """J u is the twist whose product with the present pose is nearest to ẋ_d = ½ ξ_d x_d."""
    rng, law = np.random.default_rng(SEED), OpenLoop().prepare(ARM, None, T)
    for _ in range(20):
        q = bent(rng)
        goal, twist = ARM.fkm(q + rng.uniform(-0.3, 0.3, 7)), rng.uniform(-0.3, 0.3, 6)
        one, other = (
            law.command(q, dqc.Sample(sign * goal, twist), law.initial_state(q)) for sign in (1, -1)
        )
        assert one == pytest.approx(other, abs=1e-12)
        here = dqc.Sample(ARM.fkm(q), twist)
        exact = law.command(q, here, law.initial_state(q))
        moved = np.r_[twist[:3], twist[3:] + np.cross(twist[:3], algebra.translation(ARM.fkm(q)))]
        assert hand_jacobian(ARM, q) @ exact == pytest.approx(moved, abs=1e-9)

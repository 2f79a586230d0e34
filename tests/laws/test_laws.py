"""Commands against their definitions, by NumPy and by finite differences."""

from copy import deepcopy

import numpy as np
import pytest
from hand_twist import command, error_rate, hand_jacobian, nearest

import dqcontrol as dqc
from dqcontrol import algebra
from dqcontrol.laws import (
    DampedInverse,
    FilteredInverse,
    Posture,
    Proportional,
    ProportionalFeedforward,
    Schedule,
)
from dqcontrol.references import Sample

pytestmark = pytest.mark.usefixtures("without_growth")

SEED = 20260714
CONJUGATE = np.diag([1.0, -1, -1, -1, 1, -1, -1, -1])
GAINS = [1.5, 2.0, 2.5, 3.0, 3.5, 4.0, 4.5, 5.0]
SHAPES = [
    (1, ()),
    (1, (0,)),
    (5, ()),
    (5, (1,)),
    (6, ()),
    (6, (0, 2)),
    (7, ()),
    (7, (1,)),
    (8, ()),
    (60, (3, 20)),
]


def left_error(pose, desired):
    return np.eye(8)[0] - algebra.short(algebra.multiply(algebra.conjugate(pose), desired))


def short_desired(pose, desired):
    """Return the sign of the desired pose that takes the short way."""
    return desired * np.sign((algebra.conjugate(pose)[0] * desired[0]) + pose[1:4] @ desired[1:4])


def task_matrix(arm, q, desired):
    """Return N = H⁻(x_d) C8 J. [P16 3.7]"""
    return algebra.hamilton_minus(desired) @ CONJUGATE @ arm.pose_jacobian(q)


def wanted_command(arm, q, desired, target, inverse=None):
    """Return the inputs that give the hand the twist nearest to N u = target."""
    return command(arm, q, nearest(error_rate(arm, q, desired), target), inverse)


def singular_values(arm, q):
    """Return those of the Jacobian of [ℓω ; ṗ]."""
    weight = np.array([FilteredInverse().characteristic_length] * 3 + [1.0] * 3)
    return np.linalg.svd(weight[:, None] * hand_jacobian(arm, q), compute_uv=False)


def situations(make_arm, n, prismatic, count=12):
    """Yield arms, configurations and samples; poses within about 1 rad and 0.2 m, twists of order 1."""
    rng = np.random.default_rng([SEED, n, len(prismatic)])
    for i in range(count):
        arm = make_arm(n, prismatic, seed=i)
        q = rng.uniform(-1, 1, n)
        step = algebra.exp_screw(rng.uniform(-0.25, 0.25, 6))
        desired = algebra.multiply(arm.fkm(q), step) * rng.choice([-1, 1])
        yield arm, q, Sample(desired, rng.normal(size=6))


def feedforward(pose, desired, twist):
    velocity = 0.5 * algebra.multiply(np.concatenate([[0], twist[:3], [0], twist[3:]]), desired)
    return algebra.multiply(algebra.conjugate(pose), velocity)


@pytest.mark.parametrize("gain", [3.0, GAINS], ids=["number", "diagonal"])
@pytest.mark.parametrize(("n", "prismatic"), SHAPES)
def test_command_is_the_pseudoinverse_of_the_task(make_arm, n, prismatic, gain):
    """Where six joints or more reach all twists that is N⁺ y; with fewer the hand misses the least of its twist."""
    inverse = FilteredInverse(threshold=1e-5, damping=0.01)
    for arm, q, sample in situations(make_arm, n, prismatic):
        pose = arm.fkm(q)
        desired = short_desired(pose, sample.pose)
        matrix = task_matrix(arm, q, desired)
        assert np.linalg.svd(matrix)[1][min(n, 6) - 1] > 1e-4, "the arm is singular there, take another seed"
        target = np.array(gain) * left_error(pose, sample.pose)
        pinv = np.linalg.pinv(matrix, rcond=1e-9)
        tolerance = 1e-11 * np.linalg.norm(pinv, 2) ** 2 + 1e-12
        for law, asked in (
            (Proportional(gain=gain, inverse=inverse), target),
            (
                ProportionalFeedforward(gain=gain, inverse=inverse),
                target - feedforward(pose, desired, sample.twist),
            ),
        ):
            u = law.command(arm, q, sample, period=0.01)
            wanted = [wanted_command(arm, q, desired, asked, inverse)]
            wanted += [pinv @ asked] if n >= 6 else []
            for each in wanted:
                assert np.abs(u - each).max() < tolerance * (1 + np.abs(target).max())


@pytest.mark.parametrize("n", [6, 7])
def test_task_matrix_is_the_derivative_of_the_error(make_arm, n):
    for arm, q, sample in situations(make_arm, n, (), 4):
        h = 1e-6
        columns = [
            (left_error(arm.fkm(q + h * d), sample.pose) - left_error(arm.fkm(q - h * d), sample.pose))
            / (2 * h)
            for d in np.eye(n)
        ]
        u = Proportional(gain=2.0, inverse=FilteredInverse(threshold=1e-5)).command(
            arm, q, sample, period=0.01
        )
        wanted = np.linalg.pinv(-np.array(columns).T, 1e-6) @ (2 * left_error(arm.fkm(q), sample.pose))
        assert u == pytest.approx(wanted, abs=1e-6 * max(1, np.abs(wanted).max()))


def test_error_derivative_with_feedforward_is_the_projected_decay(make_arm):
    for arm, q, sample in situations(make_arm, 7, (), 6):
        u = ProportionalFeedforward(gain=4.0, inverse=FilteredInverse(threshold=1e-5)).command(
            arm, q, sample, period=0.01
        )
        h = 1e-6
        ahead, behind = (
            left_error(
                arm.fkm(q + t * u),
                algebra.multiply(algebra.exp_screw(t * sample.data[8:14] / 2), sample.pose),
            )
            for t in (h, -h)
        )
        derivative = (ahead - behind) / (2 * h)
        e = left_error(arm.fkm(q), sample.pose)
        matrix = task_matrix(arm, q, short_desired(arm.fkm(q), sample.pose))
        assert derivative == pytest.approx(-4.0 * matrix @ np.linalg.pinv(matrix, rcond=1e-9) @ e, abs=1e-6)


@pytest.mark.parametrize("n", [1, 5, 6, 7, 60])
@pytest.mark.parametrize("damping", [0.01, 0.3])
def test_damped_inverse(make_arm, n, damping):
    for arm, q, sample in situations(make_arm, n, (), 5):
        inverse, target = DampedInverse(damping=damping), 2 * left_error(arm.fkm(q), sample.pose)
        u = Proportional(gain=2.0, inverse=inverse).command(arm, q, sample, period=0.01)
        desired = short_desired(arm.fkm(q), sample.pose)
        assert u == pytest.approx(wanted_command(arm, q, desired, target, inverse), abs=1e-9)


@pytest.mark.parametrize(("n", "prismatic"), SHAPES)
def test_filtered_inverse_whatever_its_threshold(make_arm, n, prismatic):
    """From far below the smallest singular value, where one factorisation does, to far above it."""
    for arm, q, sample in situations(make_arm, n, prismatic, 4):
        desired = short_desired(arm.fkm(q), sample.pose)
        smallest = singular_values(arm, q)[min(n, 6) - 1]
        target = 2 * left_error(arm.fkm(q), sample.pose)
        for factor in (0.01, 0.1, 0.3, 0.5, 0.7, 0.9, 0.99, 1.01, 1.1, 2, 10):
            inverse = FilteredInverse(threshold=factor * smallest, damping=0.05)
            u = Proportional(gain=2.0, inverse=inverse).command(arm, q, sample, period=0.01)
            wanted = wanted_command(arm, q, desired, target, inverse)
            assert np.abs(u - wanted).max() < 1e-10 * max(1, 1 / smallest**2)


def test_filtered_inverse_is_continuous_at_its_threshold(make_arm):
    for arm, q, sample in situations(make_arm, 7, (), 6):
        sigma = singular_values(arm, q)[5]
        below, above = (
            Proportional(
                gain=2.0, inverse=FilteredInverse(threshold=sigma * (1 + side), damping=0.05)
            ).command(arm, q, sample, period=0.01)
            for side in (-1e-9, 1e-9)
        )
        assert below == pytest.approx(above, abs=1e-6 * max(1, np.abs(below).max()))


@pytest.mark.parametrize("law", [Proportional, ProportionalFeedforward])
def test_through_a_singularity(law):
    """Through the stretched elbow of the iiwa the command stays that of the SVD formula, and continuous."""
    arm = dqc.load_robot("iiwa7")
    prepared = law(gain=2.0).prepare(arm, None, 0.01)
    rng = np.random.default_rng(SEED)
    offset, twist = rng.uniform(-0.1, 0.1, 6), rng.normal(size=6)
    elbows = np.concatenate([np.linspace(0.3, 1e-9, 500), [0.0], np.linspace(-1e-9, -0.3, 500)])
    regular, filtered_count, last = 0, 0, None
    for elbow in elbows:
        q = np.array([0.1, 0.6, 0.2, elbow, 0.1, 0.7, 0.0])
        pose = arm.fkm(q)
        sample = Sample(algebra.multiply(pose, algebra.exp_screw(offset)), twist)
        if singular_values(arm, q)[5] > 0.04:
            regular += 1
        else:
            filtered_count += 1
        target = 2 * left_error(pose, sample.pose)
        if law is ProportionalFeedforward:
            target = target - feedforward(pose, sample.pose, twist)
        u = prepared.command(q, sample, prepared.initial_state(q))
        wanted = wanted_command(arm, q, sample.pose, target)
        assert u == pytest.approx(wanted, abs=1e-7 * (1 + np.abs(u).max()))
        if last is not None:
            assert np.abs(u - last).max() < 0.5
        last = u
    assert min(regular, filtered_count) > 20


@pytest.mark.parametrize("law", [Proportional(gain=3.0), ProportionalFeedforward(gain=3.0)])
def test_a_pose_and_its_negative_are_one(make_arm, law):
    for arm, q, sample in situations(make_arm, 7, (), 8):
        opposite = Sample(-sample.data[:8], sample.twist)
        u = law.command(arm, q, sample, period=0.01)
        assert law.command(arm, q, opposite, period=0.01) == pytest.approx(u, abs=1e-11 * np.abs(u).max())
        there = Sample(-arm.fkm(q))
        assert np.abs(Proportional(gain=3.0).command(arm, q, there, period=0.01)).max() < 1e-12


def test_instant_motion_of_a_pure_rotation_and_a_pure_translation():
    """θ̇ = −2k sin(θ/2) about the axis without moving the hand; ṗ = k (p_d − p) without turning it."""
    arm, rng = dqc.load_robot("iiwa7"), np.random.default_rng(SEED)
    q = np.array([0.2, 0.6, 0.1, 1.6, -0.3, 0.9, 0.4])
    pose = arm.fkm(q)
    for angle in (1e-6, 0.1, 1.0, 2.0, 3.0):
        axis = rng.normal(size=3)
        axis /= np.linalg.norm(axis)
        turn = algebra.pose(np.concatenate([[np.cos(angle / 2)], np.sin(angle / 2) * axis]), [0, 0, 0])
        u = Proportional(gain=3.0).command(arm, q, Sample(algebra.multiply(pose, turn)), period=0.01)
        omega = arm.twist_jacobian(q)[:3] @ u
        assert np.linalg.norm(omega) == pytest.approx(6 * np.sin(angle / 2), rel=1e-9)
        assert np.abs(arm.translation_jacobian(q) @ u).max() < 1e-9
        assert omega / np.linalg.norm(omega) == pytest.approx(
            algebra.matrix_from_pose(pose)[:3, :3] @ axis, abs=1e-6
        )
    shift = np.array([0.05, -0.08, 0.03])
    desired = algebra.pose(algebra.rotation(pose), algebra.translation(pose) + shift)
    u = Proportional(gain=3.0).command(arm, q, Sample(desired), period=0.01)
    assert arm.translation_jacobian(q) @ u == pytest.approx(3 * shift, abs=1e-12)
    assert np.abs(arm.twist_jacobian(q)[:3] @ u).max() < 1e-12


def test_schedule_is_linear_between_and_held_outside():
    schedule = Schedule([1.0, 2.0, 4.0], [3.0, 5.0, 4.0])
    assert schedule.at([0, 1, 1.5, 2, 3, 4, 9]).tolist() == [3, 3, 4, 5, 4.5, 4, 4]
    assert schedule.end == 4.0
    assert Schedule([-5.0, -1.0], [2.0, 3.0]).at(0.0).tolist() == [3]


def test_scheduled_gain_is_that_of_the_sample_time(make_arm):
    arm, q = make_arm(6), np.full(6, 0.3)
    schedule = Schedule([0.1, 0.3], [2.0, 6.0])
    law = Proportional(gain=schedule).prepare(arm, None, 0.01)
    assert law.parameters.shape[0] == 31
    constant = Proportional(gain=1.0)
    desired = arm.fkm(q + 0.05)
    for time, gain in ((0.0, 2.0), (0.1, 2.0), (0.15, 3.0), (0.2, 4.0), (0.3, 6.0), (50.0, 6.0)):
        sample = Sample(desired, time=time)
        u = law.command(q, sample, law.initial_state(q))
        assert u == pytest.approx(gain * constant.command(arm, q, sample, period=0.01), rel=1e-12)
    for early in (Schedule([-2.0], [3.0]), Schedule([-2.0, -1.0], [1.0, 3.0])):
        u = Proportional(gain=early).command(arm, q, Sample(desired), period=0.01)
        assert u == pytest.approx(3 * constant.command(arm, q, Sample(desired), period=0.01), rel=1e-12)


def test_hysteresis_keeps_the_sign_until_the_real_part_has_passed_it(make_arm):
    """Turn the target through half a turn: the sign flips where Re(x*x_d) = −δ, and back at +δ."""
    arm, q = make_arm(6), np.full(6, 0.3)
    pose = arm.fkm(q)

    def sample(real):
        turn = algebra.pose([real, 0, 0, np.sqrt(1 - real**2)], [0, 0, 0])
        return Sample(algebra.multiply(pose, turn))

    for delta in (0.0, 0.2, 0.5):
        law = Proportional(gain=1.0, hysteresis=delta).prepare(arm, None, 0.01)
        state = law.initial_state(q)
        for real, sign in (
            (0.9, 1),
            (-delta + 1e-9, 1),
            (-delta - 1e-9, -1),
            (delta - 1e-9, -1),
            (delta + 1e-9, 1),
            (-0.9, -1),
        ):
            law.command(q, sample(real), state)
            assert state[0] == sign, (delta, real)
        fresh = law.initial_state(q)
        law.command(q, sample(-1e-9), fresh)
        assert fresh[0] == -1, "without a past the short way is taken at once"


def test_a_configuration_may_be_strided(make_arm):
    arm, law = make_arm(7), Proportional(gain=1.0, null_space=Posture(gain=1.0))
    q = np.linspace(-1, 1, 7)
    sample, prepared = dqc.Sample(arm.fkm(q + 0.1)), law.prepare(arm, None, 0.01)
    wanted = prepared.command(q, sample, prepared.initial_state(q))
    strided = np.repeat(q, 2)[::2]
    np.testing.assert_array_equal(prepared.command(strided, sample, prepared.initial_state(q)), wanted)


def test_a_copy_of_a_prepared_law_has_its_own_memory(make_arm):
    arm, q = make_arm(7), np.linspace(-1, 1, 7)
    first = Proportional(gain=1.0, null_space=Posture(gain=1.0)).prepare(arm, None, 0.01)
    state, sample = first.initial_state(q), dqc.Sample(arm.fkm(q + 0.1))
    wanted, pose = first.command(q, sample, state), first.pose.copy()
    second = deepcopy(first)
    second.command(q + 0.2, sample, state)
    np.testing.assert_array_equal(first.pose, pose)
    np.testing.assert_allclose(second.pose, arm.fkm(q + 0.2), atol=1e-15)
    np.testing.assert_array_equal(second.command(q, sample, state), wanted)

"""Laws beside K and K+FF against their definitions, computed with NumPy's SVD; null space, inverses, limits."""

import msgspec
import numpy as np
import pytest
from hand_twist import command, error_rate, hand_jacobian, inverse_by_svd, nearest, pose_rate

import dqcontrol as dqc
from dqcontrol import algebra
from dqcontrol.errors import Error
from dqcontrol.laws import (
    DampedInverse,
    DecoupledProportional,
    FilteredInverse,
    ManipulabilityAscent,
    ManipulabilityInverse,
    OpenLoop,
    PartialProportional,
    Posture,
    Proportional,
    ProportionalFeedforward,
)
from dqcontrol.limits import CommandLimits
from dqcontrol.loop import close_loop
from dqcontrol.plants import Integrator
from dqcontrol_theses.variants import ClassicProportional

pytestmark = pytest.mark.usefixtures("without_growth")

GAIN = 3.0
LAWS = {
    "open": OpenLoop(),
    "classic": ClassicProportional(gain=GAIN),
    "K": Proportional(gain=GAIN),
    "K+FF": ProportionalFeedforward(gain=GAIN),
    "decoupled": DecoupledProportional(gain=GAIN),
    "position": PartialProportional(part="position", gain=GAIN),
    "rotation": PartialProportional(part="rotation", gain=GAIN),
    "axis": PartialProportional(part="axis", gain=GAIN, axis=(0.6, 0.0, 0.8)),
}


@pytest.fixture(scope="module", params=["iiwa7", "ax18"])
def arm(request):
    return dqc.load_robot(request.param)


def situation(arm, seed):
    """Return q, sample, and the task of each law: the hand's twist, or a part's matrix (in metres) and vector."""
    rng = np.random.default_rng(seed)
    n = arm.configuration_size
    q = rng.uniform(-1, 1, n)
    desired, twist = arm.fkm(q + 0.2 * rng.standard_normal(n)), rng.standard_normal(6)
    x = arm.fkm(q)
    sign = np.sign(algebra.multiply(algebra.conjugate(x), desired)[0])
    xd = sign * desired
    rate = 0.5 * algebra.multiply(np.array([0, *twist[:3], 0, *twist[3:]]), xd)
    error = np.eye(8)[0] - algebra.multiply(algebra.conjugate(x), xd)
    left, length = error_rate(arm, q, xd), FilteredInverse().characteristic_length
    position_error = algebra.translation(xd) - algebra.translation(x)
    turn = algebra.multiply(xd, algebra.conjugate(x))[:4]
    omega = 2 * GAIN * np.sign(turn[0]) * turn[1:]  # nearest to 1 − r*r_d
    axis, axis_d = (
        algebra.adjoint(np.r_[y[:4], 0, 0, 0, 0], [0, 0.6, 0, 0.8, 0, 0, 0, 0])[1:4] for y in (x, xd)
    )
    between = np.cross(axis, axis_d)
    angle = np.arctan2(np.linalg.norm(between), axis @ axis_d)
    angular = hand_jacobian(arm, q)[:3]
    tasks = {
        "open": nearest(pose_rate(arm, q), rate),
        "classic": nearest(pose_rate(arm, q), GAIN * (xd - x)),
        "K": nearest(left, GAIN * error),
        "K+FF": nearest(left, GAIN * error - algebra.multiply(algebra.conjugate(x), rate)),
        "decoupled": np.r_[omega, GAIN * position_error],
        "position": (arm.translation_jacobian(q), GAIN * position_error),
        "rotation": (length * angular, length * omega),
        "axis": (
            length * np.cross(angular, axis[:, None], axis=0),
            length * GAIN * angle * np.cross(between / np.linalg.norm(between), axis),
        ),
    }
    return q, dqc.Sample(desired, twist), tasks


def wanted_command(arm, q, task, inverse, z=0.0):
    """Return z + J⁺ (y − J z) by the SVD."""
    if not isinstance(task, tuple):
        return command(arm, q, task, inverse, z)
    matrix, y = task
    z = np.zeros(matrix.shape[1]) + z
    return z + inverse_by_svd(matrix, inverse) @ (y - matrix @ z)


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("seed", range(4))
def test_command_and_null_space_motion(arm, name, seed):
    q, sample, tasks = situation(arm, seed)
    rest = np.linspace(-0.5, 0.5, arm.configuration_size)
    law = msgspec.structs.replace(LAWS[name], null_space=Posture(gain=1.5, rest=rest.tolist()))
    z = 1.5 * (rest - q)
    exact = wanted_command(arm, q, tasks[name], law.inverse)
    np.testing.assert_allclose(LAWS[name].command(arm, q, sample, 0.01), exact, atol=2e-11)
    wanted = wanted_command(arm, q, tasks[name], law.inverse, z)
    np.testing.assert_allclose(law.command(arm, q, sample, 0.01), wanted, atol=2e-11)


@pytest.mark.parametrize("inverse", [DampedInverse(damping=0.1), FilteredInverse(threshold=0.6, damping=0.2)])
@pytest.mark.parametrize("name", LAWS)
def test_inverses_act_on_the_hand_s_twist_whatever_the_law(arm, name, inverse):
    q, sample, tasks = situation(arm, 7)
    law = msgspec.structs.replace(LAWS[name], inverse=inverse)
    wanted = wanted_command(arm, q, tasks[name], inverse)
    np.testing.assert_allclose(law.command(arm, q, sample, 0.01), wanted, atol=1e-11)


def test_manipulability_inverse():
    arm = dqc.load_robot("iiwa7")
    q, sample, tasks = situation(arm, 3)
    hand = np.vstack([arm.twist_jacobian(q)[:3], arm.translation_jacobian(q)])
    m = np.sqrt(np.linalg.det(hand @ hand.T))
    exact = np.linalg.pinv(hand) @ tasks["K"]
    relaxed = Proportional(gain=GAIN, inverse=ManipulabilityInverse(threshold=0.9 * m, damping=0.1))
    np.testing.assert_allclose(relaxed.command(arm, q, sample, 0.01), exact, atol=1e-11)
    threshold = 2 * m
    damped = Proportional(gain=GAIN, inverse=ManipulabilityInverse(threshold=threshold, damping=0.1))
    damping = 0.1**2 * (1 - m / threshold) ** 2
    weights = np.diag(np.r_[np.full(3, 0.3**-2), np.ones(3)])
    wanted = hand.T @ np.linalg.solve(hand @ hand.T + damping * weights, hand @ exact)
    np.testing.assert_allclose(damped.command(arm, q, sample, 0.01), wanted, atol=1e-11)


@pytest.mark.parametrize("seed", range(5))
def test_manipulability_gradient_is_the_derivative(seed):
    arm = dqc.load_robot("iiwa7")
    q = np.random.default_rng(seed).uniform(-1.5, 1.5, 7)

    def manipulability(q):
        jacobian = arm.twist_jacobian(q)
        return np.sqrt(np.linalg.det(jacobian @ jacobian.T))

    h = 1e-6
    wanted = [(manipulability(q + h * e) - manipulability(q - h * e)) / (2 * h) for e in np.eye(7)]
    law = Proportional(gain=1.0, null_space=ManipulabilityAscent(gain=3.0)).prepare(arm, None, 0.01)
    law.command(q, dqc.Sample(arm.fkm(q)), law.initial_state(q))
    np.testing.assert_allclose(law.preferred, 3.0 * np.array(wanted), atol=3e-8)


def run(law, q0, seconds=4.0, limits=None, interpreted=False, hand=None):
    arm = dqc.load_robot("iiwa7")
    period = 0.01
    steps = round(seconds / period)
    target = dqc.references.SetPoint(arm.fkm(q0) if hand is None else hand)
    prepared = law.prepare(arm, target, period, limits)
    plant = Integrator().start(arm, q0, period, steps, 0)
    return arm, close_loop(
        prepared, plant, target.samples(period * np.arange(steps)), interpreted=interpreted
    )


def test_manipulability_ascends_while_the_hand_rests():
    q0 = np.array([0.4, 0.3, 0.8, 1.0, -0.5, 0.8, 0.1])
    arm, trace = run(Proportional(gain=5.0, null_space=ManipulabilityAscent(gain=20.0)), q0)
    jacobian = arm.twist_jacobian(trace.q)
    m = np.sqrt(np.linalg.det(jacobian @ jacobian.swapaxes(-1, -2)))
    assert (np.diff(m) > -1e-9).all()
    assert m[-1] > 1.02 * m[0]
    np.testing.assert_allclose(arm.fkm(trace.q[-1]), arm.fkm(q0), atol=1e-3)


def test_posture_is_approached_while_the_hand_rests():
    q0 = np.array([0.4, 0.3, 0.8, 1.0, -0.5, 0.8, 0.1])
    arm, trace = run(Proportional(gain=5.0, null_space=Posture(gain=2.0)), q0, seconds=10.0)
    distance = np.linalg.norm(trace.q, axis=1)
    assert (np.diff(distance) < 1e-6).all()

    def free(q):  # the part of the way to the rest posture that leaves the hand alone
        jacobian = arm.twist_jacobian(q)
        return np.linalg.norm(q - np.linalg.pinv(jacobian) @ (jacobian @ q))

    assert free(trace.q[0]) > 0.1
    assert free(trace.q[-1]) < 1e-5


def test_open_loop_drifts_and_closed_loop_does_not():
    arm = dqc.load_robot("iiwa7")
    q0, period = np.array([0, 0.6, 0, 1.6, 0, 0.6, 0.0]), 0.01
    circle = dqc.references.Circle(arm.fkm(q0), radius=0.07, duration=6.0)
    samples = circle.samples(period * np.arange(600))
    ends = {}
    for name, law in {"open": OpenLoop(), "closed": ProportionalFeedforward(gain=5.0)}.items():
        plant = Integrator().start(arm, q0, period, 600, 0)
        ends[name] = close_loop(law.prepare(arm, circle, period), plant, samples).q[-1]
    error = {k: np.linalg.norm(arm.fkm(q)[4:] - samples[-1, 4:8]) for k, q in ends.items()}
    assert error["open"] > 3 * error["closed"]


@pytest.mark.parametrize("name", ["classic", "K", "decoupled"])
def test_position_error_decays_at_the_gain(name):
    arm = dqc.load_robot("iiwa7")
    q0, period, k = np.array([0, 0.6, 0, 1.6, 0, 0.6, 0.0]), 1e-3, 3.0
    hand = algebra.pose(
        algebra.rotation(arm.fkm(q0)), algebra.translation(arm.fkm(q0)) + np.array([0.002, 0.001, -0.002])
    )
    target = dqc.references.SetPoint(hand)
    law = msgspec.structs.replace(LAWS[name], gain=k).prepare(arm, target, period)
    trace = close_loop(
        law, Integrator().start(arm, q0, period, 1000, 0), target.samples(period * np.arange(1000))
    )
    error = np.linalg.norm(algebra.translation(arm.fkm(trace.q)) - algebra.translation(hand), axis=1)
    rate = -np.log(error[999] / error[0]) / (999 * period)
    assert rate == pytest.approx(-np.log(1 - k * period) / period, abs=2e-3)  # 3.0045


def test_axis_law_leaves_the_rest_of_the_pose_alone():
    q0 = np.array([0.4, 0.3, 0.8, 1.0, -0.5, 0.8, 0.1])
    arm = dqc.load_robot("iiwa7")
    hand = arm.fkm(q0 + 0.3)
    law = PartialProportional(part="axis", gain=4.0, axis=(0, 0, 2.0))
    arm, trace = run(law, q0, hand=hand)
    z = [algebra.matrix_from_pose(x)[:3, 2] for x in (arm.fkm(trace.q[-1]), hand)]
    np.testing.assert_allclose(z[0], z[1], atol=1e-5)
    assert np.abs(algebra.translation(arm.fkm(trace.q[-1])) - algebra.translation(hand)).max() > 1e-2


@pytest.mark.parametrize("interpreted", [False, True])
def test_velocity_limits_keep_the_direction(interpreted):
    q0 = np.array([0.4, 0.3, 0.8, 1.0, -0.5, 0.8, 0.1])
    arm = dqc.load_robot("iiwa7")
    law, hand = Proportional(gain=20.0), arm.fkm(q0 + 0.5)
    _, free = run(law, q0, 0.02, hand=hand, interpreted=interpreted)
    _, kept = run(law, q0, 0.02, CommandLimits(velocity=True), hand=hand, interpreted=interpreted)
    ratio = np.abs(kept.command[0]) / arm.limits.velocity
    assert ratio.max() == pytest.approx(1.0, abs=1e-12)
    scale = kept.command[0] / free.command[0]
    np.testing.assert_allclose(scale, scale[0], rtol=1e-12)
    assert 0 < scale[0] < 1


@pytest.mark.parametrize("name", LAWS)
def test_interpreted_and_compiled_runs_are_equal_to_the_last_bit(name):
    q0 = np.array([0.4, 0.3, 0.8, 1.0, -0.5, 0.8, 0.1])
    hand = dqc.load_robot("iiwa7").fkm(q0 + 0.3)
    law = msgspec.structs.replace(LAWS[name], null_space=ManipulabilityAscent(gain=5.0))
    traces = [
        run(law, q0, 0.5, CommandLimits(velocity=True), interpreted=mode, hand=hand)[1]
        for mode in (False, True)
    ]
    assert np.array_equal(traces[0].q, traces[1].q)
    assert np.array_equal(traces[0].command, traces[1].command)


@pytest.mark.parametrize(
    ("law", "message"),
    [
        (
            lambda: PartialProportional(part="roll", gain=1.0),
            r"part: unknown name 'roll'.*allowed: position, rotation, axis",
        ),
        (lambda: PartialProportional(part="axis", gain=1.0, axis=(0, 0, 0)), "axis: must not be zero"),
        (lambda: PartialProportional(part="position", gain=-1.0), "gain: must be > 0, got -1"),
        (lambda: Posture(gain=0.0), "null_space.gain: must be > 0, got 0"),
        (
            lambda: Proportional(gain=1.0, null_space=Posture(gain=1.0, rest=[0.0])),
            r"null_space.rest: .*got shape \(1,\)",
        ),
        (lambda: ManipulabilityAscent(gain=-1.0), "null_space.gain: must be > 0"),
        (
            lambda: ManipulabilityInverse(threshold=0.0),
            "inverse.threshold: must be > 0",
        ),
    ],
)
def test_bad_parameters_are_refused(law, message):
    with pytest.raises(Error, match=message):
        law().prepare(dqc.load_robot("iiwa7"), None, 0.01)


def test_velocity_limits_need_a_robot_that_has_some():
    arm = dqc.SerialArm.from_dh([0, 0], [0, 0], [1, 1], [0, 0])
    with pytest.raises(Error, match=r"limits.velocity: arm has no velocity limits"):
        Proportional(gain=1.0).prepare(arm, None, 0.01, CommandLimits(velocity=True))


@pytest.mark.parametrize("angle", [0.3, 2.0, 3.1, np.pi])
def test_an_axis_turns_at_the_rate_k_of_its_angle(angle):
    """θ decays as exp(−kt), from half a turn too, where k (l_d − l) never moves."""
    arm, q = dqc.load_robot("iiwa7"), np.array([0.2, 0.6, 0.1, 1.6, -0.3, 0.9, 0.4])
    turn = algebra.pose([np.cos(angle / 2), np.sin(angle / 2), 0, 0], [0, 0, 0])
    target = dqc.references.SetPoint(algebra.multiply(arm.fkm(q), turn))
    law, period = PartialProportional(part="axis", gain=2.0), 1e-3
    record = dqc.simulate(arm, target, law, Integrator(), q, period, 0.5)
    z = np.array(
        [algebra.adjoint(np.r_[x[:4], 0, 0, 0, 0], [0, 0, 0, 1, 0, 0, 0, 0])[1:4] for x in record.pose]
    )
    z_d = algebra.adjoint(np.r_[target.at(0).pose[:4], 0, 0, 0, 0], [0, 0, 0, 1, 0, 0, 0, 0])[1:4]
    left = np.arctan2(np.linalg.norm(np.cross(z, z_d), axis=1), z @ z_d)
    np.testing.assert_allclose(left, angle * (1 - 2.0 * period) ** np.arange(len(left)), atol=2e-3)

"""Closed loops on ideal joints: rates, monotony, stability limits."""

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol import algebra
from dqcontrol.laws import Proportional
from dqcontrol.loop import close_loop
from dqcontrol.plants import Integrator, Servo
from dqcontrol.references import Sample, SetPoint

pytestmark = pytest.mark.usefixtures("without_growth")

SEED = 20260714
Q0 = np.array([0.2, 0.6, 0.1, 1.6, -0.3, 0.9, 0.4])
AT_ONCE = 1e-9  # a time constant after which a servo is where it was told to be


def towards(arm, q0, desired, gain, period, steps, plant=None):
    """Return the configurations on the way to a resting target."""
    samples = SetPoint(desired).samples(period * np.arange(steps))
    law = Proportional(gain=gain).prepare(arm, None, period)
    return close_loop(law, (plant or Integrator()).start(arm, q0, period, steps, SEED), samples).q


def errors(arm, q, desired):
    return algebra.short(algebra.multiply(algebra.conjugate(arm.fkm(q)), desired)) - np.eye(8)[0]


def turned(pose, angle, axis):
    axis = np.array(axis) / np.linalg.norm(axis)
    return algebra.multiply(
        pose, np.concatenate([[np.cos(angle / 2)], np.sin(angle / 2) * axis, np.zeros(4)])
    )


def test_rate_of_a_translation_error():
    arm, k, period, steps = dqc.load_robot("iiwa7"), 3.0, 1e-3, 1001
    pose = arm.fkm(Q0)
    desired = algebra.pose(algebra.rotation(pose), algebra.translation(pose) + np.array([0.03, -0.02, 0.04]))
    e = np.linalg.norm(errors(arm, towards(arm, Q0, desired, k, period, steps), desired), axis=1)
    rate = -np.log(e[-1] / e[0]) / (period * (steps - 1))
    assert rate == pytest.approx(-np.log(1 - k * period) / period, abs=1e-3)
    assert rate == pytest.approx(3.005, abs=1e-3)


@pytest.mark.parametrize("angle", [0.5, 1.5, 2.5])
def test_rate_of_a_rotation_error(angle):
    """tan(θ/4) ∝ exp(−kt), to first order in kT."""
    arm, k, period, steps = dqc.load_robot("iiwa7"), 3.0, 1e-4, 10001
    desired = turned(arm.fkm(Q0), angle, [0.2, 0.3, 1.0])
    e = errors(arm, towards(arm, Q0, desired, k, period, steps), desired)
    theta = 4 * np.arcsin(np.linalg.norm(e[:, :4], axis=1) / 2)
    assert theta[0] == pytest.approx(angle)
    time = period * np.arange(steps)
    assert np.tan(theta / 4) == pytest.approx(np.tan(angle / 4) * np.exp(-k * time), rel=2e-3)
    assert 2 * np.abs(e[:, 4:]).max() < 1e-3  # the hand stays where it is


def test_error_never_grows(make_arm):
    rng = np.random.default_rng(SEED)
    for seed in range(8):
        arm = make_arm(7, seed=seed)
        q0 = rng.uniform(-1, 1, 7)
        desired = arm.fkm(q0 + rng.uniform(-1, 1, 7))
        q = towards(arm, q0, desired, 2.0, 1e-3, 3000)
        e = np.linalg.norm(errors(arm, q, desired), axis=1)
        assert np.diff(e).max() < 1e-12
        assert e[-1] < 0.2 * e[0]


@pytest.mark.parametrize(("product", "stable"), [(0.5, True), (1.0, True), (1.9, True), (2.1, False)])
def test_stable_below_two_on_ideal_joints(product, stable):
    arm, period = dqc.load_robot("iiwa7"), 0.01
    desired = arm.fkm(Q0 + 1e-5)
    e = np.linalg.norm(errors(arm, towards(arm, Q0, desired, product / period, period, 61), desired), axis=1)
    assert (e[-1] < 0.01 * e[0]) == stable
    if not stable:
        assert e[-1] > 100 * e[0]


@pytest.mark.parametrize(
    ("delay", "limit"),
    [(0, 2.0), (1, 1.0), (2, (np.sqrt(5) - 1) / 2)],
    ids=["no delay", "one sample", "two samples"],
)
def test_stability_limit_with_delay(slide, delay, limit):
    """One sliding joint and a servo without lag: z^d (z − 1) + kT has all roots in the unit circle."""
    period = 0.01
    plant = Servo(time_constant=AT_ONCE, delay=delay * period)
    for product, stable in ((0.97 * limit, True), (1.03 * limit, False)):
        desired = slide.fkm([0.1])
        q = towards(slide, np.zeros(1), desired, product / period, period, 2000, plant)[:, 0]
        late = np.abs(q[-100:] - 0.1).max()
        assert late < 1e-6 if stable else late > 10


def lagging_limit(decay, delay):
    """Return the largest stable kT of z^(d+1) = a z^d + (1 − a)(1 − kT): measured + T u, d samples late."""
    products = np.linspace(0.01, 20, 20000)
    constant = -(1 - decay) * (1 - products)
    largest = [
        np.abs(np.roots([1, -decay, *[0] * (delay - 1), c] if delay else [1, c - decay])).max()
        for c in constant
    ]
    return products[np.argmax(np.array(largest) > 1)]


@pytest.mark.parametrize(
    "delay", [pytest.param(0, marks=pytest.mark.slow), 1, pytest.param(2, marks=pytest.mark.slow)]
)
@pytest.mark.parametrize(
    ("period", "published"),
    [pytest.param(0.008, 13.5, id="8 ms", marks=pytest.mark.slow), pytest.param(0.02, 6.1, id="20 ms")],
)
def test_stability_limit_of_a_lagging_servo(slide, period, published, delay):
    limit = lagging_limit(np.exp(-period / 0.05), delay)
    if delay == 0:
        assert limit == pytest.approx(published, abs=0.05)
    plant = Servo(command_mode="measured", time_constant=0.05, delay=delay * period)
    for product, stable in ((0.98 * limit, True), (1.02 * limit, False)):
        q = towards(slide, np.zeros(1), slide.fkm([0.1]), product / period, period, 4000, plant)[:, 0]
        late = np.abs(q[-100:] - 0.1).max()
        assert late < 1e-6 if stable else late > 10, product


def test_half_a_turn_away_with_noise_the_sign_rarely_flips():
    arm, period, steps = dqc.load_robot("iiwa7"), 1e-3, 400
    desired = turned(arm.fkm(Q0), np.pi, [0, 0, 1])
    flips = {}
    for hysteresis in (0.0, 0.2):
        law = Proportional(gain=2.0, hysteresis=hysteresis).prepare(arm, None, period)
        rng, q, state, signs = np.random.default_rng(SEED), Q0.copy(), law.initial_state(Q0), []
        for _ in range(steps):
            u = law.command(q + 0.05 * rng.normal(size=7), Sample(desired), state)
            q += period * u
            signs.append(state[0])
        flips[hysteresis] = np.count_nonzero(np.diff(signs))
    assert flips[0.0] > 20
    assert flips[0.2] <= 1

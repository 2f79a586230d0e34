"""Gain limits against closed forms, published numbers and closed loops at both sides of them."""

from typing import Any

import numpy as np
import pytest
from scipy.signal import cont2discrete, tf2ss

import dqcontrol as dqc
from dqcontrol import algebra
from dqcontrol.laws import (
    DecoupledProportional,
    FeedbackLinearization,
    HInfinity,
    HInfinityTracking,
    LinearQuadraticDQ,
    LinearQuadraticR8,
    PartialProportional,
    Proportional,
    ProportionalFeedforward,
)
from dqcontrol.measures.stability import (
    LoopGain,
    damped_overshoot,
    damping_limit,
    gain_limits,
    gain_margin,
    large_error_limit,
    loop_gains,
    overshoot,
    spectral_radius,
    stability_limit,
    with_integral,
    with_lag,
    with_mean,
)
from dqcontrol.plants import Integrator, MujocoPlant, Servo
from dqcontrol.plants.linear_model import LinearModel
from dqcontrol.references import SetPoint
from dqcontrol_theses.variants import ClassicProportional

T, TAU = 0.01, 0.05
Q0 = np.array([0.2, 0.6, 0.1, 1.6, -0.3, 0.9, 0.4])
LAWS = {  # with loop gain k in position and orientation
    "classic": lambda k: ClassicProportional(gain=k),
    "K": lambda k: Proportional(gain=k),
    "K+FF": lambda k: ProportionalFeedforward(gain=k),
    "decoupled": lambda k: DecoupledProportional(gain=k),
    "position": lambda k: PartialProportional(part="position", gain=k),
    "rotation": lambda k: PartialProportional(part="rotation", gain=k),
    "axis": lambda k: PartialProportional(part="axis", gain=k),
    "HIR": lambda k: HInfinity(translation_gain=k, orientation_gain=2 * k),
    "HIRT left": lambda k: HInfinityTracking(translation_gain=k, orientation_gain=2 * k, form="left"),
    "LQR-R8": lambda k: LinearQuadraticR8(error_weight=k**2, control_weight=1.0),
    "LQR-DQ": lambda k: LinearQuadraticDQ(error_weight=k**2, control_weight=1.0),
}
PLANTS = {
    "ideal": Integrator(),
    **{
        f"{mode} {delay}": Servo(command_mode=mode, time_constant=TAU, delay=delay * T)
        for mode in ("integrated", "measured")
        for delay in (0, 1, 2, 4)
    },
}


@pytest.fixture(scope="module")
def arm():
    return dqc.load_robot("iiwa7")


def limits_of(plant, period=T):
    return gain_limits(plant.linear_model(dqc.load_robot("iiwa7"), None, period), period)


def delayed(transition, inputs, delay):
    """Return the model with its command d samples late."""
    size = len(transition)
    late = np.zeros((size + delay, size + delay))
    late[:size, :size] = transition
    column = np.zeros((size + delay, 1))
    if not delay:
        return LinearModel(transition, inputs)
    late[:size, size : size + 1] = inputs
    late[range(size, size + delay - 1), range(size + 1, size + delay)] = 1.0
    column[-1] = 1.0
    return LinearModel(late, column)


@pytest.mark.parametrize("delay", range(7))
def test_ideal_joints_with_delay(delay):
    """z^d (z − 1) + kT: stable to 2 sin(π/(4d + 2)), a double pole at kT = d^d/(d + 1)^(d + 1)."""
    limits = gain_limits(delayed(np.ones((1, 1)), np.full((1, 1), T), delay), T)
    assert limits.stable == pytest.approx(2 * np.sin(np.pi / (4 * delay + 2)), rel=1e-6)
    assert limits.monotone == pytest.approx(delay**delay / (delay + 1) ** (delay + 1), rel=1e-6)
    assert limits.recommended <= 0.5 * limits.stable + 1e-9
    at_once = limits_of(Servo(time_constant=1e-9, delay=delay * T))
    assert at_once.stable == pytest.approx(limits.stable, rel=1e-6)


@pytest.mark.parametrize(
    ("period", "published"), [(0.008, (2.06, 0.70, 0.43)), (0.02, (2.14, 0.73, 0.46))], ids=["8 ms", "20 ms"]
)
def test_a_velocity_servo(period, published):
    """A joint whose velocity follows the command with a lag of 50 ms, held over the period: no plant here is that."""
    a, b, c, d = tf2ss([1.0], [TAU, 1.0, 0.0])
    discrete: Any = cont2discrete((a, b, c, d), period)
    a, b, c, *_ = discrete
    to_output = np.vstack([c, [[0.0, 1.0]] if c[0, 0] else [[1.0, 0.0]]])
    a, b = to_output @ a @ np.linalg.inv(to_output), to_output @ b
    for delay, wanted in enumerate(published):
        limits = gain_limits(delayed(a, b, delay), period)
        assert limits.stable == pytest.approx(wanted, abs=0.006)
        radius = spectral_radius(delayed(a, b, delay).poles(1 / period))
        assert (radius < 1) == (limits.stable > 1)
        if delay == 0 and period == 0.008:
            assert radius == pytest.approx(0.96, abs=0.005)


@pytest.mark.parametrize(
    ("period", "published"), [(0.008, (13.5, 6.8, 4.2)), (0.02, (6.1, 3.0, 1.9))], ids=["8 ms", "20 ms"]
)
def test_a_position_servo_commanded_from_the_measured_position(period, published):
    """Published with a delay of the command alone; `Servo` delays the target, measured position and all."""
    decay = np.exp(-period / TAU)
    for delay, wanted in enumerate(published):
        alone = delayed(np.ones((1, 1)), np.full((1, 1), (1 - decay) * period), delay)
        assert gain_limits(alone, period).stable == pytest.approx(wanted, abs=0.06)
    ours = [
        limits_of(Servo(command_mode="measured", time_constant=TAU, delay=delay * period), period).stable
        for delay in (0, 1)
    ]
    assert ours == pytest.approx([2 / (1 - decay), 1 + 1 / (1 - decay)], rel=1e-6)


@pytest.mark.parametrize("tau", [0.002, 0.05, 1.0])
def test_a_servo_with_its_target_integrated(tau):
    """z² − (1 + a − κ) z + a with κ = kT (1 − a): real poles up to (1 − √a)², −1 reached at 2 (1 + a)."""
    a = np.exp(-T / tau)
    limits = limits_of(Servo(time_constant=tau))
    assert limits.stable == pytest.approx(2 * (1 + a) / (1 - a), rel=1e-6)
    assert limits.monotone == pytest.approx((1 - np.sqrt(a)) ** 2 / (1 - a), rel=1e-5)
    assert limits_of(Servo(time_constant=tau, delay=T)).stable == pytest.approx(1, rel=1e-6)
    if tau == 1.0:  # slow against the period: k τ = 1/(4 ζ²)
        assert limits.recommended * tau / T == pytest.approx(1 / (4 * 0.7**2), rel=0.01)


def test_the_first_crossing_counts():
    """A resonance that leaves the circle, returns at four times the gain and leaves again at 65 times."""
    denominator = np.polymul([1, -1], [1, -2 * 0.99198 * np.cos(0.2586), 0.99198**2])
    numerator = np.array([1, -2 * 0.84686 * np.cos(0.28006), 0.84686**2])
    model = LinearModel(
        np.array([[-denominator[1], 1, 0], [-denominator[2], 0, 1], [-denominator[3], 0, 0]]),
        numerator[:, None],
    )
    assert gain_limits(model, 1.0).stable == pytest.approx(0.0345, rel=0.02)
    assert [spectral_radius(model.poles(k)) < 1 for k in (0.03, 0.06, 0.5, 3.0)] == [True, False, True, False]


@pytest.mark.parametrize("angle", [0.3, 1.0, 1.5, 2.0])
def test_rates_that_turn(angle):
    """|1 − kT| < 1 for k = |k| exp(iφ): |k| T < 2 cos φ; never monotone."""
    limits = gain_limits(Integrator().linear_model(dqc.load_robot("iiwa7"), None, T), T, np.exp(1j * angle))
    assert limits.stable == pytest.approx(max(2 * np.cos(angle), 0), rel=1e-6)
    assert limits.monotone == 0


def test_what_becomes_of_errors():
    limits = limits_of(Integrator())
    products = {
        0.0: "drifts",
        1e-9: "good",
        0.5: "good",
        1.0: "good",
        1.01: "oscillatory",
        1.99: "oscillatory",
        2.0: "unstable",
        1e9: "unstable",
    }
    assert {product: limits.verdict(product) for product in products} == products


def errors_at_both_ends(arm, law, plant, steps, part="all"):
    """Return the error at the first and the largest in the last tenth of a run that starts with a small one."""
    free = dqc.limits.CommandLimits(velocity=False)  # which would bound how far an unstable loop goes
    record = dqc.simulate(arm, SetPoint(arm.fkm(Q0 + 1e-5)), law, plant, Q0, T, T * (steps - 1), limits=free)
    if part == "axis":
        ahead, wanted = (algebra.matrix_from_pose(x)[..., :3, 2] for x in (record.pose, record.desired_pose))
        errors = np.linalg.norm(ahead - wanted, axis=1)
    else:
        names = {"position": "position_error", "rotation": "orientation_error"}
        errors = getattr(record, names.get(part, "error"))
    return errors[0], errors[-steps // 10 :].max() if record.stopped == "duration" else np.inf


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize(
    "plant", [pytest.param(name, marks=pytest.mark.slow if name[-1] in "14" else ()) for name in PLANTS]
)
def test_loops_settle_below_the_limit_and_not_above(arm, law, plant):
    limit = limits_of(PLANTS[plant]).stable
    for share, stable in ((0.95, True), (1.05, False)):
        first, last = errors_at_both_ends(arm, LAWS[law](share * limit / T), PLANTS[plant], 4000, law)
        assert last < 0.1 * first if stable else last > 20 * first, (share, first, last)


@pytest.mark.parametrize("damping", [0.1, 1.0, 10.0, 150.0])
def test_a_law_of_accelerations_on_ideal_joints(damping):
    """(k̄/4) T² < 4 − 2 k_v T with k̄ = 4 k_v k; ζ = k_v/√k̄ for a short period."""
    limits = gain_limits(with_lag(LinearModel(np.ones((1, 1)), np.full((1, 1), T)), damping, T), T)
    assert limits.stable * damping * T == pytest.approx(4 - 2 * damping * T, rel=1e-6)
    if damping <= 1:
        assert limits.recommended / T == pytest.approx(damping / (4 * 0.7**2), rel=0.02)


@pytest.mark.usefixtures("without_growth")
@pytest.mark.parametrize("plant", ["ideal", "integrated 0", "integrated 2", "measured 1"])
@pytest.mark.parametrize("damping", [2.0, 40.0])
def test_feedback_linearisation_settles_below_the_limit_and_not_above(arm, plant, damping):
    model = PLANTS[plant].linear_model(arm, None, T)
    limit = gain_limits(with_lag(model, damping, T), T).stable
    for share, stable in ((0.95, True), (1.05, False)):
        law = FeedbackLinearization(stiffness=4 * damping * share * limit / T, damping=damping)
        first, last = errors_at_both_ends(arm, law, PLANTS[plant], 8000)
        assert last < 0.1 * first if stable else last > 20 * first, (share, first, last)


@pytest.mark.parametrize("mode", ["integrated", "measured"])
@pytest.mark.parametrize("options", [{}, {"bandwidth": 5.0, "damping_ratio": 0.5}], ids=["default", "soft"])
def test_physics_settles_below_the_limit_and_not_above(arm, mode, options):
    pytest.importorskip("mujoco")
    plant = MujocoPlant(command_mode=mode, **options)
    limit = gain_limits(plant.linear_model(arm, Q0, T), T).stable
    for share, stable in ((0.95, True), (1.05, False)):
        first, last = errors_at_both_ends(arm, Proportional(gain=share * limit / T), plant, 1000)
        assert last < 0.1 * first if stable else last > 3 * first, (share, first, last)


def supervised(arm, gain, plant, target, supervisor, seconds):
    """Return the errors of a loop behind a supervisor."""
    goal, law = SetPoint(arm.fkm(target)), Proportional(gain=gain)
    free = dqc.limits.CommandLimits(velocity=False)
    record = dqc.simulate(arm, goal, law, plant, Q0, T, seconds, supervisor=supervisor, limits=free)
    return record.error


@pytest.mark.parametrize("mode", ["integrated", "measured"])
@pytest.mark.parametrize(("tau", "delay", "window"), [(0.05, 0.0, 20), (0.05, 0.02, 8), (0.1, 0.013, 2)])
def test_a_supervisor_s_smoothing_is_in_the_loop(arm, mode, tau, delay, window):
    """The mean of the last rates lags by half its window: stable and unstable 5 % to both sides of the limit."""
    plant = Servo(command_mode=mode, time_constant=tau, delay=delay)
    alone = plant.linear_model(arm, Q0, T)
    limit = gain_limits(with_mean(alone, window, T, from_measured=mode == "measured"), T).stable / T
    assert abs(limit * T / gain_limits(alone, T).stable - 1) > 0.1, "without it another limit was told"
    wide = {"acceleration": 1e3, "jerk": 2e3 / (window * T), "velocity": 1e3, "tracking_error": 1e6}
    supervisor = dqc.supervisor.Supervisor(**wide, ramp=0.0, slow_below=0.0, hold_below=0.0)
    assert supervisor.prepare(arm, T).window == window
    for share, stable in ((0.95, True), (1.05, False)):
        error = supervised(arm, share * limit, plant, Q0 + 1e-5, supervisor, 40.0)
        last = error[-400:].max()
        assert last < 0.1 * error[0] if stable else last > 20 * error[0], (share, error[0], last)


@pytest.mark.usefixtures("without_growth")
@pytest.mark.parametrize(("tau", "delay"), [(0.05, 0.0), (0.05, 0.02), (0.02, 0.02)])
def test_large_errors_oscillate_for_ever_at_a_limit_of_acceleration(arm, tau, delay):
    """Harmonic balance says from which gain on; loops do so within half as much again, and not below."""
    plant = Servo(time_constant=tau, delay=delay)
    model = plant.linear_model(arm, Q0, T)
    limit = large_error_limit(model, T) / T
    assert limit < 0.9 * gain_limits(model, T).stable / T, "for small errors it is stable"
    supervisor = dqc.supervisor.Supervisor(acceleration=10.0, velocity=100.0, tracking_error=100.0, ramp=0.0)
    far = Q0 + np.array([0.3, 0, 0, 0, 0, 0, 0])
    for share, stable in ((0.95, True), (1.5, False)):
        error = supervised(arm, share * limit, plant, far, supervisor, 20.0)
        assert error[-200:].max() < 1e-3 if stable else error[-200:].max() > 1e-2, share


@pytest.mark.parametrize("plant", ["integrated 1", "measured 2"])
@pytest.mark.parametrize("share", [0.3, 0.6])
def test_overshoot_is_that_of_the_run(arm, plant, share):
    model = PLANTS[plant].linear_model(arm, None, T)
    gain = share * gain_limits(model, T).stable / T
    goal, law = SetPoint(arm.fkm(Q0 + 1e-4)), Proportional(gain=gain)
    record = dqc.simulate(arm, goal, law, PLANTS[plant], Q0, T, 5.0)
    found = dqc.measures.evaluate(record).position_overshoot
    assert found == pytest.approx(overshoot(model, gain), abs=0.01)


@pytest.mark.parametrize("delay", [0.004, 0.013, 0.0275])
def test_delays_that_end_within_a_period(arm, delay):
    plant, begun = Servo(time_constant=TAU, delay=delay), int(delay / T)
    limit = limits_of(plant).stable
    low, high = (limits_of(Servo(time_constant=TAU, delay=T * whole)).stable for whole in (begun, begun + 1))
    assert high < limit < low
    for share, stable in ((0.95, True), (1.05, False)):
        first, last = errors_at_both_ends(arm, Proportional(gain=share * limit / T), plant, 4000)
        assert last < 0.1 * first if stable else last > 20 * first, (share, first, last)


def test_no_lag_at_all():
    limits = limits_of(Servo(time_constant=0.0))
    assert (limits.stable, limits.monotone) == pytest.approx((2, 1))


@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize(("gain", "integral"), [(1e-308, 1e-300), (1e-300, 0.0), (1e-15, 0.0), (1e300, 1e6)])
def test_extreme_gains_are_judged_without_a_warning(gain, integral):
    """So small ones leave a pole at 1 but for rounding, where the damping ratio is 0/0."""
    arm, law = dqc.load_robot("iiwa7"), Proportional(gain=gain, integral_gain=integral)
    found = loop_gains(law, law.prepare(arm, None, T))
    assert found is not None
    for loop in found:
        share = loop.integral_share
        limits = gain_limits(Servo().linear_model(arm, None, T), T, 1.0, share)
        assert limits.stable == 0 if share else limits.stable > 0
    assert damped_overshoot(np.array([1.0, 0.5], dtype=complex)) == 0


@pytest.mark.parametrize("share", [0.05, 0.25, 1.0, 4.0])
def test_an_integral_takes_gain_away(share):
    """z² − (2 − P − sP²) z + 1 − P with P = kT, s = k_I/k²: stable to P = (√(1 + 4s) − 1)/s."""
    ideal = LinearModel(np.ones((1, 1)), np.full((1, 1), T))
    expected = min((np.sqrt(1 + 4 * share) - 1) / share, 2)
    assert stability_limit(ideal, T, integral_share=share) == pytest.approx(expected, rel=2e-7)
    assert gain_limits(ideal, T, integral_share=share).stable == pytest.approx(expected, rel=2e-7)


@pytest.mark.parametrize(("damping", "share"), [(0.5, 0.6), (0.7, 0.4), (0.9, 0.28)])
def test_with_an_integral_poles_are_damped_until_the_slowest_is_negative(damping, share):
    """Both are real and as large where 2 − P − sP² = 0; at small gains the damping ratio is ½/√s."""
    ideal = LinearModel(np.ones((1, 1)), np.full((1, 1), T))
    expected = (np.sqrt(1 + 8 * share) - 1) / (2 * share)
    assert damping_limit(ideal, T, damping, share) == pytest.approx(expected, rel=1e-5)
    assert damping_limit(ideal, T, 0.51 / np.sqrt(share), share) < 1e-3


@pytest.mark.parametrize("share", [0.0, 0.3])
@pytest.mark.parametrize("direction", [1.0, np.exp(0.4j)])
def test_many_gains_at_once_have_the_limit_of_one_at_a_time(share, direction):
    rng = np.random.default_rng(8)  # two joints that move each other, each with a lag
    coupled = np.eye(2) * 0.7 + rng.normal(0, 0.05, (2, 2))
    model = LinearModel(
        np.block([[np.eye(2), 0.3 * np.eye(2)], [np.zeros((2, 2)), coupled]]),
        np.vstack([np.zeros((2, 2)), 0.01 * (np.eye(2) + rng.normal(0, 0.1, (2, 2)))]),
    )
    found = stability_limit(model, T, direction, share)
    assert found == pytest.approx(gain_limits(model, T, direction, share).stable, rel=1e-6)
    gain = found / T
    for factor, is_stable in ((0.999, True), (1.001, False)):
        k = gain * factor
        poles = with_integral(model, share * k, T).poles(k * direction)
        assert (spectral_radius(poles) < 1) == is_stable


def test_a_measured_integral_is_the_sum_of_what_was_measured():
    """w_j = y_j + ρT Σ_{i ≤ j} y_i along a run of a plant that moves by itself."""
    rng = np.random.default_rng(4)
    model = LinearModel(rng.normal(0, 0.4, (3, 3)), rng.normal(0, 1, (3, 2)))
    seen, state = with_integral(model, 7.0, T), rng.normal(size=3)
    total = state[:2].copy()
    measured = np.concatenate([state[:2] + 7.0 * T * total, state])
    for command in rng.normal(size=(20, 2)):
        state = model.transition @ state + model.inputs @ command
        measured = seen.transition @ measured + seen.inputs @ command
        total += state[:2]
        np.testing.assert_allclose(measured[:2], state[:2] + 7.0 * T * total, atol=1e-12)


@pytest.mark.parametrize("damping", [0.1, 0.5, 0.7, 0.95])
def test_the_overshoot_of_a_damped_pair_of_poles(damping):
    step = np.linspace(0, 40, 200_001)
    rate = np.sqrt(1 - damping**2)
    answer = 1 - np.exp(-damping * step) * (np.cos(rate * step) + damping / rate * np.sin(rate * step))
    poles = np.exp(T * np.array([-damping + 1j * rate, -damping - 1j * rate]))
    assert damped_overshoot(np.append(poles, 0.1)) == pytest.approx(answer.max() - 1, rel=1e-5)


def test_real_poles_pass_nothing_and_poles_on_the_unit_circle_do_not_end():
    assert damped_overshoot(np.array([0.9, 0.5], complex)) == 0
    assert damped_overshoot(1.001 * np.exp([0.3j, -0.3j])) == np.inf
    ideal = LinearModel(np.ones((1, 1)), np.full((1, 1), T))
    assert overshoot(ideal, 1.999 / T) == pytest.approx(0.999)  # the first step
    assert overshoot(ideal, 2 / T) == np.inf


@pytest.mark.parametrize(("name", "own"), [("iiwa7", 1), ("ur5", 0)])
def test_who_has_a_joint_left_has_a_loop_in_the_null_space(name, own):
    robot = dqc.load_robot(name)
    law = Proportional(gain=2.0, null_space=dqc.laws.Posture(gain=0.7))
    found = loop_gains(law, law.prepare(robot, None, T))
    assert found is not None
    assert [each.loop for each in found] == ["position", "orientation", *["null space"] * own]
    assert [each.value for each in found] == [2.0, 2.0, *[0.7] * own]


@pytest.mark.parametrize("value", [50.0, 30 + 40j])
@pytest.mark.parametrize("lag", [0.0, 40.0])
def test_a_margin_is_the_limit_over_the_gain(value, lag):
    ideal = LinearModel(np.ones((1, 1)), np.full((1, 1), T))
    margin = gain_margin(LoopGain("position", value, None, lag=lag), ideal, T)
    if not lag and value == 50.0:
        assert margin == pytest.approx(2 / (50 * T), rel=1e-6)
    behind = with_lag(ideal, lag, T)
    for factor, is_stable in ((0.999, True), (1.001, False)):
        assert (spectral_radius(behind.poles(factor * margin * value)) < 1) == is_stable
    assert gain_margin(LoopGain("position", 0.0, None), ideal, T) == np.inf


def test_behind_a_limit_of_acceleration_large_errors_bound_what_is_recommended(arm):
    model = Servo(time_constant=TAU, delay=2 * T).linear_model(arm, None, T)
    free, limited = (gain_limits(model, T, accelerations_limited=each) for each in (False, True))
    assert (free.large, limited.large) == (np.inf, large_error_limit(model, T))
    assert limited.recommended == min(free.recommended, limited.large)


@pytest.mark.parametrize("window", [2, 5])
@pytest.mark.parametrize("from_measured", [False, True])
def test_behind_a_mean_leaves_that_of_the_last_rates_or_positions(window, from_measured):
    """Of rates u itself is averaged, of positions y + T u, whose rate is (mean − y)/T."""
    rng = np.random.default_rng(6)
    model = LinearModel(rng.normal(0, 0.4, (3, 3)), rng.normal(0, 1, (3, 2)))
    seen = with_mean(model, window, T, from_measured=from_measured)
    state, last = np.zeros(3), [np.zeros(2)] * window
    whole = np.zeros(len(seen.transition))
    for command in rng.normal(size=(20, 2)):
        last = [state[:2] + T * command if from_measured else command, *last[:-1]]
        rate = (np.mean(last, axis=0) - state[:2]) / T if from_measured else np.mean(last, axis=0)
        # A model's inputs are of a rate; where commands count from y they move its target by T times it.
        state = model.transition @ state + model.inputs @ rate
        whole = seen.transition @ whole + seen.inputs @ command
        np.testing.assert_allclose(whole[:3], state, atol=1e-9 * max(1, np.abs(state).max()))


@pytest.mark.parametrize(("tau", "delay"), [(0.05, 0.0), (0.05, 0.02), (0.02, 0.013)])
def test_at_the_limit_of_large_errors_the_harmonic_balance_holds(arm, tau, delay):
    """k G N = −1 at some frequency, N = 8/π² cos φ e^(−jφ) of a rate that is always at its limit."""
    model = Servo(time_constant=tau, delay=delay).linear_model(arm, None, T)
    assert model is not None
    gain = large_error_limit(model, T) / T
    unit, angles = np.eye(len(model.transition)), np.geomspace(1e-3, 3.1, 3000)
    loop = np.array(
        [np.linalg.solve(np.exp(1j * a) * unit - model.transition, model.inputs)[0, 0] for a in angles]
    )
    late = np.pi + np.unwrap(np.angle(loop))
    rated = (late > 0) & (late < np.pi / 2)
    balance = loop * 8 / np.pi**2 * np.cos(late) * np.exp(-1j * late)
    assert np.abs(gain * balance[rated] + 1).min() < 2e-3
    assert np.abs(0.97 * gain * balance[rated] + 1).min() > 0.02


def test_a_loop_s_gain_is_its_largest_and_the_integral_s_share_is_of_its_square(arm):
    law = Proportional(gain=4.0, integral_gain=2.0)
    assert [each.integral_share for each in loop_gains(law, law.prepare(arm, None, T)) or ()] == [
        0.125,
        0.125,
    ]
    steps = dqc.laws.Schedule(times=[0.0, 1.0, 2.0], values=[1.0, 5.0, 2.0])
    law = Proportional(gain=steps)
    found, *_ = loop_gains(law, law.prepare(arm, SetPoint(arm.fkm(Q0)), T)) or ()
    assert (found.value, found.time) == (pytest.approx(5.0), pytest.approx(1.0))

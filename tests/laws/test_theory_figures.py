"""Figures that theory predicts for the laws: how errors scale with gains, what linear quadratic laws cost."""

import math

import numpy as np
import pytest
from msgspec.structs import replace

import dqcontrol as dqc
from dqcontrol import algebra
from dqcontrol.laws import (
    HInfinity,
    LinearQuadraticDQ,
    LinearQuadraticR8,
    Proportional,
    Steps,
    riccati,
)
from dqcontrol.laws.inverses import inverse_parameters
from dqcontrol.measures import evaluate
from dqcontrol.plants import Integrator
from dqcontrol.references import Circle, SetPoint, ViaPoints

FIRST = inverse_parameters.size() + 1  # of a law's own parameters: behind the inverse's and the hysteresis

pytestmark = pytest.mark.usefixtures("without_growth")

SEED = 20261108
T = 0.008
START = np.array([0, math.pi / 3.7, 0, math.pi / 2, 0, math.pi / 3.7, 0])
BIAS = [0.02, -0.01, 0.015, 0.02, -0.02, 0.01, 0.02]  # rad/s
LN2 = math.log(2)
CONJUGATE = np.diag([1.0, -1, -1, -1, 1, -1, -1, -1])


@pytest.fixture(scope="module")
def arm():
    return dqc.load_robot("iiwa7")


def definite(rng, size, least=0.5):
    root = rng.standard_normal((size, size))
    return root @ root.T / size + least * np.eye(size)


def turning_path(arm, duration):
    nearby = START + np.array([0, 1, -1, 0.5])[:, None] * np.array([0.2, 0.15, -0.2, 0.1, 0.2, -0.3, 0.4])
    return ViaPoints(duration * np.array([0, 0.3, 0.7, 1]), arm.fkm(nearby))


def integral(arm, law, *, lag):
    """Return the integral of |1 − x*x_d|: of the lag behind a circle, or of what a constant joint bias does at rest."""
    target = Circle(arm.fkm(START), radius=0.07, duration=24.0) if lag else SetPoint(arm.fkm(START))
    plant = Integrator() if lag else Integrator(bias=BIAS)
    record = dqc.simulate(arm, target, law, plant, START, T, duration=24.0)
    assert record.error[0] < 1e-12, "no error at the start"
    return evaluate(record).error.integral


@pytest.mark.parametrize("lag", [True, False], ids=["lag", "bias"])
@pytest.mark.parametrize(
    ("law", "smaller"),
    [
        (Proportional(gain=125.0), Proportional(gain=125.0 * LN2)),
        (
            HInfinity(orientation_gain=10.6, translation_gain=7.6),
            HInfinity(orientation_gain=10.6 * LN2, translation_gain=7.6 * LN2),
        ),
    ],
    ids=["K", "HIR"],
)
def test_errors_are_inverse_to_the_gain(arm, law, smaller, lag):
    """The lag is |ẋ_d|/k, the offset |N b|/k: 1/ln 2 = 1.443 for gains times ln 2. [P16 5.7]"""
    ratio = integral(arm, smaller, lag=lag) / integral(arm, law, lag=lag)
    assert ratio == pytest.approx(1.443, rel=0.01)


@pytest.mark.parametrize("horizon", [None, 24.0], ids=["endless", "24 s"])
@pytest.mark.parametrize("law", [LinearQuadraticR8, LinearQuadraticDQ])
def test_linear_quadratic_errors_are_inverse_to_the_root_of_the_weight(arm, law, horizon):
    """With preview they do not lag; the offset under a joint bias is |N b|/√(q/r): 1/√ln 2 = 1.201. [P16 5.7]"""
    full, smaller = (
        integral(arm, law(error_weight=q, control_weight=0.01, horizon_time=horizon), lag=False)
        for q in (270.0, 270.0 * LN2)
    )
    assert smaller / full == pytest.approx(1.201, rel=0.01)


@pytest.mark.parametrize("lag", [True, False], ids=["lag", "bias"])
def test_half_the_level_is_half_the_error(arm, lag):
    """k_O γ_O = 2 and k_T γ_T = √2, and errors are inverse to the gains, of the orientation and of the position."""
    errors = []
    for gamma in (0.2, 0.1):
        law = HInfinity(orientation_gamma=gamma, translation_gamma=gamma, form="left")
        target = turning_path(arm, 30.0) if lag else SetPoint(arm.fkm(START))
        plant = Integrator() if lag else Integrator(bias=BIAS)
        record = dqc.simulate(arm, target, law, plant, START, T, duration=30.0)
        errors.append([record.orientation_error.sum(), record.position_error.sum()])
    assert np.divide(*errors) == pytest.approx([2, 2], rel=0.01)


def rates(reference, times):
    """Return x_d*ẋ_d at each time, shape (N, 8)."""
    samples = reference.samples(times)
    twist = np.insert(samples[:, 8:14], [0, 3], 0.0, axis=1)
    return algebra.multiply(algebra.conjugate(samples[:, :8]), 0.5 * algebra.multiply(twist, samples[:, :8]))


def linear_cost(e0, q, r, s, gains, offsets, drift, offset, step):
    """Return the cost of ė = A e + u + c with u = −(G e + g), all given at every half step, by Runge–Kutta."""

    def slope(e, i):
        u = -(gains[i] @ e + offsets[i])
        return drift[i] @ e + u + offset[i], 0.5 * (e @ q @ e + u @ r @ u)

    e, cost = e0.copy(), 0.0
    for i in range(0, len(gains) - 1, 2):
        a, ca = slope(e, i)
        b, cb = slope(e + 0.5 * step * a, i + 1)
        c, cc = slope(e + 0.5 * step * b, i + 1)
        d, cd = slope(e + step * c, i + 2)
        e = e + step / 6 * (a + 2 * b + 2 * c + d)
        cost += step / 6 * (ca + 2 * cb + 2 * cc + cd)
    return cost + 0.5 * e @ s @ e


def test_cost_of_the_linear_tracking_model_is_the_value_function(arm):
    """½e'Pe + ξ'e + ½ζ, ζ̇ = ξ'R⁻¹ξ − 2ξ'c, with the gains that the law itself uses: full Q, R, S, moving target."""
    print(f"seed {SEED}")
    rng = np.random.default_rng(SEED)
    q, r, s = 5 * definite(rng, 8), definite(rng, 8), definite(rng, 8)
    path, period = turning_path(arm, 1.0), 1e-3
    law = LinearQuadraticR8(error_weight=q.tolist(), control_weight=r.tolist(), final_weight=s.tolist())
    rows = law.rows(arm, path, period)
    gains, offsets = rows[:, FIRST : FIRST + 64].reshape(-1, 8, 8), rows[:, FIRST + 64 : FIRST + 72]
    velocity = rates(
        path, np.minimum(period * np.arange(len(rows)), path.duration - 1e-8)
    )  # it ends at speed
    drift, c = algebra.hamilton_minus(velocity), -velocity
    e0 = 0.1 * rng.standard_normal(8)
    xi = offsets @ r
    zeta = np.trapezoid(2 * (xi * c).sum(1) - (xi * offsets).sum(1), dx=period)
    value = 0.5 * e0 @ r @ gains[0] @ e0 + xi[0] @ e0 + 0.5 * zeta
    cost = linear_cost(e0, q, r, s, gains, offsets, drift, c, 2 * period)
    print(f"cost {cost:.8g}, value {value:.8g}")
    assert cost == pytest.approx(value, rel=1e-5)
    without_preview = linear_cost(e0, q, r, s, gains, 0 * offsets, drift, c, 2 * period)
    assert without_preview > value * (1 + 1e-3), "the preview is worth something"
    for scale in (0.9, 1.1):
        assert linear_cost(e0, q, r, s, scale * gains, offsets, drift, c, 2 * period) > value * (1 + 1e-4)


@pytest.mark.parametrize("angle", [0.1, 0.5, 1.0, 2.0])
def test_an_arm_pays_more_than_the_linear_model_by_the_projection(arm, angle):
    """A turn θ = 4φ without horizon: cost (2q/κ)(½sin²φ − ln cos φ), of which the linear model knows (2q/κ) sin²φ."""
    q, r = 4.0, 1.0
    turn = np.array([math.cos(angle / 2), *(math.sin(angle / 2) * np.array([0.6, 0, 0.8])), 0, 0, 0, 0])
    target = SetPoint(algebra.multiply(arm.fkm(START), turn))
    law = LinearQuadraticR8(error_weight=q, control_weight=r)
    costs = []
    for period in (2e-3, 1e-3):
        record = dqc.simulate(arm, target, law, Integrator(), START, period, duration=6.0)
        task = algebra.hamilton_minus(target.pose) @ CONJUGATE @ arm.pose_jacobian(record.q)
        u = np.einsum("kij,kj->ki", task, record.command)
        costs.append(0.5 * period * (q * record.error**2 + r * (u**2).sum(axis=1)).sum())
    cost = 2 * costs[1] - costs[0]  # as T → 0
    phi = angle / 4
    gap = (0.5 * math.sin(phi) ** 2 - math.log(math.cos(phi))) / math.sin(phi) ** 2 - 1
    value = 0.5 * math.sqrt(q * r) * record.error[0] ** 2
    print(
        f"{angle:g} rad: {100 * (cost / value - 1):.3f} % more than the linear model; theory {100 * gap:.3f} %"
    )
    assert cost / value - 1 == pytest.approx(gap, rel=0.02, abs=2e-5)


def solved(weights_at, s, edges, times, drift, offset):
    """Integrate P and ξ backwards with a library, anew from every edge at which a weight changes."""
    from scipy.integrate import solve_ivp

    m = len(s)
    y = np.concatenate([s.ravel(), np.zeros(m)])
    out = np.empty((len(times), m * m + m))
    for begin, end in zip(edges[-2::-1], edges[:0:-1], strict=True):
        q, r = weights_at(0.5 * (begin + end))
        inverse = np.linalg.inv(r)

        def rate(t, y, q=q, inverse=inverse):
            p, xi = y[: m * m].reshape(m, m), y[m * m :]
            a, c = drift(t), offset(t)
            dp = p @ inverse @ p - p @ a - a.T @ p - q
            return np.concatenate([dp.ravel(), p @ inverse @ xi - a.T @ xi - p @ c])

        inside = np.flatnonzero((times >= begin - 1e-9) & (times <= end + 1e-9))
        wanted = np.clip(times[inside], begin, end)[::-1]
        run = solve_ivp(rate, (end, begin), y, t_eval=wanted, rtol=1e-11, atol=1e-13, method="DOP853")
        out[inside] = run.y.T[::-1]
        y = out[inside[0]]
    return out[:, : m * m].reshape(-1, m, m), out[:, m * m :]


@pytest.mark.parametrize(
    ("law", "size", "tolerance"),
    [(LinearQuadraticDQ, 6, 1e-8), (LinearQuadraticR8, 8, 1e-5)],
    ids=["closed form", "Runge-Kutta of 10 ms"],
)
def test_pieces_of_matrix_weights_against_a_library(arm, law, size, tolerance):
    """Q and R change at times of their own, S ≠ 0, and at first there is an error that costs nothing."""
    print(f"seed {SEED}")
    rng = np.random.default_rng(SEED)
    period, end, q_starts, r_starts = 0.01, 1.0, [0.0, 0.3, 0.7], [0.0, 0.5]
    qs, rs = [4 * definite(rng, size) for _ in q_starts], [definite(rng, size) for _ in r_starts]
    qs[0] -= np.linalg.eigvalsh(qs[0])[0] * np.eye(size)
    s, path = definite(rng, size), turning_path(arm, end)

    def weights_at(t):
        return qs[int(np.searchsorted(q_starts, t, "right")) - 1], rs[int(t >= 0.5)]

    def velocity(t):
        return rates(path, np.array([min(t, end - 1e-8)]))[0] if law is LinearQuadraticR8 else np.zeros(8)

    tuned = law(
        error_weight=Steps(q_starts, [q.tolist() for q in qs]),
        control_weight=Steps(r_starts, [r.tolist() for r in rs]),
        final_weight=s.tolist(),
    )
    rows = tuned.rows(arm, path, period)
    times = period * np.arange(len(rows))
    p, xi = solved(
        weights_at,
        s,
        [0.0, 0.3, 0.5, 0.7, end],
        times,
        lambda t: algebra.hamilton_minus(velocity(t))[:size, :size],
        lambda t: -velocity(t)[:size],
    )
    inverses = np.array([np.linalg.inv(weights_at(t + 1e-9)[1]) for t in times])
    expected = np.concatenate(
        [(inverses @ p).reshape(len(times), -1), (inverses @ xi[:, :, None])[:, :, 0]], 1
    )
    got = rows[:, FIRST : FIRST + size * size + size]
    parts = [slice(0, size * size), slice(size * size, None)]
    if law is LinearQuadraticDQ:  # it has no offset
        assert not expected[:, parts.pop()].any()
    for part in parts:
        np.testing.assert_allclose(
            got[:, part], expected[:, part], rtol=0, atol=tolerance * np.abs(expected[:, part]).max()
        )


@pytest.mark.parametrize("law", [LinearQuadraticR8, LinearQuadraticDQ])
@pytest.mark.parametrize("final", [0.0, 0.2, 3.0, 40.0])
def test_the_gain_of_a_horizon_falls_to_the_final_weight_in_its_last_seconds(arm, law, final):
    """k(τ) = κ (s + w tanh κτ)/(w + s tanh κτ): s/r at the end, within 1 % of κ all but the last 3/κ seconds."""
    q, r, end, period = 25.0, 0.25, 2.0, 0.01
    kappa, w = math.sqrt(q / r), math.sqrt(q * r)
    tuned = law(error_weight=q, control_weight=r, final_weight=final, horizon_time=end)
    gains = tuned.rows(arm, SetPoint(arm.fkm(START)), period)[:, FIRST]
    to_go = end - period * np.arange(201)
    rise = np.tanh(kappa * to_go)
    assert gains == pytest.approx(kappa * (final + w * rise) / (w + final * rise), rel=2e-4, abs=1e-9)
    assert gains[-1] == pytest.approx(final / r)
    assert gains[to_go > 3 / kappa] == pytest.approx(kappa, rel=0.01)


@pytest.mark.parametrize("law", [LinearQuadraticR8, LinearQuadraticDQ])
def test_without_error_weight_the_hand_moves_evenly_up_to_what_the_end_is_worth(arm, law):
    """q = 0: k = s/(r + sτ), so the distance falls as a straight line, from d to d/(1 + s t_f/r)."""
    end, s, r = 2.0, 6.0, 1.0
    pose = arm.fkm(START)
    target = algebra.pose(algebra.rotation(pose), algebra.translation(pose) + np.array([0.05, -0.04, 0.03]))
    tuned = law(error_weight=0.0, control_weight=r, final_weight=s, horizon_time=end)
    record = dqc.simulate(arm, SetPoint(target), tuned, Integrator(), START, 1e-3, duration=end)
    line = (1 + s * (end - record.time) / r) / (1 + s * end / r)
    assert record.position_error / record.position_error[0] == pytest.approx(line, abs=2e-3)
    assert record.position_error[-1] / record.position_error[0] == pytest.approx(1 / 13, rel=0.01)


def test_equal_loop_gains_are_one_controller(arm):
    """The four sets of P16 Tables 5.3–5.4 have q/r = 1000 and s = 0: the same commands to rounding."""
    circle = Circle(arm.fkm(START), radius=0.07, duration=2.0)
    law = LinearQuadraticR8(error_weight=1.0, control_weight=0.001)
    sets = [(1.0, 0.001), (10.0, 0.01), (100.0, 0.1), (1000.0, 1.0)]
    runs = [
        dqc.simulate(
            arm, circle, replace(law, error_weight=q, control_weight=r), Integrator(), START, 0.02
        ).command
        for q, r in sets
    ]
    for run in runs[1:]:
        np.testing.assert_allclose(run, runs[0], atol=1e-10)
    other = replace(law, error_weight=2.0)
    changed = dqc.simulate(arm, circle, other, Integrator(), START, 0.02).command
    assert np.abs(changed - runs[0]).max() > 1e-6


def test_scalar_weights_of_a_moving_target_do_not_make_a_scalar_gain(arm):
    """A + Aᵀ ≠ 0 where the target translates, so P is full: the error of the linear model turns into translation."""
    circle = Circle(arm.fkm(START), radius=0.07, duration=2.0)
    rows = LinearQuadraticR8(error_weight=4.0, control_weight=1.0).rows(arm, circle, 0.01)
    gains = rows[:, FIRST : FIRST + 64].reshape(-1, 8, 8)
    steady = gains[100] - 2 * np.eye(8)
    assert 1e-2 < np.abs(steady).max() < 0.2
    at_rest = riccati.steady_solution(4 * np.eye(8), np.eye(8))
    np.testing.assert_allclose(at_rest, 2 * np.eye(8), atol=1e-12)

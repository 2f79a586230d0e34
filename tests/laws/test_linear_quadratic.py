"""Linear quadratic laws: Riccati solutions against ODE solvers, costs against value functions, known equivalences."""

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol import algebra
from dqcontrol.errors import Error
from dqcontrol.laws import LinearQuadraticDQ, LinearQuadraticR8, Proportional, Steps, riccati
from dqcontrol.laws.inverses import inverse_parameters
from dqcontrol.plants import Integrator

FIRST = inverse_parameters.size() + 1  # of a law's own parameters: behind the inverse's and the hysteresis

pytestmark = pytest.mark.usefixtures("without_growth")

START = np.array([0.1, 0.6, 0.2, 1.6, -0.1, 0.6, 0.3])
ENDLESS = dqc.references.SetPoint


@pytest.fixture(scope="module")
def arm():
    return dqc.load_robot("iiwa7")


def definite(size, seed, least=0.5):
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((size, size))
    return root @ root.T / size + least * np.eye(size)


def by_ode(q, r, s, tau, a=None, c=None):
    """Integrate the tracking Riccati equations backwards with a library."""
    from scipy.integrate import solve_ivp

    m = len(q)
    a = (lambda t: np.zeros((m, m))) if a is None else a
    c = (lambda t: np.zeros(m)) if c is None else c
    inverse = np.linalg.inv(r)

    def rate(tau_, y):
        p, xi = y[: m * m].reshape(m, m), y[m * m :]
        at, ct = a(tau_), c(tau_)
        dp = p @ at + at.T @ p - p @ inverse @ p + q
        return np.concatenate([dp.ravel(), at.T @ xi - p @ inverse @ xi + p @ ct])

    y0 = np.concatenate([s.ravel(), np.zeros(m)])
    solved = solve_ivp(rate, (0, tau[-1]), y0, t_eval=tau, rtol=1e-11, atol=1e-12, method="DOP853").y.T
    return solved[:, : m * m].reshape(-1, m, m), solved[:, m * m :]


@pytest.mark.parametrize("seed", range(3))
def test_closed_form_against_ode(seed):
    q, r, s = definite(6, seed), definite(6, seed + 10), definite(6, seed + 20, 0.0)
    if seed == 2:
        q = q - np.linalg.eigvalsh(q)[0] * np.eye(6)  # one error that costs nothing
    tau = np.linspace(0, 3, 31)
    np.testing.assert_allclose(riccati.backward_solution(q, r, s, tau), by_ode(q, r, s, tau)[0], atol=1e-8)


def test_scalar_closed_form():
    tau, q, r, s = np.linspace(0, 2, 11), 7.0, 0.3, 0.4
    w, t = np.sqrt(q * r), np.tanh(np.sqrt(q / r) * tau)
    wanted = w * (s + w * t) / (w + s * t)
    got = riccati.backward_solution(q * np.eye(2), r * np.eye(2), s * np.eye(2), tau)
    np.testing.assert_allclose(got[:, 0, 0], wanted, rtol=1e-12)
    free = riccati.backward_solution(0 * np.eye(2), r * np.eye(2), s * np.eye(2), tau)
    np.testing.assert_allclose(free[:, 1, 1], s / (1 + s * tau / r), rtol=1e-12)
    far = riccati.backward_solution(1e6 * np.eye(2), r * np.eye(2), s * np.eye(2), np.array([1e5]))
    np.testing.assert_allclose(far[0], riccati.steady_solution(1e6 * np.eye(2), r * np.eye(2)), rtol=1e-12)


def test_pieces_against_ode():
    r, s, end = 0.5, 0.2, 2.0
    weights = riccati.weight_pieces("q", Steps([0.0, 0.7, 1.5], [1.0, 9.0, 3.0]), 6, definite=False)
    controls = riccati.weight_pieces("r", r, 6, definite=True)
    times = np.linspace(0, end, 201)
    got = riccati.piecewise_solution(weights, controls, s * np.eye(6), times, end)[:, 0, 0]
    p, h = s, 1e-5
    expected = {}
    for k in range(round(end / h), -1, -1):
        expected[k] = p
        t = k * h - h / 2
        q = 1.0 if t < 0.7 else (9.0 if t < 1.5 else 3.0)
        middle = p + h / 2 * (q - p * p / r)
        p = p + h * (q - middle * middle / r)
    np.testing.assert_allclose(got, [expected[round(t / h)] for t in times], atol=1e-8)


@pytest.mark.slow
def test_tracking_sweep_against_ode(arm):
    """P and ξ of a moving reference, at the loop gain where one Euler step a sample oscillates."""
    circle = dqc.references.Circle(arm.fkm(START), radius=0.07, duration=1.0)
    period = 0.008
    law = LinearQuadraticR8(error_weight=270.0, control_weight=0.01, final_weight=0.3)
    rows = law.rows(arm, circle, period)
    count = len(rows)

    def velocity(tau):
        sample = circle.samples(np.array([max(1.0 - tau, 0.0)]))[0]
        if tau <= 0:  # the last instant moves still; at rest only after it
            sample[8:14] = circle.samples(np.array([1.0 - 1e-7]))[0, 8:14]
        twist = np.insert(sample[8:14], [0, 3], 0.0)
        return algebra.multiply(algebra.conjugate(sample[:8]), 0.5 * algebra.multiply(twist, sample[:8]))

    eye = np.eye(8)
    p, xi = by_ode(
        270 * eye,
        0.01 * eye,
        0.3 * eye,
        period * np.arange(count),
        lambda tau: algebra.hamilton_minus(velocity(tau)),
        lambda tau: -velocity(tau),
    )
    gains, offsets = rows[:, FIRST : FIRST + 64].reshape(-1, 8, 8), rows[:, FIRST + 64 : FIRST + 72]
    scale = np.sqrt(270 / 0.01)
    np.testing.assert_allclose(gains[::-1][20:], p[20:] / 0.01, atol=1e-4 * scale)
    np.testing.assert_allclose(offsets[::-1][20:], xi[20:] / 0.01, atol=1e-4 * np.abs(xi / 0.01).max())
    assert (gains[:, 0, 0] > 0).all()  # never the negative gains of an unresolved sweep


def test_cost_of_the_linear_model_is_its_value():
    """½e'Pe with A = 0, c = 0: the simulated cost meets the value function as T → 0."""
    q, r, s, end = definite(8, 1), definite(8, 2), definite(8, 3), 1.0
    e0 = np.random.default_rng(4).standard_normal(8)
    value = 0.5 * e0 @ riccati.backward_solution(q, r, s, np.array([end]))[0] @ e0
    misses = []
    for steps in (2000, 4000):
        h = end / steps
        gains = np.linalg.solve(r, riccati.backward_solution(q, r, s, end - h * (np.arange(steps) + 0.5)))
        e, cost = e0.copy(), 0.0
        for gain in gains:
            u = -gain @ e
            middle = e + 0.5 * h * u
            cost += 0.5 * h * (middle @ q @ middle + u @ r @ u)
            e = e + h * u
        misses.append(cost + 0.5 * e @ s @ e - value)
    assert abs(misses[1]) < 1e-3 * value
    assert abs(misses[1]) < 0.6 * abs(misses[0])


def test_set_point_lqr_in_r8_with_scalar_weights_is_k(arm):
    law = LinearQuadraticR8(error_weight=9.0, control_weight=0.25)
    sample = dqc.Sample(arm.fkm(START + 0.2))
    expected = Proportional(gain=np.sqrt(9.0 / 0.25)).command(arm, START, sample, 0.01)
    np.testing.assert_allclose(law.command(arm, START, sample, 0.01), expected, atol=1e-11)
    np.testing.assert_allclose(law.command(arm, START, dqc.Sample(-sample.pose), 0.01), expected, atol=1e-11)


def test_lqr_in_r8_tracks_without_lag_and_lowers_its_gain_at_the_end(arm):
    circle = dqc.references.Circle(arm.fkm(START), radius=0.07, duration=4.0)
    law = LinearQuadraticR8(error_weight=4.0, control_weight=0.01)
    record = dqc.simulate(arm, circle, law, Integrator(), START, 0.008)
    assert record.position_error[50:-60].max() < 1e-3
    gains = law.rows(arm, circle, 0.008)[:, FIRST]
    assert gains[100] == pytest.approx(20.0, rel=1e-3)
    assert gains[-1] == 0.0


@pytest.mark.parametrize("form", ["log", "sin"])
def test_lqr_in_dual_quaternions_decays_at_kappa(arm, form):
    law = LinearQuadraticDQ(error_weight=9.0, control_weight=1.0, form=form)
    target = ENDLESS(arm.fkm(START + 0.02))
    record = dqc.simulate(arm, target, law, Integrator(), START, 1e-3, duration=1.0)
    x = algebra.short(algebra.multiply(record.pose, algebra.conjugate(record.desired_pose)))
    for value in (np.linalg.norm(algebra.translation(x), axis=1), np.linalg.norm(x[:, 1:4], axis=1)):
        assert -np.log(value[-1] / value[0]) == pytest.approx(-np.log(1 - 3e-3) * 1000, rel=2e-3)


def test_lqr_in_dual_quaternions_is_the_optimum_of_the_pose_problem(arm):
    """Simulated cost = value function; other gains and the sin form cost more."""
    end, q, r, period = 1.5, 4.0, 0.5, 5e-4
    target = ENDLESS(algebra.multiply(algebra.pose([0.96, 0.28, 0, 0], [0.05, -0.1, 0.05]), arm.fkm(START)))

    def cost(law):
        record = dqc.simulate(arm, target, law, Integrator(), START, period, duration=end)
        x = algebra.short(algebra.multiply(record.pose, algebra.conjugate(record.desired_pose)))
        y = np.hstack([2 * algebra.log_body(x)[:, :3], algebra.translation(x)])
        u = np.einsum("kij,kj->ki", arm.twist_jacobian(record.q), record.command)
        running = q * (y**2).sum(1) + r * (u**2).sum(1)
        return 0.5 * period * running[:-1].sum(), y

    best, y = cost(LinearQuadraticDQ(error_weight=q, control_weight=r, horizon_time=end))
    value = (
        0.5
        * y[0]
        @ riccati.backward_solution(q * np.eye(6), r * np.eye(6), 0 * np.eye(6), np.array([end]))[0]
        @ y[0]
    )
    assert best == pytest.approx(value, rel=3e-3)
    others = [
        LinearQuadraticDQ(error_weight=0.64 * q, control_weight=r, horizon_time=end),
        LinearQuadraticDQ(error_weight=1.44 * q, control_weight=r, horizon_time=end),
        LinearQuadraticDQ(error_weight=q, control_weight=r, horizon_time=end, form="sin"),
    ]
    for other in others:
        assert cost(other)[0] > best


def test_matrix_weights_make_each_direction_decay_at_its_own_rate(arm):
    law = LinearQuadraticDQ(error_weight=[1, 1, 1, 4, 16, 64], control_weight=1.0)
    gain = law.rows(arm, None, 0.01)[0, FIRST : FIRST + 36].reshape(6, 6)
    np.testing.assert_allclose(gain, np.diag([1, 1, 1, 2, 4, 8]), atol=1e-12)


ROTATED = np.eye(6)
ROTATED[0, 1] = 1.0


@pytest.mark.parametrize(
    ("law", "message"),
    [
        (
            lambda: LinearQuadraticDQ(error_weight=-1.0, control_weight=1.0),
            "error_weight: must be positive semidefinite",
        ),
        (
            lambda: LinearQuadraticDQ(error_weight=0.0, control_weight=1.0),
            "error_weight: must be positive definite where",
        ),
        (
            lambda: LinearQuadraticR8(error_weight=0.0, control_weight=1.0),
            "error_weight: must be positive definite where",
        ),
        (
            lambda: LinearQuadraticDQ(error_weight=1.0, control_weight=0.0),
            "control_weight: must be positive definite",
        ),
        (
            lambda: LinearQuadraticDQ(error_weight=ROTATED.tolist(), control_weight=1.0),
            "error_weight: must be symmetric",
        ),
        (
            lambda: LinearQuadraticDQ(error_weight=[1.0] * 8, control_weight=1.0),
            r"error_weight: expected a number, 6 diagonal",
        ),
        (
            lambda: LinearQuadraticR8(error_weight=float("nan"), control_weight=1.0),
            "error_weight: must be finite",
        ),
        (
            lambda: LinearQuadraticDQ(error_weight=1.0, control_weight=1.0, form="cos"),
            "form: unknown name 'cos'",
        ),
        (
            lambda: LinearQuadraticDQ(error_weight=1.0, control_weight=1.0, horizon_time=0.001),
            "horizon_time: must be at least",
        ),
        (
            lambda: LinearQuadraticDQ(error_weight=1.0, control_weight=1.0, final_weight=-1.0),
            "final_weight: must be positive semi",
        ),
        (
            lambda: LinearQuadraticDQ(
                error_weight=Steps([0, 0], [1.0, 2.0]), control_weight=1.0, horizon_time=1.0
            ),
            "error_weight.times: must increase",
        ),
        (
            lambda: LinearQuadraticR8(error_weight=1.0, control_weight=1e-12, horizon_time=2.0),
            r"control_weight: so fast a decay needs 40,000 steps in each period; at most 2,487",
        ),
        (
            lambda: LinearQuadraticR8(error_weight=1.0, control_weight=1.0, horizon_time=1e9),
            "horizon_time: takes .* at most 10 m",
        ),
        (lambda: LinearQuadraticR8(error_weight=1e300, control_weight=1.0), "error_weight: must be ≤ 1e"),
        (
            lambda: LinearQuadraticDQ(error_weight=Steps([0, 1], [1.0, 2.0]), control_weight=1.0),
            "must be constant where",
        ),
    ],
)
def test_bad_weights(arm, law, message):
    with pytest.raises(Error, match=message):
        law().prepare(arm, None, 0.01)

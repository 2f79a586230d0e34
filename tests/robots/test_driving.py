"""How inputs move a robot: unicycles against an ODE solver, the maps of S17 as products of its matrices."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from dqcontrol.errors import ShapeError, ValueRangeError
from dqcontrol.robots import DifferentialDrive, HolonomicBase, WholeBody, load_robot

SEED = 41
R, B, D = 0.065, 0.13, 0.1
DRIVE = DifferentialDrive(R, B, D)
OTHER = DifferentialDrive(0.1, 0.2, displacement=-0.3)
AX18 = load_robot("ax18")


def unicycle(q, v, omega, seconds):
    """Solve ẋ = v cos φ, ẏ = v sin φ, φ̇ = ω."""

    def rate(_, at):
        return [v * np.cos(at[2]), v * np.sin(at[2]), omega]

    solution = solve_ivp(rate, (0, seconds), q, method="DOP853", rtol=1e-13, atol=1e-14)
    return solution.y[:, -1]


@pytest.mark.parametrize("omega", [0.0, 1e-9, 1e-5, 2e-4, -1e-3, 0.3, -2.0, 7.0])
def test_unicycle_follows_its_differential_equation(omega):
    base = WholeBody([DRIVE])
    rng = np.random.default_rng(SEED)
    for seconds in (1e-3, 0.05, 1.0):
        q, v = rng.uniform(-2, 2, 3), rng.uniform(-1, 1)
        expected = unicycle(q, v, omega, seconds)
        np.testing.assert_allclose(base.integrate(q, [v, omega], seconds), expected, rtol=0, atol=1e-12)


def test_both_sides_of_the_small_angle():
    base = WholeBody([DRIVE])
    for half in (0.999e-4, 1.001e-4):
        x, y, phi = base.integrate([0, 0, 0], [1.0, 2 * half], 1.0)
        # sin(2h)/2h and (1 − cos 2h)/2h as series
        expected = [1 - (2 * half) ** 2 / 6, half - (2 * half) ** 3 / 24, 2 * half]
        np.testing.assert_allclose([x, y, phi], expected, rtol=0, atol=1e-15)


def test_full_circle_and_way_back():
    base = WholeBody([DRIVE])
    start = [0.3, -0.2, 0.7]
    there = base.integrate(start, [0.5, 2 * np.pi], 1.0)
    np.testing.assert_allclose(there, [0.3, -0.2, 0.7 + 2 * np.pi], atol=1e-15)
    part = base.integrate(start, [0.5, 1.3], 0.8)
    np.testing.assert_allclose(base.integrate(part, [0.5, 1.3], -0.8), start, atol=1e-15)
    halves = base.integrate(base.integrate(start, [0.5, 1.3], 0.4), [0.5, 1.3], 0.4)
    np.testing.assert_allclose(halves, part, atol=1e-15)


def test_the_hand_moves_as_the_jacobian_says():
    body = WholeBody([DRIVE, AX18, OTHER, HolonomicBase(), AX18])
    rng = np.random.default_rng(SEED)
    h = 1e-4
    for _ in range(5):
        q, u = rng.uniform(-1, 1, body.configuration_size), rng.uniform(-1, 1, body.input_size)
        f = [body.fkm(body.integrate(q, u, k * h)) for k in (-2, -1, 1, 2)]
        rate = (8 * (f[2] - f[1]) - (f[3] - f[0])) / (12 * h)
        np.testing.assert_allclose(body.pose_jacobian(q) @ u, rate, rtol=0, atol=1e-9)


def test_each_part_moves_by_itself():
    body = WholeBody([AX18, DRIVE, OTHER, HolonomicBase()])
    rng = np.random.default_rng(SEED)
    q, u = rng.uniform(-1, 1, 14), rng.uniform(-1, 1, 12)
    expected = np.concatenate(
        [
            q[:5] + 0.4 * u[:5],
            unicycle(q[5:8], *u[5:7], 0.4),
            unicycle(q[8:11], *u[7:9], 0.4),
            q[11:] + 0.4 * u[9:],
        ]
    )
    np.testing.assert_allclose(body.integrate(q, u, 0.4), expected, rtol=0, atol=1e-12)
    np.testing.assert_allclose(AX18.integrate(q[:5], u[:5], 0.4), expected[:5], rtol=0, atol=1e-15)


def matrices(phi, d, r, b):
    """Return G, B, C and D of S17 4.21–4.25."""
    c, s = np.cos(phi), np.sin(phi)
    return (
        np.array([[c, 0], [s, 0], [0, 1]]),
        np.array([[1, 0, -d * s], [0, 1, d * c]]),
        np.array([[c, -d * s], [s, d * c]]),
        np.array([[1, b], [1, -b]]) / r,
    )


def test_input_map_is_the_product_of_its_matrices():
    body = WholeBody([DRIVE, AX18, OTHER])
    rng = np.random.default_rng(SEED)
    for q in rng.uniform(-3, 3, (5, 11)):
        expected = np.zeros((9, 11))
        for row, column, drive in ((0, 0, DRIVE), (7, 8, OTHER)):
            g, b, c, wheels = matrices(
                q[column + 2], drive.displacement, drive.wheel_radius, drive.half_track
            )
            inverse = np.linalg.inv(c)
            expected[row : row + 2, column : column + 3] = wheels @ inverse @ b
            projector = g @ inverse @ b
            np.testing.assert_allclose(projector @ projector, projector, atol=1e-12)
            rates = rng.uniform(-1, 1, 11)
            inputs = body.feasible_inputs(q, rates)[row : row + 2]
            np.testing.assert_allclose(g @ inputs, projector @ rates[column : column + 3], atol=1e-13)
            # the displaced point moves as asked
            np.testing.assert_allclose(b @ g @ inputs, b @ rates[column : column + 3], atol=1e-13)
        expected[2:7, 3:8] = np.eye(5)
        np.testing.assert_allclose(body.input_map(q), expected, rtol=0, atol=1e-12)


def test_wheels():
    body = WholeBody([AX18, DRIVE])
    u = np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.26, 0.5])
    speeds = body.wheel_speeds(u)
    np.testing.assert_array_equal(speeds[:5], u[:5])
    np.testing.assert_allclose(speeds[5:], [(0.26 + 0.065) / R, (0.26 - 0.065) / R])  # 5 and 3 rad/s
    np.testing.assert_allclose(body.from_wheel_speeds(speeds), u)
    many = np.random.default_rng(SEED).uniform(-1, 1, (2, 3, 7))
    np.testing.assert_allclose(body.from_wheel_speeds(body.wheel_speeds(many)), many)
    np.testing.assert_allclose(body.in_form("unconstrained").wheel_speeds(u), speeds)
    holonomic = WholeBody([HolonomicBase()])
    np.testing.assert_array_equal(holonomic.wheel_speeds([1.0, 2.0, 3.0]), [1, 2, 3])


def test_unconstrained_inputs_move_as_the_feasible_ones():
    free = WholeBody([AX18, DRIVE, OTHER, AX18], form="unconstrained")
    body = free.in_form("constrained")
    rng = np.random.default_rng(SEED)
    q, rates = rng.uniform(-1, 1, (2, 4, 16))
    inputs = free.feasible_inputs(q, rates)
    np.testing.assert_allclose(
        free.integrate(q, rates, 0.1), body.integrate(q, inputs, 0.1), rtol=0, atol=1e-15
    )
    # what can be done is done
    for row in range(4):
        u = rng.uniform(-1, 1, 14)
        wanted = np.zeros(16)
        wanted[[*range(5), *range(11, 16)]] = u[[*range(5), *range(9, 14)]]
        for first, j in ((5, 5), (8, 7)):
            phi = q[row, first + 2]
            wanted[first : first + 3] = [u[j] * np.cos(phi), u[j] * np.sin(phi), u[j + 1]]
        np.testing.assert_allclose(free.feasible_inputs(q[row], wanted), u, atol=1e-14)


def test_leading_axes_are_broadcast():
    body = WholeBody([DRIVE])
    q, u = np.zeros((4, 1, 3)), np.ones((5, 2))
    out = body.integrate(q, u, 0.1)
    assert out.shape == (4, 5, 3)
    np.testing.assert_array_equal(out[2, 3], body.integrate(np.zeros(3), np.ones(2), 0.1))
    assert body.feasible_inputs(q, np.ones((5, 3))).shape == (4, 5, 2)
    assert body.input_map(q).shape == (4, 1, 2, 3)
    assert body.integrate(np.zeros((0, 3)), np.ones(2), 0.1).shape == (0, 3)
    assert body.feasible_inputs(np.zeros((0, 3)), np.ones(3)).shape == (0, 2)


def test_bad_arguments():
    body = WholeBody([DRIVE])
    with pytest.raises(ShapeError, match=r"u: expected shape \(…, 2\), got shape \(3,\).* are v, omega"):
        body.integrate(np.zeros(3), np.zeros(3), 0.1)
    with pytest.raises(ShapeError, match=r"u: expected shape \(…, 3\), got shape \(2,\).* are x, y, phi"):
        body.in_form("unconstrained").integrate(np.zeros(3), np.zeros(2), 0.1)
    with pytest.raises(ShapeError, match=r"u: expected shape \(…, 2\), got shape \(3,\).* are v, omega"):
        body.in_form("unconstrained").wheel_speeds(np.zeros(3))
    with pytest.raises(ShapeError, match=r"rates: expected shape \(…, 3\), got shape \(2,\)"):
        body.feasible_inputs(np.zeros(3), np.zeros(2))
    with pytest.raises(ShapeError, match=r"speeds: expected shape \(…, 2\), got shape \(3,\)"):
        body.from_wheel_speeds(np.zeros(3))
    with pytest.raises(ShapeError, match=r"u: leading axes \(2,\) do not fit those of q, \(3,\)"):
        body.integrate(np.zeros((3, 3)), np.zeros((2, 2)), 0.1)
    with pytest.raises(ShapeError, match=r"period: expected a single number, got shape \(2,\)"):
        body.integrate(np.zeros(3), np.zeros(2), [0.1, 0.2])
    with pytest.raises(ValueRangeError, match="period: must be finite"):
        body.integrate(np.zeros(3), np.zeros(2), np.nan)
    with pytest.raises(ValueRangeError, match="u: must be finite"):
        body.integrate(np.zeros(3), [np.inf, 0], 0.1)
    with pytest.raises(ValueRangeError, match="u: moves differential-drive to NaN or infinity"):
        body.integrate(np.zeros(3), [1e308, 0], 1e10)

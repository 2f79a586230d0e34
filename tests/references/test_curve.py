"""References made of functions, against the exact derivatives of others."""

import numpy as np
import pytest
from reference_samples import START

from dqcontrol import algebra
from dqcontrol.errors import ShapeError, ValueRangeError
from dqcontrol.references import Circle, Curve

TIMES = np.linspace(0.0, 6.0, 400)


@pytest.mark.parametrize("turns", [0.5, 3.0])
def test_positions_of_a_circle(turns):
    circle = Circle(START, radius=0.2, duration=6.0, turns=turns)
    rate, (p, u, v) = np.pi * turns / 3, (algebra.translation(START), np.eye(3)[0], np.eye(3)[2])
    curve = Curve(lambda t: p + 0.2 * (np.sin(rate * t) * u + (np.cos(rate * t) - 1) * v), 6.0, START)
    exact, numeric = circle.samples(TIMES), curve.samples(TIMES)
    np.testing.assert_allclose(numeric[:, :8], exact[:, :8], atol=1e-14)
    np.testing.assert_allclose(numeric[:, 8:14], exact[:, 8:14], atol=1e-11)
    np.testing.assert_allclose(numeric[:, 14:20], exact[:, 14:20], atol=2e-8)
    assert curve.corners.tolist() == circle.corners.tolist() == [6.0]


def test_poses_that_turn_with_either_sign():
    """A screw at constant twist: pose exp(½tξ)x, twist ξ, rate 0; the sign of the pose changes all the time."""
    twist = np.array([0.3, -0.8, 0.5, 0.1, 0.05, -0.1])

    def screw(t):
        return (-1) ** int(50 * t) * algebra.multiply(algebra.exp_screw(0.5 * t * twist), START)

    samples = Curve(screw, 6.0).samples(TIMES)
    np.testing.assert_allclose(samples[:-1, 8:14], np.tile(twist, (399, 1)), atol=1e-11)
    np.testing.assert_allclose(samples[:, 14:20], 0.0, atol=2e-8)


def test_a_rest_has_no_corner():
    curve = Curve(lambda t: [0.4, 0.1 * t**2 * (3 - 2 * t), 0.3], 1.0)
    assert not len(curve.corners)


@pytest.mark.parametrize(
    ("function", "duration", "error", "says"),
    [
        (lambda t: [1.0, 2.0], 1.0, ShapeError, r"function: must return a position \(3,\) or a pose \(8,\)"),
        (lambda t: [np.nan, 0, 0], 1.0, ValueRangeError, "function: must be finite"),
        (lambda t: [2.0, 0, 0, 0, 0, 0, 0, 0], 1.0, ValueRangeError, "function: expected a unit dual"),
        (lambda t: [1.0, 2.0, 3.0], 0.0, ValueRangeError, "duration: must be > 0"),
    ],
)
def test_functions_that_are_no_motion(function, duration, error, says):
    with pytest.raises(error, match=says):
        Curve(function, duration)

"""The Riccati equation by explicit Euler steps against the difference equation."""

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol import algebra
from dqcontrol.errors import Error
from dqcontrol_theses.variants import EulerLinearQuadraticR8

START = np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])


@pytest.fixture(scope="module")
def arm():
    return dqc.load_robot("iiwa7")


def test_explicit_euler_steps_are_those_of_the_difference_equation(arm):
    """P_k = P_{k+1} + T (−Ṗ at k + 1), and likewise ξ; beyond √(q/r) T = 1 it swings about the steady solution."""
    circle = dqc.references.Circle(arm.fkm(START), radius=0.07, duration=1.0)
    period, q, r = 0.008, 270.0, 0.01
    law = EulerLinearQuadraticR8(error_weight=q, control_weight=r, final_weight=0.3)
    rows = law.rows(arm, circle, period)
    feedback = law.feedback(rows)
    p, xi = 0.3 * np.eye(8), np.zeros(8)
    for k in range(len(rows) - 1, -1, -1):
        assert feedback.gain[k].reshape(8, 8) == pytest.approx(p / r, abs=1e-7)
        assert feedback.offset[k] == pytest.approx(xi / r, abs=1e-7)
        sample = circle.samples(np.array([min(k * period, 1.0 - 1e-8)]))[0]
        twist = np.insert(sample[8:14], [0, 3], 0.0)
        velocity = algebra.multiply(algebra.conjugate(sample[:8]), 0.5 * algebra.multiply(twist, sample[:8]))
        a, c = algebra.hamilton_minus(velocity), -velocity
        xi = xi + period * (a.T @ xi - p @ xi / r + p @ c)
        p = p + period * (p @ a + a.T @ p - p @ p / r + q * np.eye(8))
    gains = feedback.gain[:80, 0]
    assert gains.max() > 1.2 * np.sqrt(q / r) > gains.min()
    with pytest.raises(Error, match=r"^error_weight, control_weight: one explicit Euler step .* diverges"):
        EulerLinearQuadraticR8(error_weight=800.0, control_weight=r).rows(arm, circle, period)

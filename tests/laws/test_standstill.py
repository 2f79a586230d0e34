"""An arm that is stretched, and a hand that is wanted straight in: where laws stand still, and what leads out."""

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol import algebra
from dqcontrol.laws import ManipulabilityAscent, Proportional
from dqcontrol.plants import Integrator
from dqcontrol.references import SetPoint

STRETCHED = {
    "iiwa7": np.array([0, 0.8, 0, 0, 0, 0.5, 0]),
    "ur5": np.array([0.2, -0.8, 0.0, -0.9, 1.2, 0.3]),
}


def manipulability(arm, q):
    jacobian = arm.twist_jacobian(q)
    return np.sqrt(max(np.linalg.det(jacobian @ jacobian.T), 0.0))


@pytest.mark.parametrize("name", STRETCHED)
def test_manipulability_ascent_leads_out_of_a_singularity(name):
    """It was 0 there, as the factorisation of a singular matrix fails, and the gradient has no direction."""
    arm, q = dqc.load_robot(name), STRETCHED[name]
    assert manipulability(arm, q) < 1e-7
    here = arm.fkm(q)
    law = Proportional(gain=5.0, null_space=ManipulabilityAscent(gain=5.0)).prepare(arm, None, 0.01)
    law.command(q, dqc.Sample(here), law.initial_state(q))
    assert np.linalg.norm(law.preferred) > 0.1
    assert manipulability(arm, q + 0.01 * law.preferred / np.linalg.norm(law.preferred)) > 1e-4
    inwards = algebra.translation(here) / np.linalg.norm(algebra.translation(here))
    goal = SetPoint(algebra.pose(here[:4], algebra.translation(here) - 0.1 * inwards))
    ascent = Proportional(gain=5.0, null_space=ManipulabilityAscent(gain=1.0))
    record = dqc.simulate(arm, goal, ascent, Integrator(), q, 0.01, 8.0)
    assert record.position_error[-1] < 1e-3

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


@pytest.mark.parametrize("name", STRETCHED)
def test_manipulability_ascent_leaves_a_singularity_that_no_law_leaves_alone(name):
    arm, q = dqc.load_robot(name), STRETCHED[name]
    here = arm.fkm(q)
    hand = arm.twist_jacobian(q).copy()
    hand[3:] -= np.cross(algebra.translation(here)[:, None], hand[:3], axis=0)
    left, sigma, _ = np.linalg.svd(np.diag([0.3] * 3 + [1.0] * 3) @ hand)
    assert sigma[-1] < 1e-9
    lost = left[3:, -1] * np.sign(left[3:, -1] @ algebra.translation(here))
    goal = algebra.pose(here[:4], algebra.translation(here) - 0.1 * lost / np.linalg.norm(lost))
    for null_space, arrives in ((None, False), (ManipulabilityAscent(gain=5.0), True)):
        law = Proportional(gain=5.0, null_space=null_space)
        record = dqc.simulate(arm, SetPoint(goal), law, Integrator(), q, 0.01, 8.0)
        assert (record.position_error[-1] < 5e-3) == arrives

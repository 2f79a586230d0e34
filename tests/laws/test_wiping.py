"""A mobile manipulator wipes the edge of a table while it drives along it: the hand on its line, the base beside."""

import numpy as np
import pytest
from obstacles import around, box

import dqcontrol as dqc
from dqcontrol import algebra
from dqcontrol.plants import Integrator
from dqcontrol.references import Points, StartRamp


@pytest.mark.parametrize("nearer", [0.0, 0.05], ids=["table beside", "table in the way of the base"])
def test_the_hand_follows_the_edge_and_the_base_keeps_clear(nearer):
    """Two metres in 25 s; in the second case the base must first give way to keep 10 cm."""
    robot, start = dqc.load_robot("little-john"), np.array([0, 0, 0, 1.5707, -0.9, 0.9, 0.9, 0])
    hand = robot.fkm(start)
    x, y, z = algebra.translation(hand)
    end = algebra.pose(algebra.rotation(hand), [x + 2.0, y, z])
    line = StartRamp(Points([0.0, 25.0], [hand, end]), 2.0)
    edge = max(y - 0.03, 0.3) - nearer
    table = box(
        position=(x + 1.0, edge + 0.4, 0.5 * (z - 0.03)),
        size=(4.0, 0.8, z - 0.03),
        links=["chassis"],
        margin=0.05,
    )
    kept = dqc.constraints.Constraints(
        self_collision=False, acceleration=3.0, **around({"table": table}), recovery=0.1
    )
    law = dqc.laws.FeedbackLinearization(stiffness=6.0, damping=3.0, constraints=kept)
    record = dqc.simulate(robot, line, law, Integrator(), start, period=0.02)
    assert record.position_error.max() < 0.01
    assert record.readings["constraint_distance"].values.min() > 0.049
    assert record.q[-1, 0] > 1.5

"""Limits around one law of a tree: joints stop at their limits exactly, as those of chains do."""

import numpy as np
import pytest

import dqcontrol as dqc

TWO = dqc.load_robot("two-pandas")
START = np.array([-0.1, -0.5, 0.1, -2.2, 0.1, 1.7, 0.8, 0.3, -0.7, -0.2, -2.1, -0.1, 1.5, 0.7])


@pytest.mark.parametrize("task", ["relative", "absolute"])
@pytest.mark.parametrize("limit", [dqc.limits.ModifiedClamping(), dqc.limits.WeightedLeastNorm()])
def test_joints_of_both_arms_keep_their_limits(task, limit):
    arms, elbows = TWO.with_task(task), [3, 10]
    start, beyond = START.copy(), START.copy()
    start[elbows], beyond[elbows] = arms.limits.upper[elbows] - 0.02, arms.limits.upper[elbows] + 0.4
    goal = dqc.references.SetPoint(arms.fkm(beyond))
    law, limits = dqc.laws.Proportional(gain=3.0), dqc.limits.CommandLimits(position=limit)
    record = dqc.simulate(
        arms, goal, law, dqc.plants.Integrator(), start, period=0.01, duration=3.0, limits=limits
    )
    if isinstance(limit, dqc.limits.ModifiedClamping):
        assert (record.q <= arms.limits.upper + 1e-12).all()
        assert (record.q >= arms.limits.lower - 1e-12).all()
    rooms = np.minimum(record.q - arms.limits.lower, arms.limits.upper - record.q)
    assert rooms[1:].min() < 1e-3  # a limit was met

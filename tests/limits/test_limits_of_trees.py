"""Limits around one law of a tree: joints stop at their limits exactly, as those of chains do."""

import numpy as np
import pytest

import dqcontrol as dqc

TWO = dqc.load_robot("two-pandas")
START = np.array([-0.1, -0.5, 0.1, -2.2, 0.1, 1.7, 0.8, 0.3, -0.7, -0.2, -2.1, -0.1, 1.5, 0.7])


@pytest.mark.parametrize("task", ["relative", "absolute"])
def test_joints_of_both_arms_keep_their_limits(task):
    arms, elbows = TWO.with_task(task), [3, 10]
    start, beyond = START.copy(), START.copy()
    start[elbows], beyond[elbows] = arms.limits.upper[elbows] - 0.002, arms.limits.upper[elbows] + 1.0
    goal = dqc.references.SetPoint(arms.fkm(beyond))
    excess = {}
    for limit in (None, dqc.limits.ModifiedClamping()):
        law, limits = dqc.laws.Proportional(gain=3.0), dqc.limits.CommandLimits(position=limit)
        record = dqc.simulate(arms, goal, law, dqc.plants.Integrator(), start, 0.01, 3.0, limits=limits)
        beyond = np.maximum(record.q - arms.limits.upper, arms.limits.lower - record.q)
        excess[limit is None] = beyond.max()
    assert excess[True] > 0.01  # without the limit
    assert excess[False] <= 1e-12


def test_constraints_clamp_the_joints_of_all_tasks():
    """A goal of the tray beyond the elbows' limits: they stop there, and the hands go on holding the tray."""
    arms, elbows = TWO.with_task("absolute"), [3, 10]
    start, beyond = START.copy(), START.copy()
    start[elbows], beyond[elbows] = arms.limits.upper[elbows] - 0.002, arms.limits.upper[elbows] + 1.0
    goal, plant = dqc.references.SetPoint(arms.fkm(beyond)), dqc.plants.Integrator()
    tasks = [dqc.controller.FurtherTask("relative", gain=20.0, level=0)]
    excess = {}
    for constraints in (None, dqc.constraints.Constraints()):
        law = dqc.laws.Proportional(gain=3.0, constraints=constraints)
        record = dqc.simulate(arms, goal, law, plant, start, 0.01, 3.0, tasks=tasks)
        held = dqc.algebra.translation(arms.relative_pose(record.q))
        assert np.abs(held - held[0]).max() < 1e-3
        over = np.maximum(record.q - arms.limits.upper, arms.limits.lower - record.q)
        excess[constraints is None] = over.max()
    assert excess[True] > 0.5
    assert excess[False] <= 1e-12

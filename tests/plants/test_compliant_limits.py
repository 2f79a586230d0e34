"""Modified clamping in physics: random runs that are drawn out of the joint limits, one after the other."""

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.laws import HInfinity, LinearQuadraticDQ, Proportional
from dqcontrol.limits import CommandLimits, ModifiedClamping
from dqcontrol.loop import simulate
from dqcontrol.plants import CompliantPlant
from dqcontrol.plants.compliant.controller_file import load_controllers

pytest.importorskip("mujoco")

SEED = 20261121
T = 0.02
LAWS = (
    Proportional(gain=5.0),
    HInfinity(orientation_gain=10.0, translation_gain=5.0),
    LinearQuadraticDQ(error_weight=25.0, control_weight=1.0),
)


@pytest.mark.parametrize("count", [40, pytest.param(1000, marks=pytest.mark.slow)])
def test_commands_never_leave_the_limits_and_measured_angles_by_less_than_the_springs_give_way(count):
    """Half a second each, towards the pose of a configuration up to 1.5 rad away, often beyond the limits."""
    print("seed", SEED)
    rng, arm = np.random.default_rng(SEED), dqc.load_robot("meka-a2")
    stiffness = load_controllers(arm).actuation("default").stiffness
    limits = CommandLimits(position=ModifiedClamping())
    lower, upper = arm.limits.lower, arm.limits.upper

    def excess(angles):
        return np.maximum(angles - upper, lower - angles)

    commanded, moved, sensed, given = -np.inf, -np.inf, -np.inf, 0.0
    overshoot, reached, beyond = -np.inf, 0, 0
    for k in range(count):
        start = rng.uniform(lower, upper)
        goal = dqc.references.SetPoint(arm.fkm(start + rng.uniform(-1.5, 1.5, 7)), duration=0.5)
        plant = CompliantPlant(command_mode=("measured", "integrated")[k % 2])
        run = simulate(arm, goal, LAWS[k % 3], plant, start, T, limits=limits, seed=k)
        asked = excess(run.readings["reference"].values)
        # To hold the arm at its start it may be out; it comes in at once.
        inside = np.logical_or.accumulate(asked <= 0.0, axis=0)
        assert (np.diff(asked, axis=0)[~inside[1:]] < 0.0).all()
        commanded = max(commanded, asked[inside].max())
        out = excess(run.q).max(axis=0)
        give = (np.abs(run.readings["spring_torque"].values) / stiffness).max(axis=0)
        sensed = max(sensed, excess(run.measured).max())
        moved, given = max(moved, out.max()), max(given, give.max())
        reached += (asked == 0.0).any()
        beyond += (out > give).any()
        overshoot = max(overshoot, (out - give).max())
    print(f"{count} runs, {reached} with a command at a limit")
    print(
        f"beyond the limits: commands {commanded:g} rad, joints {moved:.3g} rad, as measured {sensed:.3g} rad"
    )
    print(f"largest deflection of a spring: {given:.3g} rad")
    print(f"joints beyond by more than their own spring gives: in {beyond} runs, by {overshoot:.2g} rad more")
    assert reached > count / 4
    assert commanded <= 0.0
    assert moved <= given
    assert overshoot <= 1e-3  # joints overshoot their targets a little as well

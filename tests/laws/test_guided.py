"""Proportional control along a plan: exactly there on ideal joints, back to it after a disturbance, by a spec too."""

import numpy as np
import pytest
from hand_twist import hand_jacobian, inverse_by_svd

import dqcontrol as dqc
from dqcontrol.errors import Error
from dqcontrol.laws import BestHeading, GuidedProportional
from dqcontrol.limits import CommandLimits, ModifiedClamping
from dqcontrol.plants import Integrator
from dqcontrol.references import DriveTo, SetPoint, random_goals

HOME = np.array([0, 0, 0, 0, -0.9, 0.9, 0.9, 0])
AWAY = np.array([0.5, 0.4, 1.0, 0.3, 0.2, -0.2, 0.1, 0.4])
SEED = 20261202
LAW = GuidedProportional(gain=1.0)
LIMITS = CommandLimits(position=ModifiedClamping(), velocity=True)


@pytest.fixture(scope="module")
def robot():
    return dqc.load_robot("little-john")


@pytest.mark.slow
def test_far_goals_are_reached_within_all_limits(robot):
    """Any heading, any arm configuration; 40 of the 100 that benchmarks/goals.py runs."""
    print("seed", SEED)
    for goal in robot.fkm(random_goals(robot, HOME, 40, reach=1.5, seed=SEED)):
        way = DriveTo.pose(robot, HOME, goal)
        record = dqc.simulate(robot, way, LAW, Integrator(), HOME, 0.05, way.duration + 3, limits=LIMITS)
        assert record.error.max() < 1e-5
        assert ((record.q >= robot.limits.lower) & (record.q <= robot.limits.upper)).all()


@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_command_is_the_definition(robot, share):
    rng = np.random.default_rng(SEED)
    way = DriveTo(robot, HOME, HOME + AWAY)
    law = GuidedProportional(gain=1.5, pull=0.7).prepare(robot, way, 0.05)
    for k in (0, 40, 100) if not share else [round((way.duration + share) / 0.05)]:
        time = 0.05 * k
        w = min(max(time - way.duration, 0.0), 1.0)
        assert w == pytest.approx(share, abs=0.03)
        planned, inputs = way.configurations([time])[0], way.mean_inputs([time], 0.05)[0]
        q = planned + 0.02 * rng.standard_normal(8)
        away, (c, s) = planned - q, (np.cos(q[2]), np.sin(q[2]))
        ahead, left = c * away[0] + s * away[1], c * away[1] - s * away[0]
        z = 0.7 * np.r_[ahead, np.sin(away[2]), away[3:]]
        z[1] += 4.0 * inputs[0] * left
        weight = np.array([LAW.inverse.characteristic_length] * 3 + [1.0] * 3)
        jacobian, sample = weight[:, None] * hand_jacobian(robot, q), way.at(time)
        task = dqc.laws.Proportional(gain=1.5).command(robot, q, sample, 0.05)
        expected = inputs + z + w * (task - inverse_by_svd(jacobian, LAW.inverse) @ (jacobian @ z))
        np.testing.assert_allclose(law.command(q, sample, law.initial_state(q)), expected, atol=1e-6)


@pytest.mark.parametrize("plant", [dqc.plants.Servo(), Integrator()], ids=["servo", "ideal"])
def test_it_arrives_from_beside_its_plan_too(robot, plant):
    off = HOME + np.array([0.03, -0.02, 0.1, 0.05, -0.05, 0.05, 0.05, 0.05])
    goal = robot.fkm(np.array([-1.0, 0.5, 3.0, 0.4, -0.6, 0.7, 0.8, 0.3]))
    way = DriveTo.pose(robot, HOME, goal)
    record = dqc.simulate(robot, way, LAW, plant, off, 0.05, way.duration + 15, limits=LIMITS)
    assert record.error[0] > 0.02
    assert record.error[-50:].max() < 1e-3


def test_compiled_and_interpreted_are_equal(robot):
    way = DriveTo(robot, HOME, HOME + AWAY)
    runs = [
        dqc.simulate(robot, way, LAW, Integrator(), HOME + 0.02, 0.05, interpreted=how)
        for how in (False, True)
    ]
    np.testing.assert_array_equal(runs[0].q, runs[1].q)


def test_bad_input(robot):
    way = DriveTo(robot, HOME, HOME)
    with pytest.raises(Error, match="law: guided-proportional follows a drive-to or plan-to reference"):
        LAW.prepare(robot, SetPoint(robot.fkm(HOME)), 0.05)
    with pytest.raises(Error, match="planned for iiwa7"):
        LAW.prepare(dqc.load_robot("iiwa7"), way, 0.05)
    with pytest.raises(Error, match="null_space: leave it out"):
        GuidedProportional(gain=1.0, null_space=BestHeading()).prepare(robot, way, 0.05)
    with pytest.raises(Error, match="pull: must be > 0, got 0"):
        GuidedProportional(gain=1.0, pull=0).prepare(robot, way, 0.05)


def test_in_a_spec():
    spec = {
        "name": "way",
        "robot": "little-john",
        "start": HOME.tolist(),
        "reference": {
            "kind": "drive-to",
            "offset": {"translation": [-0.8, 0.6, 0.05], "rotation": [0, 0, 2.5]},
        },
        "period": 0.05,
        "law": {"kind": "guided-proportional", "gain": 1.0},
        "plant": {"kind": "integrator"},
    }
    run = dqc.run(spec)
    assert run.error.max() < 1e-5
    assert np.linalg.norm(run.record.position[-1] - run.record.position[0]) > 0.9
    nested = {
        "kind": "sequence",
        "references": [{"kind": "set-point", "duration": 1.0}, {"kind": "drive-to"}],
    }
    with pytest.raises(Error, match=r"reference.references\[1\]: drive-to starts where the robot does"):
        dqc.run(spec | {"reference": nested})

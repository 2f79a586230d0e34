"""Preferences that avoid joint limits: gradients against finite differences, what they do, what they do not."""

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.errors import Error
from dqcontrol.laws import HInfinity, JointCentring, LimitAvoidance, Proportional
from dqcontrol.robots import Limits

SEED = 20260802


@pytest.fixture(scope="module")
def arm():
    return dqc.load_robot("panda")  # ranges that are not symmetric


def preferred(arm, null_space, q):
    """Return z at q."""
    prepared = Proportional(gain=1.0, null_space=null_space).prepare(arm, None, 0.01)
    prepared.command(q, dqc.Sample(arm.fkm(q)), prepared.initial_state(q))
    return prepared.preferred.copy()


def liegeois(arm, q):
    middle = (arm.limits.upper + arm.limits.lower) / 2
    return (((q - middle) / (middle - arm.limits.upper)) ** 2).mean()


def zghal(arm, q):
    lower, upper = arm.limits.lower, arm.limits.upper
    return ((upper - lower) / ((upper - q) * (q - lower))).sum()


@pytest.mark.parametrize(
    ("criterion", "null_space"),
    [(liegeois, JointCentring(gain=0.7)), (zghal, LimitAvoidance(gain=0.7, fastest=1e9))],
)
def test_the_motion_descends_the_gradient(arm, criterion, null_space):
    print("seed", SEED)
    rng = np.random.default_rng(SEED)
    for _ in range(20):
        q = rng.uniform(arm.limits.lower + 0.1, arm.limits.upper - 0.1)
        gradient = [(criterion(arm, q + h) - criterion(arm, q - h)) / 2e-5 for h in 1e-5 * np.eye(7)]
        np.testing.assert_allclose(
            preferred(arm, null_space, q), -0.7 * np.array(gradient), rtol=1e-5, atol=1e-7
        )


@pytest.mark.parametrize("null_space", [JointCentring(gain=5.0), LimitAvoidance(gain=0.5)])
def test_in_the_null_space_the_criterion_falls_and_the_hand_rests(arm, null_space):
    q = np.array([1.5, 1.2, -1.6, -2.0, 1.4, 2.2, 1.2])
    target = dqc.references.SetPoint(arm.fkm(q))
    law = HInfinity(orientation_gain=2.0, translation_gain=2.0, null_space=null_space)
    record = dqc.simulate(arm, target, law, dqc.plants.Integrator(), q, period=0.002, duration=4.0)
    assert record.position_error.max() < 1e-4
    criterion = liegeois if isinstance(null_space, JointCentring) else zghal
    values = [criterion(arm, row) for row in record.q]
    assert values[-1] < 0.95 * values[0]
    assert np.diff(values).max() < 1e-6


def test_speeds_are_cut_off_at_and_beyond_limits(arm):
    null_space = LimitAvoidance(gain=0.1, fastest=0.3)
    for beyond in (-1e-9, 0.0, 0.2):
        q = np.where(np.arange(7) % 2, arm.limits.upper + beyond, arm.limits.lower - beyond)
        wanted = np.where(np.arange(7) % 2, -0.3, 0.3)
        np.testing.assert_allclose(preferred(arm, null_space, q), wanted)


@pytest.mark.parametrize("null_space", [JointCentring(gain=1.0), LimitAvoidance(gain=1.0)])
def test_joints_without_limits_are_passed_over(null_space):
    inf = np.full(3, np.inf)
    dh = [0, 0, 0], [0, 0, 0], [1, 1, 1], [0, 0, 0]
    arm = dqc.SerialArm.from_dh(
        *dh, limits=Limits(np.array([-np.inf, -1, -1]), np.array([np.inf, np.inf, 2]), inf, inf)
    )
    z = preferred(arm, null_space, np.array([0.3, 0.4, 1.5]))
    assert z[:2].tolist() == [0.0, 0.0]
    assert z[2] < 0
    with pytest.raises(Error, match="null_space: arm has no joint limits to keep"):
        Proportional(gain=1.0, null_space=null_space).prepare(dqc.SerialArm.from_dh(*dh), None, 0.01)


@pytest.mark.parametrize(
    ("kind", "parameters", "text"),
    [
        (JointCentring, {"gain": -1.0}, "gain: must be > 0, got -1"),
        (LimitAvoidance, {"gain": 0.0}, "gain: must be > 0, got 0"),
        (LimitAvoidance, {"gain": 1.0, "fastest": 0.0}, "fastest: must be > 0, got 0"),
    ],
)
def test_bad_parameters_are_refused(kind, parameters, text):
    with pytest.raises(Error, match=text):
        kind(**parameters)

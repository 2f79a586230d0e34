"""Ways in a row: where the robot is, that its inputs lead there, and that the law follows them as one."""

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.errors import ShapeError, ValueRangeError
from dqcontrol.references import DriveThrough, DriveTo

HOME = np.array([0, 0, 0, 0, -0.9, 0.9, 0.9, 0])
AWAY = np.array([0.8, -0.5, 1.0, 0.3, -0.6, 0.6, 0.9, 0])
T = 0.05


@pytest.fixture(scope="module")
def robot():
    return dqc.load_robot("little-john")


def test_inputs_lead_along_the_configurations_and_the_law_follows(robot):
    there = DriveTo(robot, HOME, AWAY)
    way = DriveThrough([there, DriveTo(robot, AWAY, HOME)], pauses=[1.0, 0.5])
    np.testing.assert_allclose(way.arrivals, [there.duration, way.duration - 0.5])
    times = np.arange(0.0, way.duration + T, T)
    q, u = way.configurations(times), way.mean_inputs(times, T)
    resting = (times > way.arrivals[0]) & (times < way.arrivals[0] + 1.0)
    np.testing.assert_allclose(q[resting], np.tile(AWAY, (resting.sum(), 1)), atol=1e-12)
    np.testing.assert_allclose(q[[0, -1], 3:], [HOME[3:]] * 2, atol=1e-9)
    at = HOME.copy()
    for inputs in u[:-1]:
        at = robot.integrate(at, inputs, T)
    np.testing.assert_allclose(at[:2], HOME[:2], atol=5e-3)  # a turn and a drive may share one period
    law = dqc.laws.GuidedProportional(gain=1.0)
    record = dqc.simulate(robot, way, law, dqc.plants.Integrator(), HOME, T)
    assert record.error.max() < 5e-3


def test_ways_that_do_not_fit_are_refused(robot):
    there = DriveTo(robot, HOME, AWAY)
    for ways, pauses, error, message in (
        ([there], [0.0, 1.0], ShapeError, "pauses: expected 1 numbers, one a way, got 2"),
        ([there], [-1.0], ValueRangeError, "pauses: must be ≥ 0, got -1"),
        ([there, there], [0.0, 0.0], ValueRangeError, r"ways\[1\]: must begin where ways\[0\] ends"),
    ):
        with pytest.raises(error, match=message):
            DriveThrough(ways, pauses)

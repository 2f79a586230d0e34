"""A base that moves sideways goes through doors as a part of the joint space."""

import math

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.planning import plan

ROBOT = dqc.load_robot("youbot")
HOME = np.array([0, 0, 0, 0.0, 0.3, -1.0, 0.5, 0.0])
AROUND = math.hypot(*(2 * ROBOT.shapes.shapes[0].shape.row[1:3]))  # m: whichever way the chassis faces


@pytest.mark.parametrize("seed", range(8))
def test_a_door_of_105_percent_of_the_chassis_and_what_is_asked_is_passed(seed):
    rng = np.random.default_rng([8, seed])
    margin, angle, beside = (0.02, 0.05)[seed % 2], rng.uniform(-0.9, 0.9), rng.uniform(-0.4, 0.4)
    width = 1.05 * (AROUND + 2 * margin)
    c, s = math.cos(angle), math.sin(angle)
    turn = np.array([[c, -s], [s, c]])

    def wall(low, high):
        x, y = (turn @ [1.25, 0.5 * (low + high)]).tolist()
        return dqc.world.Body(box=(0.1, high - low, 1.5), position=(x, y, 0.75), rpy=(0, 0, angle))

    walls = {"left": wall(beside + 0.5 * width, beside + 9), "right": wall(beside - 9, beside - 0.5 * width)}
    keep = dqc.constraints.Constraints(
        world=dqc.World(bodies=walls), clear_of="all", margin=margin, self_margin=0.01
    )
    goal = HOME.copy()
    goal[:2], goal[2] = turn @ [2.4, beside + rng.uniform(-0.2, 0.2)], rng.uniform(-2, 2)
    way = plan(ROBOT, keep, HOME, goal, seed=seed)
    q = way.way.at(np.linspace(0, way.length, 2000))[0]
    assert (way.kept.values(q, np.zeros(len(q))) >= way.kept.asked).all()
    x, y = (q[:, :2] @ turn).T
    assert ((np.abs(x - 1.25) < 0.05) & (np.abs(y - beside) < 0.5 * width)).any()
    np.testing.assert_allclose(q[-1], goal, atol=1e-12)

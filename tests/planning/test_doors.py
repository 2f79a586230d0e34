"""A base that moves sideways goes through doors as a part of the joint space."""

import math

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.errors import PlanError
from dqcontrol.planning import plan

ROBOT = dqc.load_robot("youbot")
HOME = np.array([0, 0, 0, 0.0, 0.3, -1.0, 0.5, 0.0])
assert ROBOT.shapes is not None
LENGTH, WIDTH = 2 * ROBOT.shapes.shapes[0].shape.row[1:3]  # m: of the chassis


@pytest.mark.parametrize("side", [math.hypot(LENGTH, WIDTH), WIDTH], ids=["whichever way it faces", "narrow"])
@pytest.mark.parametrize("seed", range(8))
def test_a_door_of_105_percent_of_the_chassis_and_what_is_asked_is_passed(seed, side):
    """Through the narrow ones it goes only within 2° of straight on, and 12 mm of the middle."""
    rng = np.random.default_rng([8, seed])
    margin, angle, beside = (0.02, 0.05)[seed % 2], rng.uniform(-0.9, 0.9), rng.uniform(-0.4, 0.4)
    width = 1.05 * (side + 2 * margin)
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


def test_one_narrow_door_after_another_is_passed_and_one_that_is_too_narrow_is_not():
    goal = HOME.copy()
    goal[:3] = 4.0, 0.2, 1.0
    for share, effort in ((1.05, 20_000), (0.99, 2_000)):
        width, walls = share * (WIDTH + 0.04), {}
        for k, (x, beside) in enumerate(((1.25, 0.3), (2.75, -0.3))):
            for side in (-1, 1):
                y = beside + side * (0.5 * width + 4.0)
                walls[f"wall {k} {side}"] = dqc.world.Body(box=(0.1, 8.0, 1.5), position=(x, y, 0.75))
        keep = dqc.constraints.Constraints(
            world=dqc.World(bodies=walls), clear_of="all", margin=0.02, self_margin=0.01
        )
        if share < 1:
            with pytest.raises(PlanError, match="no way within 2001 edges"):
                plan(ROBOT, keep, HOME, goal, effort=effort)
            continue
        way = plan(ROBOT, keep, HOME, goal, effort=effort)
        q = way.way.at(np.linspace(0, way.length, 4000))[0]
        assert (way.kept.values(q, np.zeros(len(q))) >= way.kept.asked).all()
        assert way.certificate.edges < 5000
        again = plan(ROBOT, keep, HOME, goal, effort=effort)
        assert np.array_equal(again.configurations, way.configurations)

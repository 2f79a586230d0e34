"""Bases go through doors: one that moves sideways as a part of the joint space, one that drives straight on."""

import math

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.errors import PlanError
from dqcontrol.geometry import distance
from dqcontrol.planning import drive_and_plan, plan

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


@pytest.mark.parametrize(
    "seed", [0, pytest.param(1, marks=pytest.mark.slow), pytest.param(2, marks=pytest.mark.slow)]
)
def test_a_base_that_drives_leaves_a_room_through_a_door_hardly_wider_than_it_is(seed):
    """It has 10 mm on each side, and only behind the door room to turn: grids of discs find no way."""
    robot = dqc.load_robot("little-john")
    chassis = robot.shapes.shapes[0].shape.radius
    rng = np.random.default_rng([14, seed])
    half, beside = 0.5 * 1.05 * (2 * chassis + 0.04), rng.uniform(-0.4, 0.4)
    sizes = {
        "left": (1.25, 0.5 * (2 + beside + half), 0.1, 2 - beside - half),
        "right": (1.25, 0.5 * (beside - half - 2), 0.1, 2 + beside - half),
        "back": (-1.25, 0.0, 0.1, 4.0),
        "side": (0.0, 2.0, 2.6, 0.1),
        "other side": (0.0, -2.0, 2.6, 0.1),
    }
    room = {
        name: dqc.world.Body(box=(dx, dy, 1.5), position=(x, y, 0.75))
        for name, (x, y, dx, dy) in sizes.items()
    }
    keep = dqc.constraints.Constraints(
        world=dqc.World(bodies=room), clear_of="all", margin=0.02, self_margin=0.005, acceleration=5
    )
    start = np.array([0, 0, 0, 0, -0.9, 0.9, 0.9, 0])
    goal = np.array([2.6, beside, rng.uniform(-2, 2), 0.3, -0.6, 0.9, 0.7, 0])
    hand = dqc.DualQuaternion(robot.fkm(goal))
    way = drive_and_plan(robot, keep, start, hand, seed=seed)
    q = way.configurations(np.linspace(0, way.duration, 4000))
    walls = [body.shapes[0] for body in room.values()]
    base = robot.shapes.shapes[0]
    for each in q[::20]:
        moved = base.shape.moved(robot.frames(each)[base.frame - 1])
        assert min(distance(moved, wall).distance for wall in walls) >= 0.02
    assert (way.arm.plan.kept.values(q, np.zeros(len(q))) >= way.arm.plan.kept.asked).all()
    assert (hand.vec8 @ robot.fkm(q[-1])) ** 2 > 1 - 1e-9
    again = drive_and_plan(robot, keep, start, hand, seed=seed)
    assert np.array_equal(again.configurations([1.0, 5.0]), way.configurations([1.0, 5.0]))


@pytest.mark.parametrize("seed", [0, pytest.param(3, marks=pytest.mark.slow)])
def test_a_base_that_steers_goes_through_such_a_door_too(seed):
    """No word of three arcs and lines leads there: it drives to the door, through, and on."""
    own = dqc.load_robot("little-john")
    car = dqc.CarLikeBase(0.065, 0.13, wheelbase=0.3, steering_limit=0.6, rim_speed=1.0)
    robot = dqc.WholeBody([car, *own.parts[1:]])
    robot.shapes = own.shapes
    rng = np.random.default_rng([14, seed])
    half = 0.5 * 1.05 * (2 * own.shapes.shapes[0].shape.radius + 0.04)
    ends = {"left": (2.0 + half, 2.0 - half), "right": (-2.0 - half, 2.0 - half)}
    walls = {
        name: dqc.world.Body(box=(0.1, size, 1.5), position=(1.25, 0.5 * middle, 0.75))
        for name, (middle, size) in ends.items()
    }
    walls |= {
        f"side {y:g}": dqc.world.Body(box=(2.6, 0.1, 1.5), position=(0.0, y, 0.75)) for y in (-2.0, 2.0)
    }
    keep = dqc.constraints.Constraints(
        world=dqc.World(bodies=walls), clear_of="all", margin=0.02, self_margin=0.005, acceleration=5
    )
    start = np.array([0, -0.8, 2.0, 0, -0.9, 0.9, 0.9, 0])
    goal = np.array([2.6, rng.uniform(-0.5, 0.5), rng.uniform(-2, 2), 0.3, -0.6, 0.9, 0.7, 0])
    hand = dqc.DualQuaternion(robot.fkm(goal))
    way = drive_and_plan(robot, keep, start, hand, seed=seed)
    q = way.configurations(np.linspace(0, way.duration, 4000))
    base, boxes = robot.shapes.shapes[0], [body.shapes[0] for body in walls.values()]
    for each in q[::20]:
        moved = base.shape.moved(robot.frames(each)[base.frame - 1])
        assert min(distance(moved, box).distance for box in boxes) >= 0.02
    assert (hand.vec8 @ robot.fkm(q[-1])) ** 2 > 1 - 1e-9
    rolled, turned = np.diff(q[:, :2], axis=0), np.diff(q[:, 2])
    size = np.linalg.norm(rolled, axis=1)
    assert np.abs(turned[size > 1e-4] / size[size > 1e-4]).max() < 1.01 * np.tan(0.6) / 0.3  # as it can steer
    again = drive_and_plan(robot, keep, start, hand, seed=seed)
    assert np.array_equal(again.configurations([1.0, 5.0]), way.configurations([1.0, 5.0]))


def test_where_a_base_gets_nowhere_the_line_says_so():
    """A closed room, and a goal outside of it."""
    robot = dqc.load_robot("little-john")
    sides = {"left": (0, 1.5), "right": (0, -1.5), "front": (1.5, 0), "back": (-1.5, 0)}
    walls = {
        name: dqc.world.Body(box=(0.1, 3.1, 1.5) if x else (3.1, 0.1, 1.5), position=(x, y, 0.75))
        for name, (x, y) in sides.items()
    }
    keep = dqc.constraints.Constraints(world=dqc.World(bodies=walls), clear_of="all", acceleration=5)
    goal = dqc.DualQuaternion(robot.fkm([4, 0, 0, 0.3, -0.6, 0.9, 0.7, 0]))
    with pytest.raises(
        PlanError, match=r"^plan: no way of the base was found to where the arm reaches the goal$"
    ):
        drive_and_plan(robot, keep, [0, 0, 0, 0, -0.9, 0.9, 0.9, 0], goal)

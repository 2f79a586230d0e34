"""Plans against samples of them, against Coal, and what is said where there is none."""

import subprocess
import sys

import msgspec
import numpy as np
import pytest
from obstacles import around, box, plane, sphere
from planning_scenes import (
    least_sampled,
    links_of,
    load,
    random_configurations,
    random_constraints,
    things_of,
)
from shape_samples import coal_distance

import dqcontrol as dqc
from dqcontrol.errors import MissingExtraError, PlanError, ShapeError, ValueRangeError
from dqcontrol.planning import CertifiedEdges, plan

START = np.array([0, -0.8, 0, -2.4, 0, 1.6, 0.8])
GOAL = np.array([1.5, -0.8, 0, -2.4, 0, 1.6, 0.8])


def shelf(**options):
    """Return constraints with two boards of a shelf in front of the robot."""
    boards = {
        "lower": box(position=(0.65, 0, 0.15), size=(0.3, 1.0, 0.02)),
        "upper": box(position=(0.65, 0, 0.6), size=(0.3, 1.0, 0.02)),
    }
    return dqc.constraints.Constraints(**around(boards), **options)


def inside_shelf():
    """Return a configuration with the hand between the boards, and a pose above them."""
    forwards = dqc.algebra.rotation_from_rpy([0, np.pi / 2, 0])
    start = np.array([1.023, 0.283, -1.448, -2.253, 2.623, 2.231, 0.643])
    return start, dqc.algebra.pose(forwards, [0.5, 0.2, 0.78])


def scene(rng, robot):
    """Return constraints and two configurations with a way over a third one, the straight way between them blocked."""
    while True:
        given = random_constraints(rng, robot)
        edges = CertifiedEdges(robot, given)
        q = random_configurations(rng, robot, 60)
        q = q[edges.room_at(q)[0] > 0.02]
        if len(q) < 3:
            continue
        clear = np.array([edges.clear(np.tile(each, (len(q), 1)), q).certified for each in q]).reshape(
            len(q), len(q)
        )
        over = (clear.astype(int) @ clear.astype(int) > 0) & ~clear
        if over.any():
            start, goal = np.argwhere(over)[0]
            return given, q[start], q[goal]


@pytest.mark.parametrize("name", ["panda", "ur5", "two-pandas", "youbot"])
def test_ways_around_keep_what_is_asked_all_along(name):
    robot, rng = load(name), np.random.default_rng([1, len(name)])
    for _ in range(3):
        given, start, goal = scene(rng, robot)
        way = plan(robot, given, start, goal)
        q = way.configurations
        assert np.array_equal(q[0], start)
        assert np.abs(q[-1] - goal).max() < 1e-12
        assert len(q) > 2
        edges = CertifiedEdges(robot, way.kept)
        assert least_sampled(edges, q[:-1], q[1:], 500).min() >= 0.0
        gone = way.way.at(np.linspace(0.0, way.length, 3000))[0]
        values = edges.kept.values(gone, np.zeros(3000)) - (way.kept.asked + way.kept.allowances)
        assert values.min() >= -1e-9
        sampled = values[:, ~edges.kept.is_angle].min()
        assert -1e-9 < sampled - way.certificate.room < 3e-4  # what it proves, and what samples miss
        assert (gone >= robot.limits.lower - 1e-9).all()
        assert (gone <= robot.limits.upper + 1e-9).all()


def test_coal_finds_nothing_too_near_on_a_way_out_of_a_shelf():
    coal = pytest.importorskip("coal", reason="Coal is the reference")
    robot, given = load("panda"), shelf()
    start, pose = inside_shelf()
    way = plan(robot, given, start, pose)
    assert len(way.configurations) > 2
    reached = dqc.DualQuaternion(robot.fkm(way.configurations[-1]))
    assert np.abs(reached.matrix() - dqc.DualQuaternion(pose).matrix()).max() < 1e-5
    for q in way.way.at(np.linspace(0.0, way.length, 60))[0]:
        frames = robot.frames(q)
        for link in links_of(robot):
            if link.frame > 0:
                shape = link.shape.moved(frames[link.frame - 1])
                for _, board in things_of(given):
                    assert coal_distance(coal, shape, board) >= given.margin - 1e-6


def test_the_straight_way_is_taken_where_it_is_clear():
    way = plan(load("panda"), dqc.constraints.Constraints(), START, GOAL)
    assert np.array_equal(way.configurations, [START, GOAL])
    assert way.certificate.edges == 1


def test_the_same_seed_is_the_same_way_twice_and_in_another_process():
    robot, given = load("panda"), shelf()
    start, pose = inside_shelf()
    first = plan(robot, given, start, pose, seed=3).configurations
    other = plan(robot, given, start, pose, seed=4).configurations
    assert np.array_equal(plan(robot, given, start, pose, seed=3).configurations, first)
    assert other.shape != first.shape or not np.array_equal(other, first)
    program = (
        "import sys; sys.path[:0] = sys.argv[1:]\n"
        "from test_plan import *\n"
        "start, pose = inside_shelf()\n"
        "print(plan(load('panda'), shelf(), start, pose, seed=3).configurations.tobytes().hex())"
    )
    done = subprocess.run(
        [sys.executable, "-c", program, *sys.path], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == first.tobytes().hex()
    said = [line for line in done.stderr.splitlines() if not line.startswith("dqcontrol: compiling")]
    assert said == []  # OMPL logs, and nanobind counts leaks, on the way out


def test_clearance_is_kept_beyond_the_margin():
    robot = load("panda")
    start, pose = inside_shelf()
    way = plan(robot, shelf(), start, pose, clearance=0.008)
    q = way.configurations
    assert least_sampled(CertifiedEdges(robot, shelf()), q[:-1], q[1:], 500).min() >= 0.008


def test_a_start_within_something_says_what_and_how_deep():
    hand = dqc.DualQuaternion(load("panda").fkm(START)).translation
    keep = dqc.constraints.Constraints(**around({"ball": sphere(hand, 0.05)}))
    with pytest.raises(
        PlanError, match=r"start: ball: panda_link7: .* mm deep, 10 mm of distance are asked"
    ) as told:
        plan(load("panda"), keep, START, GOAL)
    assert told.value.reason == "start"
    assert told.value.pair == "ball: panda_link7"


def test_a_start_beyond_a_limit_by_rounding_is_none():
    robot = load("panda")
    at_end = START.copy()
    at_end[3] = robot.limits.lower[3] - 4e-16
    assert plan(robot, dqc.constraints.Constraints(self_collision=False), at_end, START).length > 0.1
    at_end[3] = robot.limits.lower[3] - 1e-6
    with pytest.raises(PlanError, match=r"start: panda_joint4 is .* outside its limits") as told:
        plan(robot, dqc.constraints.Constraints(self_collision=False), at_end, START)
    assert (told.value.reason, told.value.pair) == ("start", "panda_joint4")


def test_goals_that_nobody_reaches_or_may_be_at_are_told_apart():
    robot = load("panda")
    with pytest.raises(
        PlanError, match=r"goal: unreachable: the position is .* beyond the reach of panda"
    ) as told:
        plan(robot, dqc.constraints.Constraints(), START, dqc.DualQuaternion.from_translation([2.0, 0, 0]))
    assert told.value.reason == "unreachable"
    there = dqc.DualQuaternion(robot.fkm(GOAL)).translation
    keep = dqc.constraints.Constraints(**around({"ball": sphere(there, 0.1)}))
    with pytest.raises(
        PlanError, match=r"goal: the best of \d+ configurations there is not clear: ball: .* deep"
    ) as told:
        plan(robot, keep, START, robot.fkm(GOAL))
    assert told.value.reason == "goal"
    assert told.value.pair.startswith("ball: ")
    with pytest.raises(PlanError, match="goal: the configuration there is not clear") as told:
        plan(robot, keep, START, GOAL)
    beyond = GOAL.copy()
    beyond[0] = 3.5
    with pytest.raises(PlanError, match=r"goal: panda_joint1 is 3\.5, outside its limits") as told:
        plan(robot, keep, START, beyond)
    assert told.value.reason == "unreachable"


def test_no_way_within_the_effort_says_how_near_it_came():
    """A wall that divides the room: the arm's base is on one side."""
    robot = load("panda")
    wall = dqc.constraints.Constraints(
        **around({"wall": box((0.0, 0.15, 0.5), (4.0, 0.02, 4.0), links=["panda_link7"])})
    )
    with pytest.raises(
        PlanError, match=r"no way within 20\d\d? edges; it came within .* rad of a goal, its hand"
    ) as told:
        plan(robot, wall, START, GOAL, effort=200)
    assert told.value.reason == "effort"
    assert told.value.pair == "wall: panda_link7"
    assert told.value.nearest.shape == (7,)


def test_a_robot_that_touches_can_be_planned_away():
    """Where a law holds it, a hand is just as far as is asked, to rounding."""
    robot = load("panda")
    rng = np.random.default_rng(8)
    hand = dqc.DualQuaternion(robot.fkm(START)).translation
    for _ in range(10):
        away = rng.normal(size=3)
        ball = sphere(hand + 0.2 * away / np.linalg.norm(away), 0.05)
        loose = CertifiedEdges(robot, dqc.constraints.Constraints(**around({"ball": ball}), margin=0.0))
        mine = [label.startswith("ball") for label in loose.kept.labels]
        margin = loose.kept.values(START[None], [0.0])[0][mine].min()
        if margin < 0:
            continue
        keep = dqc.constraints.Constraints(**around({"ball": ball}), margin=margin, self_margin=0.01)
        goals = random_configurations(rng, robot, 40)
        goal = goals[CertifiedEdges(robot, keep).room_at(goals)[0].argmax()]
        q = plan(robot, keep, START, goal).configurations
        assert least_sampled(CertifiedEdges(robot, keep), q[:-1], q[1:], 300).min() >= -3e-4


def test_an_arm_without_limits_is_planned_within_a_turn(make_arm):
    arm = make_arm(4, limits=dqc.robots.Limits([-np.inf] * 4, [np.inf] * 4, [2.0] * 4, [np.inf] * 4))
    floor = dqc.constraints.Constraints(**around({"floor": plane((0, 0, 1), -3.0, links=["hand"])}))
    assert plan(arm, floor, np.zeros(4), np.full(4, 0.5)).length == pytest.approx(1.0)


def test_a_library_that_is_missing_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "ompl.base", None)
    start, pose = inside_shelf()
    with pytest.raises(MissingExtraError, match=r"ompl: ways around .* pip install 'dqcontrol\[plan\]'"):
        plan(load("panda"), shelf(), start, pose)
    assert len(plan(load("panda"), dqc.constraints.Constraints(), START, GOAL).configurations) == 2


def test_what_is_given_is_checked():
    robot, keep = load("panda"), dqc.constraints.Constraints()
    with pytest.raises(ShapeError, match="start: expected shape"):
        plan(robot, keep, START[:6], GOAL)
    with pytest.raises(ShapeError, match="goal: expected shape"):
        plan(robot, keep, START, GOAL[:6])
    with pytest.raises(ValueRangeError, match="seed"):
        plan(robot, keep, START, GOAL, seed=-1)
    with pytest.raises(ValueRangeError, match="effort"):
        plan(robot, keep, START, GOAL, effort=1.5)
    with pytest.raises(ValueRangeError, match="clearance: must be ≥ 0"):
        plan(robot, keep, START, GOAL, clearance=-0.01)


def test_plain_constraints_are_planned_with_what_laws_keep_beyond_them():
    """So that a law which keeps them goes the way as planned."""
    robot, rng = load("panda"), np.random.default_rng(12)
    for _ in range(3):
        given, start, goal = scene(rng, robot)
        given = msgspec.structs.replace(given, acceleration=10.0)
        way = dqc.planning.PlanTo(plan(robot, given, start, goal))
        law = dqc.laws.GuidedProportional(gain=2.0, pull=5.0, constraints=given)
        record = dqc.simulate(robot, way, law, dqc.plants.Integrator(), start, 0.01)
        assert np.abs(record.q - way.configurations(record.time)).max() < 1e-6


def test_slides_without_limits_have_nothing_to_plan_within():
    limits = dqc.robots.Limits([-np.inf, -3.0], [np.inf, 3.0], [1.0, 2.0], [np.inf, np.inf])
    slider = dqc.SerialArm.from_dh(
        [0, 0], [0, 0], [0.0, 0.5], [np.pi / 2, 0], ["prismatic", "revolute"], limits=limits
    )
    hand = dqc.DualQuaternion(slider.fkm([0.5, 0.0])).translation
    ball = around({"ball": sphere(hand, 0.1, links=["hand"])})
    keep = dqc.constraints.Constraints(**ball)
    with pytest.raises(ValueRangeError, match=r"plan: .* has no limits to plan within"):
        plan(slider, keep, [0.0, 0.0], [1.0, 0.0])


def test_slides_without_limits_behind_what_turns_them_are_named():
    """Nobody knows how far from the first axis their shapes get, so how fast distances change."""
    limits = dqc.robots.Limits([-3.0, -np.inf], [3.0, np.inf], [2.0, 1.0], [np.inf, np.inf])
    slider = dqc.SerialArm.from_dh(
        [0, 0], [0, 0], [0.5, 0.0], [np.pi / 2, 0], ["revolute", "prismatic"], limits=limits
    )
    keep = dqc.constraints.Constraints(**around({"ball": sphere((0.0, 0.0, 3.0), 0.1, links=["hand"])}))
    with pytest.raises(ValueRangeError, match=r"constraints: .* has no limits of joint_2, which slides"):
        plan(slider, keep, [0.0, 0.0], [1.0, 0.0])


def test_constraints_that_contradict_each_other_name_what_is_crossed():
    """Two boxes apart, in both of which the hand is to stay."""
    robot = load("panda")
    zones = {
        name: dqc.constraints.Zone(box=0.1, position=(x, 0.0, 0.6))
        for name, x in (("left", 0.2), ("right", 0.5))
    }
    with pytest.raises(PlanError, match=r"start: (left|right): wall \d") as told:
        plan(robot, dqc.constraints.Constraints(zones=zones), START, GOAL)
    assert "\n" not in str(told.value)

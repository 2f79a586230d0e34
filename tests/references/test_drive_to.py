"""The way to a goal: twists of what the robot can do, exact ends, speeds within their share."""

import math

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol import algebra
from dqcontrol.errors import Error, ShapeError, UnreachableGoalError, ValueRangeError
from dqcontrol.references import DriveTo, random_goals
from dqcontrol.references.ways_around import across, body_points

START = np.array([0.3, -0.2, 0.5, 0, -0.9, 0.9, 0.9, 0])
SEED = 20261201


def bodies():
    drive = dqc.DifferentialDrive(0.05, 0.1, rim_speed=0.4)
    return {
        "little-john": dqc.load_robot("little-john"),
        "unconstrained": dqc.load_robot("little-john").in_form("unconstrained"),
        "two drives": dqc.WholeBody([drive, dqc.load_robot("ax18"), drive, dqc.load_robot("ax18")]),
        "holonomic": dqc.WholeBody([dqc.HolonomicBase(speed=0.3, turn_rate=1.0), dqc.load_robot("ax18")]),
        "arm": dqc.load_robot("iiwa7"),
    }


def ways(count=3):
    found = []
    for name, robot in bodies().items():
        rng = np.random.default_rng([SEED, len(name)])
        for _ in range(count):
            start, goal = rng.uniform(-1.4, 1.4, (2, robot.configuration_size))
            found.append(pytest.param(DriveTo(robot, start, goal), id=name))
    return found


@pytest.mark.parametrize("way", ways())
def test_inputs_move_the_robot_along_the_configurations_to_the_goal(way):
    """Exactly, where a sample does not hold both a turn and a drive; in all by the period's square."""
    robot, period = way.robot, way.duration / 4000
    times = period * np.arange(4001)
    planned, inputs = way.configurations(times), way.mean_inputs(times, period)
    q = planned[0]
    np.testing.assert_allclose(q, way.start)
    for k in range(4000):
        q = robot.integrate(q, inputs[k], period)
        if k % 500 == 499:
            np.testing.assert_allclose(q, planned[k + 1], atol=1e-6)
    away = q - way.goal
    for first in robot.drives[:, 0].astype(int):
        away[first + 2] = math.remainder(away[first + 2], math.tau)
    np.testing.assert_allclose(away, 0, atol=1e-6)


@pytest.mark.parametrize("way", ways(1))
def test_twists_and_rates_are_derivatives(way):
    times, h = np.linspace(0.05, 0.95, 40) * way.duration, 1e-5
    behind, here, ahead = (way.motion(times + d) for d in (-h, 0, h))
    moved = algebra.multiply(ahead[:, :8], algebra.conjugate(behind[:, :8]))
    np.testing.assert_allclose(here[:, 8:14], algebra.log_screw(moved) / h, atol=1e-7)
    np.testing.assert_allclose(here[:, 14:20], (ahead - behind)[:, 8:14] / (2 * h), atol=1e-6)
    jacobian, u = way.robot.twist_jacobian(way.configurations(times)), way.mean_inputs(times - h, 2 * h)
    np.testing.assert_allclose(here[:, 8:14], np.einsum("kij,kj->ki", jacobian, u), atol=1e-7)


@pytest.mark.parametrize("way", ways(1))
def test_speeds_stay_within_their_share_from_rest_to_rest(way):
    times = np.linspace(0, way.duration, 2001)
    u = way.mean_inputs(times, 1e-4)
    share = (np.abs(u) / way.robot.limits.velocity).max()
    assert 0.1 < share <= 0.5 + 1e-9
    assert np.abs(u[[0, -1]]).max() < 1e-5


def test_joints_stay_within_their_limits_and_the_hand_arrives():
    robot = dqc.load_robot("little-john")
    for goal in robot.fkm(random_goals(robot, START, 20, reach=1.5, seed=SEED)):
        way = DriveTo.pose(robot, START, goal)
        q = way.configurations(np.linspace(0, way.duration, 500))
        assert ((q >= robot.limits.lower) & (q <= robot.limits.upper)).all()
        arrived = algebra.short(algebra.multiply(algebra.conjugate(robot.fkm(q[-1])), goal))
        np.testing.assert_allclose(arrived, [1, 0, 0, 0, 0, 0, 0, 0], atol=2e-6)


def test_the_robot_does_not_go_through_itself_where_it_need_not():
    """Goals of configurations that are apart; the soonest way to one of them passes where the arm is in the chassis."""
    robot = dqc.load_robot("little-john")
    assert robot.shapes is not None
    drawn = random_goals(robot, START, 12, reach=1.5, seed=SEED)
    apart = drawn[robot.shapes.apart(robot, drawn) > 0.03]
    assert len(apart) > 4
    for goal in robot.fkm(apart):
        way = DriveTo.pose(robot, START, goal)
        q = way.configurations(np.linspace(0, way.duration, 500))
        assert robot.shapes.apart(robot, q).min() > 0.018


def test_it_backs_up_where_that_turns_less():
    robot = dqc.load_robot("little-john")
    behind = np.array([-1.0, 0.1, 0.1, *START[3:]])
    way = DriveTo(robot, np.zeros(8), behind)
    v = way.mean_inputs(np.linspace(0, way.duration, 200), 0.01)[:, 0]
    assert v.min() < -0.1
    assert v.max() <= 0


def test_staying_takes_no_time():
    robot = dqc.load_robot("little-john")
    way = DriveTo(robot, START, START)
    assert way.duration == 0
    np.testing.assert_allclose(way.at(1.0).pose, robot.fkm(START))
    assert not way.at(0.0).twist.any()


def test_bad_input():
    robot = dqc.load_robot("little-john")
    with pytest.raises(Error, match=r"goal: expected shape \(…, 8\)"):
        DriveTo(robot, START, np.zeros(7))
    with pytest.raises(Error, match="speed_fraction: must be > 0, got 0"):
        DriveTo(robot, START, START, speed_fraction=0)
    with pytest.raises(ValueRangeError, match="pose: little-john does not get there: unreachable"):
        DriveTo.pose(robot, START, algebra.pose([1, 0, 0, 0], [0, 0, 3.0]))
    unlimited = dqc.WholeBody([dqc.DifferentialDrive(0.05, 0.1), dqc.load_robot("ax18")])
    with pytest.raises(ValueRangeError, match=r"robot: v of .* has no velocity limit to plan with"):
        DriveTo(unlimited, START, START + np.eye(8)[0])


@pytest.mark.slow
def test_a_door_hardly_wider_than_the_robot_is_found():
    """Chassis, folded arm and clearance take 0.49 m of a door of 0.50 m, wherever it lies on the grid."""
    robot, start = dqc.load_robot("little-john"), np.array([0, 0, 0, 0, -0.9, 0.9, 0.9, 0])
    goal = robot.fkm([2.2, 0.1, 0.3, 0.2, -0.6, 0.7, 0.6, 0])
    for shift in (0.0, 0.013):
        right, left = shift - 0.25, shift + 0.25
        walls = [
            [[1, left], [1.1, left], [1.1, 5], [1, 5]],
            [[1, -5], [1.1, -5], [1.1, right], [1, right]],
        ]
        way = dqc.references.DriveTo.pose(robot, start, goal, floor=dqc.geometry.FloorMap(walls))
        driven, straight = way.detour
        assert driven < 1.1 * straight


def test_a_detour_says_how_far_it_is():
    robot, start = dqc.load_robot("little-john"), [0, 0, 0, 0, -0.9, 0.9, 0.9, 0]
    goal = [2, 0, 0, 0, -0.9, 0.9, 0.9, 0]
    way = dqc.references.DriveTo(robot, start, goal, via=[(0, 3), (2, 3)])
    assert way.detour == pytest.approx((8, 2))
    assert dqc.references.DriveTo(robot, start, goal).detour == (0, 0)


def test_no_plan_takes_the_hand_through_the_floor():
    robot, start = dqc.load_robot("little-john"), np.array([0, 0, 0, 0, -0.9, 0.9, 0.9, 0])
    rng = np.random.default_rng(7)
    lower, upper = robot.limits.lower, robot.limits.upper
    looked_at = 0
    for _ in range(12):
        q = rng.uniform(np.maximum(lower, -2), np.minimum(upper, 2))
        pose = robot.fkm(q)
        if dqc.algebra.translation(pose)[2] < 0.02:
            continue
        try:
            way = dqc.references.DriveTo.pose(robot, start, pose)
        except UnreachableGoalError:
            continue
        looked_at += 1
        heights = dqc.algebra.translation(robot.fkm(way.configurations(np.linspace(0, way.duration, 300))))[
            :, 2
        ]
        assert heights.min() > -5e-3  # between the instants that are looked at
    assert looked_at > 3


def test_a_base_of_unknown_width_is_not_planned_for():
    """Without shapes a chassis says how wide it is; without both a map is refused in a line."""
    floor = dqc.geometry.FloorMap([[[1, 0.5], [1.4, 0.5], [1.4, 0.9], [1, 0.9]]])
    bare = dqc.WholeBody([dqc.DifferentialDrive(0.05, 0.1, rim_speed=0.4), dqc.load_robot("ax18")])
    start, goal = np.array([0, 0, 0, 0, -0.9, 0.9, 0.9, 0]), bare.fkm([0.5, 0, 0, 0, -0.9, 0.9, 0.9, 0])
    with pytest.raises(
        ShapeError, match=r"clear_of: nothing says how wide the base of .* is: .*give its drive a chassis"
    ):
        DriveTo.pose(bare, start, goal, floor=floor)
    chassis = dqc.load_robot("little-john").parts[0].chassis
    wide = dqc.WholeBody(
        [dqc.DifferentialDrive(0.05, 0.1, rim_speed=0.4, chassis=chassis), dqc.load_robot("ax18")]
    )
    body = body_points(wide, start)
    assert set(body.radius[~body.carried]) == {chassis.radius, 0.0}  # of the wheels, too
    assert across(wide, start) >= chassis.radius
    assert DriveTo.pose(wide, start, goal, floor=floor).duration > 0


@pytest.mark.parametrize(
    ("base", "half"),
    [
        (
            dqc.MecanumBase(wheel_radius=0.05, half_track=0.15, half_wheelbase=0.24, rim_speed=0.8),
            (0.29, 0.17),
        ),
        (dqc.OmniBase(wheel_radius=0.05, wheel_distance=0.2, first_angle=0.0, rim_speed=0.8), (0.22, 0.2155)),
    ],
    ids=["mecanum", "omni"],
)
def test_a_base_on_rollers_is_at_least_as_wide_as_its_wheels(base, half):
    """Without a size it is the box around them; a base that moves in any direction and has no wheels needs one."""
    robot = dqc.WholeBody([base, dqc.load_robot("ax18")])
    start = np.array([0, 0, 0.5, 0, -0.9, 0.9, 0.9, 0])
    body = body_points(robot, start)
    c, s = np.cos(0.5), np.sin(0.5)
    own = body.points[~body.carried, :2] @ np.array([[c, -s], [s, c]])
    radius = body.radius[~body.carried]
    ends = (np.abs(own) + radius[:, None]).max(axis=0)
    assert (np.array(half) - 1e-3 <= ends).all()
    assert (ends <= np.array(half) + 0.025).all()
    floor = dqc.geometry.FloorMap([[[1, 0.5], [1.4, 0.5], [1.4, 0.9], [1, 0.9]]])
    goal = robot.fkm([0.5, 0, 0, 0, -0.9, 0.9, 0.9, 0])
    assert DriveTo.pose(robot, start, goal, floor=floor).duration > 0
    bare = dqc.WholeBody([dqc.HolonomicBase(speed=0.5, turn_rate=1.0), dqc.load_robot("ax18")])
    with pytest.raises(ShapeError, match="a holonomic base a size"):
        DriveTo.pose(bare, start, goal, floor=floor)


def test_a_way_lasts_twelve_days_at_most():
    robot, goal = dqc.load_robot("little-john"), [1.0, 0, 0, 0, 0.5, 1, 0, 0]
    lasts = dqc.references.DriveTo(robot, np.zeros(8), goal, speed_fraction=1e-3).duration
    least = 1e-3 * lasts / 1e6  # durations grow as the inverse of the fraction
    assert dqc.references.DriveTo(robot, np.zeros(8), goal, speed_fraction=1.01 * least).duration < 1e6
    with pytest.raises(
        dqc.Error, match=r"^goal: takes 1\.01e\+06 s, more than 1e\+06; give more speed_fraction"
    ):
        dqc.references.DriveTo(robot, np.zeros(8), goal, speed_fraction=0.99 * least)


@pytest.mark.parametrize("x", [1e308, -1e308])
def test_a_goal_that_takes_no_finite_time_is_refused(x):
    with pytest.raises(
        dqc.Error, match=r"^goal: takes no finite time from start, with coordinates up to 1e\+"
    ):
        dqc.references.DriveTo(dqc.load_robot("little-john"), np.zeros(8), [x, 0, 0, 0, 0.5, 1, 0, 0])

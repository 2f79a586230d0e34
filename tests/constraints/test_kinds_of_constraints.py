"""Zones, angles, sights, bases, arms upon them: against plain formulas and between samples."""

import numpy as np
import pytest
from constraint_scenes import (
    HOME,
    SUBSAMPLES,
    least_room,
    least_room_of_servos,
    plain_rooms,
    random_constraints,
    random_goal,
    random_kinds,
)
from obstacles import around, box, column, plane, sphere

import dqcontrol as dqc
from dqcontrol.loop.simulate import simulate_prepared
from dqcontrol.measures.held import deadlocks
from dqcontrol.robots.robot import AT_ONCE

ARM = dqc.load_robot("panda")
PLANT = dqc.plants.Integrator()
FOUND = 1e-9


def run_of_kinds(rng, period, duration):
    """Return a record with the prepared law and its constraints of a Panda among random zones, angles and sights."""
    acceleration = float(rng.uniform(5, 20)) if rng.random() < 0.5 else None
    given = random_kinds(rng, ARM, HOME, acceleration=acceleration)
    law = dqc.laws.Proportional(gain=4.0, constraints=given)
    goal = random_goal(rng, ARM)
    record = dqc.simulate(ARM, goal, law, PLANT, HOME, period=period, duration=duration)
    return record, law.prepare(ARM, goal, period), given


def check_kinds(rng, duration):
    """Check that nothing is crossed; return by how much of itself a limit of acceleration was exceeded."""
    period = float(rng.uniform(0.001, 0.01))
    record, prepared, given = run_of_kinds(rng, period, duration)
    assert least_room(prepared, record, period) > -FOUND
    for k in range(0, len(record.time) - 1, 10):
        share = rng.integers(1, SUBSAMPLES + 1) / SUBSAMPLES * period
        q = record.q[k] + share * record.command[k]
        rooms = plain_rooms(given, ARM, q, record.time[k] + share)
        assert min(rooms.values(), default=0.0) > -FOUND, rooms
    return record.readings["constraint_effect"].values[:, 3].max()


def test_zones_angles_and_sights_are_kept_between_samples():
    rng = np.random.default_rng(21)
    for _ in range(6):
        assert check_kinds(rng, 0.5) < 1e-6


@pytest.mark.slow
def test_zones_angles_and_sights_are_kept_in_two_hundred_runs():
    rng = np.random.default_rng(22)
    excess = np.array([check_kinds(rng, 1.0) for _ in range(200)])
    print(
        f"limits of acceleration exceeded in {(excess > 1e-6).sum()} of 200 runs, by {excess.max():.2g} at most"
    )
    assert excess.max() < 1e-6


def gantry():
    """Return three slides at right angles, whose hand moves straight."""
    h = np.sqrt(0.5)
    turns = [(h, 0, h, 0), (0.5, -0.5, -0.5, -0.5), (0.5, -0.5, -0.5, -0.5), (1, 0, 0, 0)]
    limits = dqc.robots.Limits(np.full(3, -2.0), np.full(3, 2.0), np.full(3, 1.0), np.full(3, np.inf))
    poses = np.array([[*turn, 0, 0, 0] for turn in turns])
    return dqc.SerialArm(poses, ["prismatic"] * 3, limits=limits, name="gantry")


@pytest.mark.parametrize("beside", [0.0, 0.0005, 0.002, 0.003, 0.007])
def test_a_hand_crosses_the_middle_of_a_ball_and_brakes_before_its_other_side(beside):
    robot, q = gantry(), np.array([-0.09, beside, 0.0])
    middle = dqc.DualQuaternion(robot.fkm(np.zeros(3))).translation
    zone = dqc.constraints.Zone(sphere=0.1, position=tuple(middle))
    given = dqc.constraints.Constraints(zones={"ball": zone}, acceleration=0.5)
    law = dqc.laws.Proportional(gain=20.0, constraints=given)
    goal = dqc.references.SetPoint(robot.fkm(np.array([0.3, 0.0, 0.0])))
    record = dqc.simulate(robot, goal, law, PLANT, q, period=0.01, duration=6.0)
    assert least_room(law.prepare(robot, goal, 0.01), record, 0.01) > -FOUND
    assert record.readings["constraint_effect"].values[:, 3].max() < 1e-6
    assert record.q[-1, 0] > 0.06  # it came to the other side


def among_walls(rng):
    """Return constraints of a base's chassis and of the hand among a wall, a column and a post, on a floor."""
    both = {"links": ["chassis", "hand"]}
    return {
        "floor": plane(normal=(0, 0, 1), offset=0.0),
        "wall": plane(normal=(-1, 0, 0), offset=-rng.uniform(0.4, 0.8), **both),
        "column": column(point=(rng.uniform(-0.6, 0.2), rng.uniform(0.3, 0.6), 0), radius=0.1, **both),
        "post": box(
            position=(rng.uniform(-0.6, 0.2), -rng.uniform(0.4, 0.6), 0.2), size=(0.1, 0.1, 1), **both
        ),
    }


def check_base(rng, robot, duration):
    """Drive to a random goal; return whether the start was free."""
    n, half_track = robot.configuration_size, robot.drives[0, 3]
    q = np.concatenate([[0, 0, rng.uniform(-3, 3)], rng.uniform(-0.3, 0.3, n - 3)])
    if n == 10:
        q[3:] = HOME
    acceleration = 5.0 if rng.random() < 0.5 else None
    given = dqc.constraints.Constraints(**around(among_walls(rng)), acceleration=acceleration)
    inverse = dqc.laws.DampedInverse(damping=0.05)
    law = dqc.laws.Proportional(gain=2.0, constraints=given, inverse=inverse)
    goal = dqc.references.SetPoint(robot.fkm(q + rng.uniform(-1, 1, n)))
    period = float(rng.uniform(0.002, 0.02))
    prepared = law.prepare(robot, goal, period)
    assert prepared.constraints is not None
    if prepared.constraints.violations(q):
        return False
    record = dqc.simulate(robot, goal, law, PLANT, q, period=period, duration=duration)
    assert least_room(prepared, record, period) > -FOUND
    rims = np.abs(record.command[:, 0]) + half_track * np.abs(record.command[:, 1])
    assert rims.max() <= robot.limits.velocity[0] * (1 + 1e-9)
    return True


def bodies():
    """Return a small base with an arm that has no shapes, and a larger one with a Panda."""
    chassis = dqc.robots.Chassis(
        mass=60,
        radius=0.28,
        height=0.25,
        centre_height=0.15,
        wheel_mass=1,
        wheel_torque=9,
        caster_distance=0.2,
    )
    base = dqc.DifferentialDrive(0.1, 0.25, displacement=0.1, rim_speed=0.6, chassis=chassis)
    mount = dqc.DualQuaternion.from_translation([0.05, 0, 0.42])
    return dqc.load_robot("little-john"), dqc.WholeBody([base, mount, ARM])


@pytest.mark.parametrize("number", [0, 1])
def test_bases_among_walls_and_columns_touch_nothing_and_keep_their_rims(number):
    rng, robot = np.random.default_rng(23), bodies()[number]
    assert sum(check_base(rng, robot, 1.0) for _ in range(4)) >= 2


@pytest.mark.slow
@pytest.mark.parametrize("number", [0, 1])
def test_bases_touch_nothing_in_many_runs(number):
    rng, robot = np.random.default_rng(24), bodies()[number]
    assert sum(check_base(rng, robot, 3.0) for _ in range(100)) >= 50


def test_an_arm_keeps_away_from_the_base_that_carries_it():
    robot = bodies()[1]
    q = np.array([0.0, 0, 0, *HOME])
    down = dqc.DualQuaternion.from_translation([-0.3, 0.0, -0.9]) * dqc.DualQuaternion(robot.fkm(q))
    law = dqc.laws.Proportional(gain=3.0, constraints=dqc.constraints.Constraints(margin=0.02))
    goal = dqc.references.SetPoint(down)
    record = dqc.simulate(robot, goal, law, PLANT, q, period=0.01, duration=2.0)
    prepared = law.prepare(robot, goal, 0.01)
    assert prepared.constraints is not None
    values = prepared.constraints.values(record.q, record.time)
    of_base = [i for i, name in enumerate(prepared.constraints.labels) if name.startswith("chassis")]
    assert values[:, of_base].min() < 0.05  # it was asked to reach into its base
    assert least_room(prepared, record, 0.01) > -FOUND
    free = dqc.simulate(robot, goal, dqc.laws.Proportional(gain=3.0), PLANT, q, period=0.01, duration=2.0)
    assert prepared.constraints.values(free.q, free.time)[:, of_base].min() < 0.0  # the law alone does


def ball_before(robot, q, ahead, radius):
    """Return a ball straight before the hand, on its way by ``ahead``, m."""
    hand = dqc.DualQuaternion(robot.fkm(q)).translation
    return sphere(center=tuple(hand + ahead), radius=radius, links=["hand"])


@pytest.mark.parametrize("escape", [None, 0.2])
def test_a_hand_goes_round_a_ball_by_itself(escape):
    """It is straight in the way: damping that grows with the error turns the hand aside before it is held."""
    way = np.array([0.0, 0.15, 0.0])
    given = dqc.constraints.Constraints(
        **around({"it": ball_before(ARM, HOME, way, 0.06)}), escape=escape, acceleration=10.0
    )
    record, room = across(way, given)
    assert room > -FOUND
    assert record.position_error[-1] < 1e-3
    assert not deadlocks(record)


def test_a_hand_that_is_held_goes_aside_if_asked_and_comes_to_its_goal():
    way = np.array([0.0, 0.15, 0.0])
    before = ball_before(ARM, HOME, way, 0.06)[0].position
    board = box(position=before, size=(0.15, 0.04, 0.15), links=["hand"])
    errors = {}
    for escape in (None, 0.2):
        given = dqc.constraints.Constraints(**around({"it": board}), escape=escape, acceleration=10.0)
        record, room = across(way, given)
        assert room > -FOUND
        errors[escape], held = record.position_error[-1], deadlocks(record)
        assert held[0].names == ("it",)
    assert errors[0.2] < 1e-3
    assert held[-1].end < 2.0  # s
    assert errors[None] > 0.1


def across(way, given):
    """Return how the hand goes twice as far as the way, and the least room that it had, m."""
    start = dqc.DualQuaternion(ARM.fkm(HOME))
    goal = dqc.references.SetPoint(dqc.DualQuaternion.from_translation(2 * way) * start)
    law = dqc.laws.Proportional(gain=2.0, constraints=given)
    record = dqc.simulate(ARM, goal, law, PLANT, HOME, period=0.01, duration=6.0)
    return record, least_room(law.prepare(ARM, goal, 0.01), record, 0.01)


def test_joints_held_at_the_end_of_their_range_go_to_another_posture_if_asked():
    turned = np.array([*HOME[:6], 2.0])  # the short way to −2 rad goes over π, and the last joint ends at 2.9
    goal = dqc.references.SetPoint(ARM.fkm(turned * [1, 1, 1, 1, 1, 1, -1]))
    errors = {}
    for escape in (None, 1.0):
        given = dqc.constraints.Constraints(escape=escape, acceleration=10.0)
        law = dqc.laws.Proportional(gain=2.0, constraints=given)
        record = dqc.simulate(ARM, goal, law, PLANT, turned, period=0.01, duration=10.0)
        assert least_room(law.prepare(ARM, goal, 0.01), record, 0.01) > -FOUND
        errors[escape], held = record.position_error[-1], deadlocks(record)
        assert held[0].names == ("joint limits",)
    assert errors[None] > 0.03
    assert errors[1.0] < 1e-3


def lagging_run(rng, servo, period, lag):
    """Return the least room, between samples too, of joints that follow a motion past a ball late."""
    ball = ball_before(ARM, HOME, np.array([0.01, 0.15, 0.005]), rng.uniform(0.02, 0.06))
    given = dqc.constraints.Constraints(**around({"ball": ball}), margin=0.005)
    law = dqc.laws.ProportionalFeedforward(gain=4.0, constraints=given)
    start = dqc.DualQuaternion(ARM.fkm(HOME))
    end = dqc.DualQuaternion.from_translation([0.0, 0.3, 0.0]) * start
    goal = dqc.references.Points([0.0, float(rng.uniform(0.8, 1.5))], [start.vec8, end.vec8])
    samples = goal.samples(period * np.arange(round(2.5 / period)))
    prepared = law.prepare(ARM, goal, period, None, "integrated", lag=lag)
    record = simulate_prepared(prepared, servo, HOME, samples)
    effect = record.readings["constraint_effect"].values
    assert effect[:, 2].min() == 1.0  # nothing was scaled
    return least_room_of_servos(prepared, record, period, servo)


def test_joints_that_follow_late_keep_what_is_asked_between_samples_too():
    rng = np.random.default_rng(31)
    rooms = {}
    for kind in ("with", "without"):
        rooms[kind] = []
        for _ in range(4):
            period = float(rng.choice([0.004, 0.01]))
            servo = dqc.plants.Servo(time_constant=float(rng.uniform(0.03, 0.08)), delay=2 * period)
            lag = servo.lag(ARM) if kind == "with" else AT_ONCE
            rooms[kind].append(lagging_run(rng, servo, period, lag))
    assert min(rooms["with"]) > -FOUND
    assert min(rooms["without"]) < -1e-4  # they would cut the corner


@pytest.mark.slow
def test_joints_that_follow_late_keep_what_is_asked_in_a_thousand_runs():
    rng, worst = np.random.default_rng(32), []
    for _ in range(500):
        period = float(rng.choice([0.002, 0.005, 0.01]))
        delay = float(rng.integers(0, 4)) * period
        servo = dqc.plants.Servo(time_constant=float(rng.uniform(0.01, 0.08)), delay=delay)
        given = random_constraints(rng, ARM, HOME, acceleration=float(rng.uniform(5, 20)))
        law = dqc.laws.Proportional(gain=3.0, constraints=given)
        goal = random_goal(rng, ARM)
        record = dqc.simulate(ARM, goal, law, servo, HOME, period=period, duration=1.5)
        prepared = law.prepare(ARM, goal, period, None, "integrated", lag=servo.lag(ARM))
        worst.append(least_room_of_servos(prepared, record, period, servo))
        worst.append(lagging_run(rng, servo, period, servo.lag(ARM)))
    short = -np.array(worst)
    print(f"below what is asked: {(short > FOUND).sum()} of {len(short)} runs, by {1e3 * short.max():.3g} mm")
    assert short.max() < FOUND

"""A base that cannot move sideways drives, then its arm goes on where a straight way of its joints would touch."""

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.errors import NoteWarning, PlanError, UnreachableGoalError, ValueRangeError
from dqcontrol.geometry import distance
from dqcontrol.planning import CertifiedEdges, PlanTo, drive_and_plan, plan

ROBOT = dqc.load_robot("little-john")
START = np.array([0, 0, 0, 0, -0.9, 0.9, 0.9, 0])
assert ROBOT.shapes is not None
SHAPES = ROBOT.shapes.shapes
SHELF = {
    "lower": {"box": [0.25, 0.8, 0.02], "position": [2.0, 0.6, 0.12]},
    "upper": {"box": [0.25, 0.8, 0.02], "position": [2.0, 0.6, 0.45]},
    "back": {"box": [0.02, 0.8, 0.5], "position": [2.14, 0.6, 0.25]},
}
BODIES = {name: dqc.world.Body(**body) for name, body in SHELF.items()}
KEEP = dqc.constraints.Constraints(
    world=dqc.World(bodies=BODIES), clear_of="all", margin=0.01, acceleration=5
)
BETWEEN = dqc.DualQuaternion(ROBOT.fkm([1.52, 0.6, 0, 0, -0.49, 1.04, 0, 0]))  # the boards


def least_distance(configurations):
    """Return how near shapes of the robot come to the shelf, m, by the library of distances alone."""
    least = np.inf
    for q in configurations:
        frames = ROBOT.frames(q)
        for link in SHAPES:
            moved = link.shape.moved(frames[link.frame - 1])
            for body in BODIES.values():
                least = min(least, distance(moved, body.shapes[0]).distance)
    return least


def test_it_drives_to_a_shelf_and_reaches_between_its_boards():
    floor = dqc.world.floor_around(KEEP.world, "all", "clear_of")
    with pytest.raises(UnreachableGoalError, match="is inside what stands there"):
        dqc.references.DriveTo.pose(ROBOT, START, BETWEEN, floor=floor)
    way = drive_and_plan(ROBOT, KEEP, START, BETWEEN)
    q = way.configurations(np.linspace(0, way.duration, 400))
    assert least_distance(q) >= 0.01
    assert (BETWEEN.vec8 @ ROBOT.fkm(q[-1])) ** 2 > 1 - 1e-9
    assert way.arm.plan.certificate.room >= 0
    law = dqc.laws.GuidedProportional(gain=1.0, constraints=KEEP)
    record = dqc.simulate(ROBOT, way, law, dqc.plants.Integrator(), START, 0.01)
    assert record.error.max() < 1e-4
    assert least_distance(record.q[::10]) >= 0.01


def test_base_and_arm_move_together_and_nothing_rests_without_need():
    """In turn they take 15.1 s: 1.8 s of folding while the base drives for 9.6 s, then 5.5 s of the arm."""
    way = drive_and_plan(ROBOT, KEEP, START, BETWEEN)
    base = way.configurations([way.begins, way.driven, way.duration])[:, :3]
    assert way.begins < way.driven - 1.0
    assert np.abs(base[1] - base[0]).max() > 0.3
    assert np.abs(base[2] - base[1]).max() < 1e-9
    times = np.linspace(0, way.duration, 1001)[1:-1]
    q = way.configurations(np.r_[times, times + 1e-6])
    assert (np.abs(q[len(times) :] - q[: len(times)]) > 1e-9).any(axis=1).all()  # 1 mm/s or mrad/s
    assert way.duration < 9.5


def test_inputs_are_those_that_lead_along_the_way_within_limits():
    way = drive_and_plan(ROBOT, KEEP, START, BETWEEN)
    period, q = 0.01, START.astype(float)
    times = np.arange(0.0, way.duration + period, period)
    inputs = way.mean_inputs(times, period)
    for u, there in zip(inputs, way.configurations(times + period), strict=True):
        q = ROBOT.integrate(q, u, period)
        assert np.abs(q - there).max() < 1e-5
    assert (np.abs(inputs) <= 0.9 * ROBOT.limits.velocity + 1e-9).all()
    rims = np.abs(inputs[:, 0]) + ROBOT.drives[0, 5] * np.abs(inputs[:, 1])
    assert rims.max() <= 0.9 * ROBOT.limits.velocity[0] * 1.01
    step = 1e-4
    middle = np.linspace(0.05, way.duration - 0.05, 200)
    samples = way.samples(middle)
    poses = ROBOT.fkm(way.configurations(np.r_[middle - step, middle + step]))
    rates = (poses[200:] - poses[:200]) / (2 * step)
    for sample, rate in zip(samples, rates, strict=True):
        pose, twist = sample[:8], sample[8:14]
        moved = 0.5 * dqc.algebra.multiply(np.r_[0.0, twist[:3], 0.0, twist[3:]], pose)
        assert np.abs(moved - rate).max() < 2e-3


def test_all_of_the_way_is_proved_and_a_board_in_the_way_of_both_is_found():
    """Samples lie between marks; what is between them is proved by how far inputs go there."""
    way = drive_and_plan(ROBOT, KEEP, START, BETWEEN)
    edges = CertifiedEdges(ROBOT, KEEP).eased_at(START)
    proved = edges.least_room_on(way.gone, np.array([0.0, way.duration])).least
    times = np.linspace(0, way.duration, 4000)
    sampled = edges.room_at(way.configurations(times))[0].min()
    assert 0 <= proved <= sampled <= proved + 2e-4
    x, y, _ = way.configurations([0.5 * way.driven])[0, :3].tolist()
    pole = dqc.world.Body(capsule=(0.01, 0.5), position=(x, y, 0.2))
    blocked = dqc.constraints.Constraints(
        world=dqc.World(bodies=BODIES | {"pole": pole}), clear_of="all", margin=0.01, acceleration=5
    )
    found = CertifiedEdges(ROBOT, blocked).least_room_on(way.gone, np.array([0.0, way.duration]))
    assert found.least < 0
    assert found.label.startswith("pole")


def test_a_base_that_steers_is_timed_with_its_arm_too():
    car = dqc.robots.CarLikeBase(0.065, 0.13, wheelbase=0.3, steering_limit=0.6, rim_speed=1.0)
    robot = dqc.WholeBody([car, *ROBOT.parts[1:]])
    robot.shapes = ROBOT.shapes
    start = START.copy()
    goal = dqc.DualQuaternion(robot.fkm([2.0, 1.0, 0.5, 0.4, -0.7, 0.9, 0.5, 0]))
    keep = dqc.constraints.Constraints(acceleration=5)
    way = drive_and_plan(robot, keep, start, goal)
    assert way.begins < way.driven
    assert (goal.vec8 @ robot.fkm(way.configurations([way.duration])[0])) ** 2 > 1 - 1e-9
    law = dqc.laws.GuidedProportional(gain=1.0, constraints=keep)
    record = dqc.simulate(robot, way, law, dqc.plants.Integrator(), start, 0.01)
    assert record.error.max() < 1e-4


def test_where_the_arm_reaches_the_goal_the_base_stays():
    here = np.array([1.52, 0.6, 0, 0, -1.4, 0.9, 0.9, 0])
    way = drive_and_plan(ROBOT, KEEP, here, [1.52, 0.6, 0, 0, -0.49, 1.04, 0, 0])
    assert isinstance(way, PlanTo)
    assert (way.plan.configurations[:, :3] == here[:3]).all()
    assert least_distance(way.configurations(np.linspace(0, way.duration, 200))) >= 0.01


def test_edges_and_plans_say_that_a_base_would_have_to_drive():
    there = START + np.array([1.0, 0, 0, 0, 0, 0, 0, 0])
    with pytest.raises(ValueRangeError, match="the base of little-john drives on one"):
        CertifiedEdges(ROBOT, KEEP).clear(START, there)
    with pytest.raises(PlanError, match="goal: little-john has to drive there; drive_and_plan does that"):
        plan(ROBOT, KEEP, START, there)


def spec(robot, start, goal, **more):
    return {
        "name": "way",
        "robot": robot,
        "start": list(start),
        "period": 0.02,
        "world": SHELF,
        "constraints": {"clear_of": "all", "margin": 0.01, "acceleration": 5},
        "reference": {"kind": "plan-to", "goal": goal, **more},
        "law": {"kind": "guided-proportional", "gain": 1},
        "plant": {"kind": "integrator"},
    }


def pose_of(goal):
    return {"position": goal.translation.tolist(), "quaternion": goal.vec8[:4].tolist()}


@pytest.mark.slow
def test_a_spec_drives_and_plans_and_refuses_to_plan_again():
    asked = spec("little-john", START, pose_of(BETWEEN))
    with pytest.warns(
        NoteWarning,
        match=r"s of driving, the arm sets off after \d\S* s, \d\S* s in all; certified",
    ):
        done = dqc.run(asked)
    assert done.metrics.position.peak < 0.1  # mm
    with pytest.raises(ValueRangeError, match="again: the base of little-john cannot go all ways"):
        dqc.experiments.prepare(spec("little-john", START, pose_of(BETWEEN), again={"when": "held"}))


def test_a_pose_is_no_configuration_of_eight_joints():
    """As many numbers as a pose has."""
    youbot = dqc.load_robot("youbot")
    start = np.array([0, 0, 0, 0.0, 0.3, -1.0, 0.5, 0.0])
    goal = dqc.DualQuaternion(youbot.fkm(start + np.array([0.5, -0.4, 0.3, 0.2, 0, 0.2, 0, 0])))
    with pytest.warns(NoteWarning, match="plan: certified"):
        way = dqc.experiments.prepare(spec("youbot", start, pose_of(goal))).scene.reference
    assert (goal.vec8 @ youbot.fkm(way.configurations([way.duration])[0])) ** 2 > 1 - 1e-9
    assert "array (8,)" in repr(dqc.references.DriveTo(ROBOT, START, START + 0.5))

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
    resting = way.configurations(np.linspace(way.time, way.duration, 100))
    assert np.ptp(resting[:, :3], axis=0).max() < 1e-9
    assert np.ptp(resting[:, 3:], axis=0).max() > 0.5
    assert np.abs(np.diff(way.configurations([way.time - 1e-9, way.time]), axis=0)).max() < 1e-6
    assert (BETWEEN.vec8 @ ROBOT.fkm(q[-1])) ** 2 > 1 - 1e-9
    assert way.after.plan.certificate.room >= 0
    law = dqc.laws.GuidedProportional(gain=1.0, constraints=KEEP)
    record = dqc.simulate(ROBOT, way, law, dqc.plants.Integrator(), START, 0.01)
    assert record.error.max() < 1e-4
    assert least_distance(record.q[::10]) >= 0.01


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


def test_a_spec_drives_and_plans_and_refuses_to_plan_again():
    asked = spec("little-john", START, pose_of(BETWEEN))
    with pytest.warns(NoteWarning, match=r"plan: \d\S* s of driving, then \d\S* s; certified: least room"):
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

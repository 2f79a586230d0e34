"""Ways that are timed: within limits, followed exactly by laws that keep the same constraints, and in specs."""

import dataclasses
import sys

import numpy as np
import pytest
from test_plan import GOAL, START, inside_shelf, load, scene, shelf

import dqcontrol as dqc
from dqcontrol.constraints.prepared_constraints import PreparedConstraints
from dqcontrol.errors import Error, MissingExtraError, NoteWarning, PlanError, ValueRangeError
from dqcontrol.planning import PlanTo, plan

PERIOD = 0.01
SPEC = {
    "name": "shelf",
    "robot": "panda",
    "start": inside_shelf()[0].tolist(),
    "period": PERIOD,
    "world": {
        "lower": {"box": [0.3, 1.0, 0.02], "position": [0.65, 0, 0.15]},
        "upper": {"box": [0.3, 1.0, 0.02], "position": [0.65, 0, 0.6]},
    },
    "constraints": {"clear_of": "all", "acceleration": 10},
    "reference": {"kind": "plan-to", "goal": {"position": [0.5, 0.2, 0.78]}},
    "law": {"kind": "guided-proportional", "gain": 2, "pull": 5},
    "plant": {"kind": "integrator"},
}
pytestmark = pytest.mark.filterwarnings("ignore::dqcontrol.errors.NoteWarning")


def way_out(**options):
    robot, given = load("panda"), shelf(acceleration=10.0)
    start, pose = inside_shelf()
    kept = PreparedConstraints(given, robot, PERIOD, "measured")
    return given, PlanTo(plan(robot, kept, start, pose), **options)


def test_speeds_and_accelerations_stay_within_their_share_of_the_limits():
    _, way = way_out(speed_fraction=0.7)
    times = np.arange(0.0, way.duration, 1e-3)
    q = way.configurations(times)
    speeds = np.diff(q, axis=0) / 1e-3
    assert (np.abs(speeds) <= 0.7 * load("panda").limits.velocity + 1e-6).all()
    assert np.abs(speeds / (0.7 * load("panda").limits.velocity)).max() > 0.9
    # between two points of its grid TOPP-RA holds accelerations at both, of which a blend's change by its turning
    assert np.abs(np.diff(speeds, axis=0) / 1e-3).max() <= 1.05 * 0.7 * 10.0
    rests = way.configurations([0.0, way.duration, way.duration + 1.0])
    assert np.abs(rests - way.plan.configurations[[0, -1, -1]]).max() < 1e-9


def test_no_distance_shrinks_faster_than_laws_let_pass():
    _, way = way_out()
    kept, times = way.plan.kept, np.arange(0.0, way.duration, 1e-3)
    room = kept.values(way.configurations(times), times * 0.0) - kept.asked - kept.allowances
    assert (np.diff(room, axis=0) / 1e-3 >= -0.95 * kept.rate * room[:-1] - 1e-6).all()


def test_samples_are_the_motion_of_the_hand():
    _, way = way_out()
    step, times = 1e-5, np.linspace(0.05, way.duration - 0.05, 37)
    samples = way.motion(times)
    ends = [dqc.algebra.translation(way.motion(times + sign * step)[:, :8]) for sign in (-1, 1)]
    velocity = (ends[1] - ends[0]) / (2 * step)
    twist, place = samples[:, 8:14], dqc.algebra.translation(samples[:, :8])
    assert np.abs(twist[:, 3:] + np.cross(twist[:, :3], place) - velocity).max() < 1e-3
    twists = [way.motion(times + sign * step)[:, 8:14] for sign in (-1, 1)]
    smooth = np.abs((twists[1] - twists[0]) / (2 * step) - samples[:, 14:20]).max(axis=1)
    assert np.median(smooth) < 1e-3  # where accelerations jump a difference says nothing


def test_the_law_follows_without_leaving_the_way():
    given, way = way_out()
    start = way.plan.configurations[0]
    law = dqc.laws.GuidedProportional(gain=2.0, pull=5.0, constraints=given)
    record = dqc.simulate(way.robot, way, law, dqc.plants.Integrator(), start, PERIOD, way.duration + 1.0)
    assert np.abs(record.q - way.configurations(record.time)).max() < 1e-9
    values = way.plan.kept.values(record.q, record.time)
    assert (values - way.plan.kept.asked).min() >= 0.0
    assert record.error[-1] < 1e-6


@pytest.mark.parametrize("name", ["panda", "ur5", "two-pandas", "youbot"])
def test_ways_of_arms_pairs_and_holonomic_bases_are_followed(name):
    robot, rng = load(name), np.random.default_rng([2, len(name)])
    given, start, goal = scene(rng, robot)
    kept = PreparedConstraints(given, robot, PERIOD, "measured")
    way = PlanTo(plan(robot, kept, start, goal))
    law = dqc.laws.GuidedProportional(gain=2.0, pull=5.0, constraints=given)
    record = dqc.simulate(robot, way, law, dqc.plants.Integrator(), start, PERIOD, way.duration + 0.1)
    assert np.abs(record.q - way.configurations(record.time)).max() < 1e-6
    assert np.abs(record.q[-1] - goal).max() < 1e-6
    assert (kept.values(record.q, record.time) - kept.asked).min() >= 0.0


def test_a_way_rests_where_a_corner_cannot_be_blended():
    from dqcontrol.planning.smooth_way import SmoothWay

    _, way = way_out()
    a, b, c = START, START + 0.2, GOAL
    corner = SmoothWay(
        np.array([[a, 0.5 * (a + b), b], [b, 0.5 * (b + c), c]]),
        np.array([np.linalg.norm(b - a), np.linalg.norm(c - b)]),
        (1,),
    )
    found = dataclasses.replace(way.plan, configurations=np.array([a, b, c]), way=corner)
    timed = PlanTo(found)
    k = int(np.abs(timed.timing.lengths - corner.lengths[0]).argmin())
    assert timed.timing.speeds[k] == 0.0
    assert np.abs(timed.configurations([timed.timing.times[k]])[0] - b).max() < 1e-9


def test_a_spec_plans_follows_and_reaches():
    with pytest.warns(
        NoteWarning, match=r"plan: certified: least room .* beyond what is asked .* edges, seed 0"
    ):
        done = dqc.run(SPEC)
    assert done.verdict.words.startswith("reached; kept clear")
    assert np.abs(done.record.q[0] - SPEC["start"]).max() == 0.0


def test_without_constraints_the_bodies_of_the_world_are_planned_around():
    spec = {key: value for key, value in SPEC.items() if key != "constraints"}
    way = dqc.experiments.prepare(spec).scene.reference
    assert len(way.plan.configurations) > 2
    assert way.plan.certificate.label.startswith(("upper", "lower"))


def test_goals_are_poses_configurations_or_bodies():
    goal = GOAL.tolist()
    spec = SPEC | {"start": START.tolist(), "reference": {"kind": "plan-to", "goal": {"configuration": goal}}}
    found = dqc.experiments.prepare(spec).scene.reference
    assert np.array_equal(found.plan.configurations[-1], goal)
    cup = {"cylinder": [0.03, 0.1], "position": [0.4, -0.4, 0.3]}
    place = {"body": "cup", "position": [0, 0, 0.2], "rpy": [np.pi, 0, 0]}
    spec = SPEC | {
        "world": {"cup": cup},
        "start": START.tolist(),
        "reference": {"kind": "plan-to", "goal": place},
    }
    hand = dqc.DualQuaternion(dqc.experiments.prepare(spec).scene.reference.at(100.0).pose)
    assert np.abs(hand.translation - [0.4, -0.4, 0.5]).max() < 1e-5
    assert np.abs(hand.matrix()[:3, 2] - [0, 0, -1]).max() < 1e-5


@pytest.mark.parametrize(
    ("goal", "message"),
    [
        ({}, "goal: give position, quaternion or rpy, body, or configuration"),
        ({"configuration": [0.0] * 7, "position": [0, 0, 1]}, "either 'configuration' or 'position'"),
        ({"body": "cpu"}, "goal.body: unknown name 'cpu'"),
        ({"position": [3.0, 0, 0]}, "unreachable: the position is .* beyond the reach"),
        ({"position": [0.65, 0.0, 0.6], "rpy": [0, 1.5, 0]}, "goal: the best of .* is not clear: upper: "),
        ({"position": [0.5, 0, 0.8], "quaternion": [1, 0, 0, 0], "rpy": [0, 0, 0]}, "leave out one of them"),
        ({"configuration": [0.0] * 6}, "goal: expected shape"),
    ],
)
def test_wrong_goals_get_one_line(goal, message):
    with pytest.raises(Error, match=message) as told:
        dqc.experiments.prepare(SPEC | {"reference": {"kind": "plan-to", "goal": goal}})
    assert "\n" not in str(told.value)


def test_laws_that_keep_different_things_are_not_planned_for_together():
    laws = {"a": SPEC["law"], "b": SPEC["law"] | {"constraints": {"margin": 0.02, "clear_of": "all"}}}
    spec = {key: value for key, value in SPEC.items() if key != "law"} | {"laws": laws}
    with pytest.raises(Error, match="reference: plan-to plans once for all laws, and these keep different"):
        dqc.experiments.prepare(spec)


def test_a_missing_timing_library_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "toppra", None)
    with pytest.raises(MissingExtraError, match=r"toppra: timings of plans need it .*'dqcontrol\[plan\]'"):
        PlanTo(plan(load("panda"), dqc.constraints.Constraints(), START, GOAL))


def test_shares_are_shares():
    found = plan(load("panda"), dqc.constraints.Constraints(), START, GOAL)
    with pytest.raises(ValueRangeError, match=r"speed_fraction: must be ≤ 1, got 1.5"):
        PlanTo(found, speed_fraction=1.5)
    with pytest.raises(ValueRangeError, match="approach: must be > 0"):
        PlanTo(found, approach=0.0)


def test_plan_errors_name_the_spec(tmp_path):
    (tmp_path / "spec.yaml").write_text(str(SPEC | {"start": [0.0] * 7}))
    with pytest.raises((PlanError, ValueRangeError), match=r"spec.yaml: .*start"):
        dqc.experiments.prepare(tmp_path / "spec.yaml")

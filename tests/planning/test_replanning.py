"""Ways that are planned again where constraints hold the robot, and ways out for laws that have none."""

import sys
import warnings

import numpy as np
import pytest
import yaml
from test_plan import inside_shelf, load

import dqcontrol as dqc
from dqcontrol.constraints.prepared_constraints import PreparedConstraints
from dqcontrol.errors import Error, MissingExtraError, NoteWarning, ValueRangeError
from dqcontrol.planning import Again, PlanTo, plan
from dqcontrol.planning.plan_to import ResumedWay
from dqcontrol.planning.standing_world import standing

PERIOD = 0.01


LOWER = dqc.world.Body(box=[0.3, 1.0, 0.02], position=(0.65, 0, 0.15))
UPPER = {"box": [0.3, 1.0, 0.02], "position": (0.65, 0.0, 0.6)}
START, GOAL = inside_shelf()  # from between two boards to above them


def coming(**shape):
    """Return a body that comes to its place within a second, from far ahead, and that no plan foresees."""
    moves = dqc.world.Motion(path=[(0.0, 0.8, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)], announced=False)
    return dqc.world.Body(**shape, moves=moves)


def kept_clear(escape=None, **bodies):
    world = dqc.World(bodies=bodies)
    return dqc.constraints.Constraints(world=world, clear_of="all", acceleration=10.0, escape=escape)


def scene():
    """Return a plan above one board, and constraints with another that comes into the way."""
    robot = load("panda")
    found = plan(robot, kept_clear(lower=LOWER), START, GOAL)
    return (
        robot,
        PlanTo(found, speed_fraction=0.2, again=Again()),
        kept_clear(lower=LOWER, upper=coming(**UPPER)),
    )


def followed(robot, way, given, duration=None, **options):
    law = dqc.laws.GuidedProportional(gain=2.0, pull=5.0, constraints=given)
    return dqc.simulate(robot, way, law, dqc.plants.Integrator(), START, PERIOD, duration, **options)


def hand_error(robot, record):
    last = robot.fkm(record.q[-1])
    return np.abs(np.sign(GOAL @ last) * last - GOAL).max()


def test_a_board_that_comes_into_the_way_is_planned_around():
    robot, way, crossed = scene()
    once = followed(robot, PlanTo(way.plan, speed_fraction=0.2), crossed, way.duration + 6.0)
    assert hand_error(robot, once) > 0.01  # it is held there
    with pytest.warns(
        NoteWarning,
        match=r"t = .* s: held by upper, planned again: certified: .* \d+ edges, seed 0; .* ms; .* s more",
    ):
        record = followed(robot, way, crossed)
    assert hand_error(robot, record) < 2e-3
    kept = PreparedConstraints(crossed, robot, PERIOD, "measured")
    assert (kept.values(record.q, record.time) - kept.asked).min() >= 0.0
    numbers = record.readings["plan"].values[:, 0]
    assert numbers[0] == 1
    assert numbers[-1] >= 2
    assert set(np.diff(numbers)) <= {0.0, 1.0}
    assert record.stopped == "duration"


def test_planning_again_is_the_same_to_the_bit():
    robot, way, crossed = scene()
    with pytest.warns(NoteWarning, match="planned again"):
        first, second = (followed(robot, way, crossed) for _ in range(2))
    assert np.array_equal(first.q, second.q)


def test_a_way_that_nothing_holds_is_gone_as_without_planning_again():
    robot, way, _ = scene()
    free = way.plan.kept.given
    plain = followed(robot, PlanTo(way.plan, speed_fraction=0.2), free)
    again = followed(robot, way, free)
    assert np.array_equal(plain.q, again.q)
    assert again.readings["plan"].values[:, 0].tolist() == [1.0] * len(again.q)


def test_where_there_is_no_other_way_it_is_said_once_and_the_run_ends():
    """A box comes to where the goal is."""
    robot, way, _ = scene()
    x, y, z = dqc.algebra.translation(GOAL).tolist()
    given = kept_clear(box=coming(box=0.3, position=(x, y, z)))
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        record = followed(robot, PlanTo(way.plan, speed_fraction=0.2, again=Again(most=1)), given)
    lines = [str(each.message) for each in told if issubclass(each.category, NoteWarning)]
    assert len([each for each in lines if "no other way: goal: the best of" in each]) == 1
    assert record.time[-1] == pytest.approx(2 * way.duration + 5.0, abs=0.1)
    kept = PreparedConstraints(given, robot, PERIOD, "measured")
    assert (kept.values(record.q, record.time) - kept.asked).min() >= 0.0


def test_a_resumed_way_is_one_and_then_the_other():
    robot, way, _ = scene()
    time = 0.3 * way.duration
    other = PlanTo(plan(robot, way.plan.kept, way.configurations([time])[0], START))
    joined = ResumedWay(way, time, other)
    times = np.array([0.0, 0.1, time, time + 0.2, time + other.duration + 1.0])
    q = joined.configurations(times)
    assert np.array_equal(q[:2], way.configurations(times[:2]))
    assert np.array_equal(q[2:], other.configurations(times[2:] - time))
    assert joined.duration == time + other.duration
    poses = joined.samples(times)[:, :8]
    assert np.abs(poses - robot.fkm(q)).max() < 1e-9
    inputs = joined.mean_inputs(times, PERIOD)
    assert np.array_equal(inputs[:2], way.mean_inputs(times[:2], PERIOD))
    later = ResumedWay(None, time, other).configurations(times)
    assert np.array_equal(later[:2], np.repeat(other.configurations([0.0]), 2, axis=0))


def test_what_is_not_announced_stands_where_it_is_then():
    path = [(0.0, 0.0, 0.0, 0.0), (2.0, 0.4, 0.0, 0.0)]
    for announced, begins in ((False, [0.7]), (True, [0.7, 0.9])):
        body = dqc.world.Body(
            sphere=0.1, position=(0.5, 0, 0.5), moves=dqc.world.Motion(path=path, announced=announced)
        )
        given = dqc.constraints.Constraints(world=dqc.World(bodies={"ball": body}), clear_of="all")
        (shape,) = standing(given, 1.0).obstacles["ball"].shapes
        ends = [shape.center] if not announced else [shape.start, shape.end]
        assert sorted(float(each[0]) for each in ends) == pytest.approx(begins)


def test_escape_plan_leads_a_law_out_and_on():
    """A scene of `benchmarks/reactive_scenes.py` in which the end of a joint's range holds the law."""
    robot = load("panda")
    start = np.array([-1.326, -1.332, 0.352, -0.812, -1.855, 1.512, 1.569])
    goal = robot.fkm([-0.297, 1.031, -0.696, -1.252, -0.573, 0.243, 0.516])
    places = [(0.451, 0.31, 0.323), (0.538, 0.604, 0.706), (0.055, 0.091, 0.917)]
    balls = {f"ball {k}": dqc.world.Body(sphere=0.06, position=place) for k, place in enumerate(places)}
    ends = {}
    for escape in (None, "plan"):
        keep = kept_clear(escape=escape, **balls)
        law = dqc.laws.Proportional(gain=2.0, constraints=keep)
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            record = dqc.simulate(
                robot, dqc.references.SetPoint(goal), law, dqc.plants.Integrator(), start, PERIOD, 15.0
            )
        last = robot.fkm(record.q[-1])
        ends[escape] = np.abs(np.sign(goal @ last) * last - goal).max()
        kept = PreparedConstraints(keep, robot, PERIOD, "measured")
        assert (kept.values(record.q, record.time) - kept.asked).min() >= 0.0
        assert any("planned again" in str(each.message) for each in told) == (escape == "plan")
    assert ends[None] > 0.05
    assert ends["plan"] < 1e-6


def test_what_is_wrong_is_told_in_a_line():
    robot, way, crossed = scene()
    with pytest.raises(Error, match=r"reference.again.when: unknown name .often. \(allowed: held\)"):
        dqc.experiments.prepare(
            {
                "name": "x",
                "robot": "panda",
                "start": START.tolist(),
                "period": PERIOD,
                "reference": {
                    "kind": "plan-to",
                    "goal": {"position": [0.5, 0.2, 0.78]},
                    "again": {"when": "often"},
                },
                "law": {"kind": "guided-proportional", "gain": 2, "pull": 5},
                "plant": {"kind": "integrator"},
            }
        )
    with pytest.raises(Error, match="most"):
        Again(most=0)
    law = dqc.laws.GuidedProportional(gain=2.0, pull=5.0, constraints=crossed).prepare(robot, way, PERIOD)
    samples = way.samples(PERIOD * np.arange(10))
    with pytest.raises(
        ValueRangeError,
        match=r"^reference.again: plans .*, which takes time that a run in real time has not; leave it out$",
    ):
        dqc.loop.simulate_prepared(
            law, dqc.plants.Integrator(), START, samples, reference=way, clock=dqc.loop.Clock()
        )


@pytest.mark.parametrize("asked", ["reference.again", "constraints.escape"])
def test_where_nothing_plans_while_the_robot_moves_it_is_refused_in_a_line(tmp_path, asked):
    """Exported controllers, nodes, a person's hand and runs that are only judged."""
    from dqcontrol.export.controller_parts import controller_parts
    from dqcontrol.ros2.loading import load as load_node

    again, escape = {"again": {"when": "held"}}, {"escape": "plan"}
    chosen = (again, {}) if asked == "reference.again" else ({}, escape)
    spec = {
        "name": "x",
        "robot": "panda",
        "start": START.tolist(),
        "period": PERIOD,
        "world": {"lower": {"box": [0.3, 1.0, 0.02], "position": [0.65, 0, 0.15]}},
        "constraints": {"clear_of": "all", "acceleration": 10, **chosen[1]},
        "reference": {"kind": "plan-to", "goal": {"position": [0.5, 0.2, 0.78]}, **chosen[0]},
        "law": {"kind": "guided-proportional", "gain": 2, "pull": 5},
        "plant": {"kind": "integrator"},
    }
    with pytest.raises(
        ValueRangeError, match=rf"^{asked}: plans .* no exported controller does; leave it out$"
    ):
        controller_parts(spec)
    path = tmp_path / "spec.yaml"
    path.write_text(yaml.safe_dump(spec))
    with pytest.raises(ValueRangeError, match=rf"^{asked}: plans .* no node does; leave it out$"):
        load_node(path).prepared_law("spec")
    with pytest.raises(ValueRangeError, match=rf"^spec: {asked}: plans .* only judged do not; leave it out$"):
        dqc.tune(
            {**spec, "tune": {"free": {"guided-proportional": {"gain": {"low": 1, "high": 3}}}, "budget": 20}}
        )
    if asked == "constraints.escape":
        law = dqc.laws.Proportional(gain=2.0, constraints=kept_clear(escape="plan", lower=LOWER))
        with pytest.raises(
            ValueRangeError, match=rf"^{asked}: plans .* under a person's hand; leave it out$"
        ):
            dqc.loop.Live(load("panda"), law, dqc.plants.Integrator(), PERIOD, start=START)


def test_a_report_and_pictures_say_when_and_why_it_was_planned_again():
    from dqcontrol.browser.run_view_model import Track
    from dqcontrol.figures import path_3d
    from dqcontrol.figures.plots import distances
    from dqcontrol.measures.held import apart_at_plans, plans_of_run

    robot, way, crossed = scene()
    with pytest.warns(NoteWarning, match="planned again"):
        record = followed(robot, way, crossed)
    first, again = plans_of_run(record)
    assert (first.time, first.held_by, first.cause) == (0.0, "", "")
    assert first.proof == str(way.plan.certificate).replace(f" ({way.plan.certificate.label})", "")
    assert again.cause == f"planned again at {again.time:.3g} s, held by upper"
    assert again.edges > first.edges
    ways = apart_at_plans(record, record.desired_position)
    assert len(ways) == 2
    k = len(ways[0])
    assert record.time[k] == again.time
    assert np.abs(record.position[k] - ways[1][0]).max() < 1e-6  # the new way begins where the hand is
    track = Track("run", robot, record, constraints=crossed)
    assert (track.reading(k - 1).plan, track.reading(k).plan) == (first.proof, again.proof)
    words = [text.get_text() for axes in distances(record).axes for text in axes.texts]
    assert any("planned again:\n held by upper" in each for each in words)
    labels = [text.get_text() for text in path_3d(record, crossed).legends[0].get_texts()]
    assert "planned again" in labels


def test_libraries_that_are_missing_are_named_before_anything_moves(monkeypatch):
    arm = dqc.load_robot("panda")
    law = dqc.laws.Proportional(gain=2.0, constraints=kept_clear(escape="plan", lower=LOWER))
    still = dqc.references.SetPoint(arm.fkm(START))
    for library in ("ompl.geometric", "toppra"):
        with monkeypatch.context() as patch:
            patch.setitem(sys.modules, library, None)
            with pytest.raises(MissingExtraError, match=library.partition(".")[0] + ": plans while"):
                dqc.simulate(arm, still, law, dqc.plants.Integrator(), START, 0.01, 0.05)

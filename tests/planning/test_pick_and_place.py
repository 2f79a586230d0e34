"""Sequences that are planned, step by step, with what is in the hand; and steps in which grippers close and open."""

from pathlib import Path

import numpy as np
import pytest
import yaml

import dqcontrol as dqc
from dqcontrol import algebra
from dqcontrol.errors import Error, PlanError, ShapeError
from dqcontrol.experiments import prepare
from dqcontrol.experiments.spec import read_spec
from dqcontrol.geometry import distance
from dqcontrol.measures.held import plans_of_run
from dqcontrol.planning import PlanTo
from dqcontrol.planning.drive_and_plan import StepsInTurn
from dqcontrol.references import Grip, Release, Sequence, SetPoint, Straight
from dqcontrol.world import Body

CARRY = Path(__file__).parents[2] / "examples" / "carry.yaml"
PERIOD = 0.01
pytestmark = pytest.mark.filterwarnings("ignore::dqcontrol.errors.NoteWarning")


def spec(steps=None, **changes):
    """Return the example, with other steps in place of some of its own, by number; None leaves one out."""
    given = yaml.safe_load(CARRY.read_text(encoding="utf-8")) | changes
    found = dict(enumerate(given["reference"]["references"])) | (steps or {})
    given["reference"]["references"] = [found[k] for k in sorted(found) if found[k] is not None]
    return given


@pytest.fixture(scope="module")
def run():
    return dqc.run(spec())


@pytest.fixture(scope="module")
def way():
    return prepare(spec()).scene.reference


def test_a_rod_is_picked_carried_and_placed(run):
    assert not run.verdict.failure, run.verdict.words
    record = run.record
    places = record.readings["rod_position"].values
    np.testing.assert_allclose(places[0], [0.45, -0.3, 0.26])
    np.testing.assert_allclose(places[-1], [0.45, 0.3, 0.26], atol=1e-4)
    assert np.linalg.norm(np.diff(places, axis=0), axis=1).max() < 0.02  # gripped and let go where it stands


def test_what_is_carried_keeps_clear_all_the_time(run):
    """Judged by shapes alone, at each sample."""
    record = run.record
    (wall,) = Body(box=(0.5, 0.02, 0.2), position=(0.45, 0, 0.3)).shapes
    (rod,) = Body(cylinder=(0.02, 0.12)).shapes
    places, turns = (record.readings[f"rod_{name}"].values for name in ("position", "quaternion"))
    least = min(
        distance(rod.moved(algebra.pose(turn, place)), wall).distance
        for turn, place in zip(turns, places, strict=True)
    )
    assert least >= 0.005


def test_the_law_goes_exactly_as_planned(run, way):
    assert np.abs(run.record.q - way.configurations(run.record.time)).max() < 1e-6


def test_steps_begin_where_and_when_the_one_before_ends(way):
    assert [isinstance(each, PlanTo) for each in way.ways] == [
        True,
        False,
        False,
        False,
        True,
        False,
        False,
        False,
    ]
    times = np.arange(0.0, way.duration, PERIOD)
    q = way.configurations(times)
    np.testing.assert_allclose(way.robot.fkm(q), way.samples(times)[:, :8], atol=1e-6)
    assert (
        np.abs(np.diff(q, axis=0)).max() < 0.9 * 2.7 * PERIOD + 1e-9
    )  # the fastest joint's limit: nothing jumps
    close, let_go = way.gripper_steps
    assert all(abs(step.begin / PERIOD - round(step.begin / PERIOD)) < 1e-6 for step in (close, let_go))
    np.testing.assert_allclose(algebra.translation(close.pose), [0.45, -0.3, 0.29], atol=1e-5)


def test_plans_know_what_is_in_the_hand(way):
    """Without the rod the second way would lead it through the wall; with it in the hand it is among the pairs."""
    ways = way.ways
    assert "wall: rod" not in ways[0].plan.kept.labels or ways[0].plan.kept.given.held["rod"].held.since > 0
    kept = ways[4].plan.kept
    assert kept.given.held["rod"].held.since == 0.0
    q = ways[4].plan.way.at(np.linspace(0, ways[4].plan.length, 500))[0]
    row = kept.labels.index("wall: rod")
    assert kept.values(q, np.zeros(len(q)))[:, row].min() < 0.1


def test_a_spec_that_was_run_says_when(run, way):
    """So that pages and films, which plan nothing, know what was in the hand; and it is planned again all the same."""
    said = yaml.safe_load(run.spec)["world"]["rod"]["held"]
    again = prepare(yaml.safe_load(run.spec)).scene.reference
    close, let_go = way.gripper_steps
    assert (said["since"], said["until"]) == (close.end, let_go.begin)
    times = np.linspace(0.0, way.duration, 100)
    np.testing.assert_array_equal(again.configurations(times), way.configurations(times))


def test_a_posture_is_chosen_from_which_the_steps_behind_go(monkeypatch):
    """From the nearest configuration at the goal the hand cannot go on: a singularity is in its way."""
    given = {
        "name": "on",
        "robot": "ur5",
        "start": [0.3, -1.2, 1.4, -0.6, -1.4, 0.0],
        "period": PERIOD,
        "world": {
            "table": {"box": [3.0, 3.0, 0.04], "position": [0, 0, -0.06]},
            "ball": {"sphere": 0.08, "position": [0.49, -0.21, 0.39]},
        },
        "constraints": {"clear_of": "all", "acceleration": 10},
        "reference": {
            "kind": "sequence",
            "references": [
                {"kind": "plan-to", "goal": {"position": [0.26, 0.11, 0.42]}},
                {"kind": "straight", "way": [0.11, 0.17, -0.11], "duration": 2},
            ],
        },
        "law": {"kind": "guided-proportional", "gain": 2},
        "plant": {"kind": "integrator"},
    }
    way = prepare(given).scene.reference
    hand = dqc.DualQuaternion(way.robot.fkm(way.configurations([way.duration])[0]))
    np.testing.assert_allclose(hand.translation, [0.37, 0.28, 0.31], atol=1e-5)

    def none(_, __, ___, ____, error):
        raise error

    monkeypatch.setattr(StepsInTurn, "_elsewhere", none)
    with pytest.raises(PlanError, match=r"reference: references\[1\]: stops at sample \d+ of 201: "):
        prepare(given)


def test_grippers_in_physics_close_and_open_by_steps():
    given, _ = read_spec(
        spec(
            {
                0: {"kind": "set-point", "duration": 0.5},
                2: {"kind": "grip", "body": "rod", "duration": 0.8},
                4: None,
                6: {"kind": "release", "duration": 0.4},
            },
            plant={"kind": "mujoco", "gripper": {"points": "z", "closes": "y"}},
        )
    )
    hand = algebra.pose([0.0, 1.0, 0, 0], [0.45, -0.3, 0.39])
    steps = given.reference.build(hand, Path()).gripper_steps
    found = given.with_empty_hands.gripping(steps)
    assert [(each.time, each.closed) for each in found.plant.gripper.schedule] == [(2.5, True), (7.3, False)]
    held = found.world["rod"].held
    assert (held.since, held.until) == (3.3, 7.3)
    np.testing.assert_allclose(held.put.position, [0.45, -0.3, 0.26], atol=1e-9)


def test_steps_of_a_gripper_are_told_in_time():
    start = np.array([1.0, 0, 0, 0, 0, 0, 0, 0])
    lift = Straight(start, way=[0, 0, 0.1], duration=2.0)
    whole = Sequence([SetPoint(start, 1.0), Grip(start, body="rod"), lift, Release(lift.at(2.0).pose, 0.5)])
    close, let_go = whole.gripper_steps
    assert (close.begin, close.end, close.body, let_go.begin, let_go.end) == (1.0, 2.0, "rod", 4.0, 4.5)
    with pytest.raises(Error, match=r"StartRamp changes a motion with 'grip' or 'release'"):
        _ = dqc.references.StartRamp(whole, 0.5).gripper_steps


@pytest.mark.parametrize(
    ("steps", "changes", "message"),
    [
        ({2: {"kind": "grip", "body": "rot"}}, {}, r"grip.body: unknown name 'rot'; did you mean 'rod'"),
        ({2: {"kind": "grip", "body": "wall"}}, {}, r"grip.body: nothing says how the hand holds 'wall'"),
        ({7: {"kind": "grip", "body": "rod"}}, {}, r"grip.body: 'rod' is gripped twice"),
        (
            {4: {"kind": "plan-to", "goal": {"position": [2, 0, 0.4]}}},
            {},
            r"references\[4\]: goal: unreachable: ",
        ),
        (
            {5: {"kind": "straight", "way": [0, 0, -0.35], "duration": 2}},
            {},
            r"references\[5\]: stops at sample \d+ of 201: table: panda_",
        ),
        ({1: {"kind": "set-point"}}, {}, r"references\[1\]: never ends; give its duration"),
        (
            {4: {"kind": "plan-to", "goal": {"body": "rod"}, "again": {"when": "held"}}},
            {},
            r"again: steps of a sequence are planned once",
        ),
    ],
)
def test_wrong_steps_get_one_line(steps, changes, message):
    with pytest.raises(Error, match=message) as told:
        prepare(spec(steps, **changes))
    assert "\n" not in str(told.value)


def test_what_changes_motions_belongs_to_steps():
    given = spec()
    given["reference"]["repeat"] = 2
    with pytest.raises(ShapeError, match="belongs to steps of a sequence that is planned"):
        prepare(given)


def test_records_say_which_plan_counts(run, way):
    plans = plans_of_run(run.record)
    assert [each.held_by for each in plans] == ["", ""]
    np.testing.assert_allclose([each.time for each in plans], way.begins[[0, 4]], atol=1e-9)
    assert [each.room for each in plans] == [way.ways[k].plan.certificate.room for k in (0, 4)]

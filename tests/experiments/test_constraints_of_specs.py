"""Constraints in specs: kept by all laws, checked before, recorded, judged and drawn."""

import pytest

import dqcontrol as dqc
from dqcontrol.experiments.prepared_experiment import prepare
from dqcontrol.figures.plots import distances
from dqcontrol.measures.held import deadlocks
from dqcontrol.reports.run_report import run_verdicts

SPEC = {
    "name": "walled",
    "robot": "panda",
    "start": [0, -0.3, 0, -2.0, 0, 1.8, 0.7],
    "period": 0.01,
    "duration": 3.0,
    "reference": {"kind": "set-point", "offset": {"translation": [0.0, 0.3, 0.0]}},
    "law": {"kind": "proportional", "gain": 2},
    "plant": {"kind": "integrator"},
}


def wall(y):
    """Return a wall whose free side begins at -y."""
    return {"plane": [0, -1, 0], "position": [0, -y, 0]}


AROUND = {"world": {"wall": wall(-0.2)}}
HAND = {"clear_of": {"wall": {"links": ["hand"]}}}


@pytest.fixture(scope="module")
def run():
    spec = SPEC | AROUND | {"constraints": HAND | {"margin": "20 mm"}}
    return dqc.run(spec)


def rows(run):
    return {row[0]: [str(cell) for cell in row[1:]] for row in run_verdicts(run, None).rows}


def test_a_hand_before_a_wall_stands_there_and_the_report_says_so(run):
    found = rows(run)
    assert "no constraint crossed" in found["Constraints"][0]
    assert "wall: least distance 21" in found["Constraints"][1]
    assert "asked 20" in found["Constraints"][1]
    assert "by wall" in found["Deadlock"][1]
    assert deadlocks(run.record)[0].names == ("wall",)


def test_distances_are_drawn(run):
    figure = distances(run.record)
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["wall", "self-collision"]


def test_a_start_that_violates_is_refused_with_all_that_it_violates():
    world = {"wall": wall(0.05), "ball": wall(0.01)}
    constraints = {"clear_of": {name: {"links": ["hand"]} for name in world}}
    with pytest.raises(
        dqc.Error, match=r"wall: hand: 50 mm deep, 10 mm of distance are asked; ball: hand: 10 mm deep"
    ):
        prepare(SPEC | {"world": world, "constraints": constraints})


@pytest.mark.parametrize(
    ("constraints", "words"),
    [
        ({"clear_of": ["wal"]}, "constraints.clear_of: unknown name 'wal'; did you mean 'wall'"),
        ({"obstacles": {}}, "obstacles"),
        ({"zones": {"a": {"mesh": "room.stl"}}}, "zone"),
        ({"angles": {"a": {"direction": [0, 0, 1], "at_most": "0.5 deg"}}}, "at_most: must be ≥ 0.0349 rad"),
        ({"zones": {"a": {"box": [1, 1, 1]}}, "angels": {}}, "angles"),
    ],
)
def test_slips_are_named(constraints, words):
    with pytest.raises(dqc.Error, match=words):
        prepare(SPEC | AROUND | {"constraints": constraints})


def test_a_law_keeps_its_own_constraints():
    spec = SPEC | {
        "law": SPEC["law"] | {"constraints": {"self_collision": False}},
        "constraints": HAND,
        **AROUND,
    }
    prepared = prepare(spec).cases[0].prepared
    assert prepared is not None
    assert prepared.constraints is not None
    assert prepared.constraints.names == ()

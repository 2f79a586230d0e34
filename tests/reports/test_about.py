"""What the head of a report says of laws, motions and plants: words and numbers, whatever their parameters are."""

import re
from pathlib import Path

import pytest

import dqcontrol as dqc
from dqcontrol.experiments.spec import read_spec
from dqcontrol.reports.about import _constraints, _of_spec, _words

EXAMPLES = sorted((Path(__file__).parents[2] / "examples").glob("*.yaml"))
BLOCKS = {"learn", "learn-force", "sweep", "tune"}  # run by commands of their own


@pytest.mark.parametrize(
    "path", [each for each in EXAMPLES if each.stem not in BLOCKS], ids=lambda path: path.stem
)
def test_examples_are_told_in_words_and_numbers(path, monkeypatch):
    monkeypatch.setenv("PYTHONDONTWRITEBYTECODE", "1")
    for name, text in _of_spec(read_spec(path)[0]):
        assert not re.search(r"[{}\[\]]|\(\)|\d\.\d{6}|None|/home|/root", str(text)), (name, text)
        assert str(path.parent) not in str(text)
        assert len(str(text)) < 600


def test_constraints_are_told_by_name_and_kind():
    spec = read_spec(next(each for each in EXAMPLES if each.stem == "keep-out"))[0]
    assert dict(_of_spec(spec))["Constraints"] == (
        "clear of table (plane) and ball (moving sphere) by 10 mm; upright at most 35°; joint limits"
    )


def test_margins_that_differ_are_told_of_each_body():
    bodies = {"table": dqc.world.Body(box=0.1), "post": dqc.world.Body(cylinder=(0.1, 1), position=(1, 0, 0))}
    given = dqc.constraints.Constraints(
        world=dqc.World(bodies=bodies),
        clear_of={"table": dqc.constraints.ClearOf(margin=0.005), "post": dqc.constraints.ClearOf()},
        joint_limits=False,
    )
    assert _constraints(given) == "clear of table (box) by 5 mm and post (cylinder) by 10 mm"


@pytest.mark.parametrize(
    ("plain", "words"),
    [
        ({"position": (2.0, 0.3, -0.4), "turn": [0.0, 0.0]}, "(position 2, 0.3, −0.4)"),
        ({"schedule": [{"time": 1.0}, {"time": 2.0}], "is_open": True}, "(schedule of 2; is open yes)"),
        ("/somewhere/else/log.csv", "log.csv"),
        (0.8660254037844386, "0.866"),
        (10_000.0, "10000"),
    ],
)
def test_plain_data_in_words(plain, words):
    assert _words(plain) == words

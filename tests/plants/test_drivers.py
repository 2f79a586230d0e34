"""What all robots behind drivers have in common: nothing but a run touches them."""

import pytest

import dqcontrol as dqc
from dqcontrol.errors import ValueRangeError
from dqcontrol.experiments.check import check
from dqcontrol.experiments.prepared_experiment import prepare
from dqcontrol.export import export_controller
from dqcontrol.plants import Driver, UniversalRobot

SPEC = {
    "name": "robot", "robot": "ur5", "start": [0.0, -1.2, 1.4, -1.7, -1.5, 0.0], "period": 0.008,
    "reference": {"kind": "circle", "radius": 0.02, "duration": 0.2, "ramp": 0.05},
    "law": {"kind": "proportional-feedforward", "gain": 5.0}, "plant": {"kind": "ur", "host": "127.9.9.9"},
}  # fmt: skip


@pytest.fixture(autouse=True)
def untouchable(monkeypatch):
    def touched(*_):
        raise AssertionError("somebody reached for the robot")

    monkeypatch.setattr(Driver, "start", touched)


def test_checking_a_spec_reaches_for_no_robot():
    (case,) = prepare(SPEC).cases
    assert case.plant == UniversalRobot(host="127.9.9.9")
    check(SPEC)


@pytest.mark.slow
def test_a_controller_is_exported_without_its_robot(tmp_path):
    export_controller(SPEC, tmp_path / "c")
    assert (tmp_path / "c").is_dir()


def test_no_search_runs_on_a_robot():
    searched = {**SPEC, "tune": {"objectives": {"position.rms": 1}, "margin": 0, "budget": 8}}
    with pytest.raises(ValueRangeError, match="'ur' is a robot, and a search would run it many times"):
        dqc.tune(searched)


def test_disturbances_are_for_simulated_joints():
    pushed = {**SPEC, "disturbance": {"twist": {"kind": "constant", "value": [0, 0, 0, 0.01, 0, 0]}}}
    with pytest.raises(ValueRangeError, match="only simulated joints"):
        prepare(pushed)

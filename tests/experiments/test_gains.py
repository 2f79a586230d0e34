"""Gains for a period, a delay and a lag: what is told is what a run does."""

import sys
from typing import Any

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol import cli
from dqcontrol.errors import ValueRangeError
from dqcontrol.experiments.gain_advice import advise_gains

START = np.array([0.2, 0.6, 0.1, 1.6, -0.3, 0.9, 0.4])
LAWS = {
    "proportional-feedforward": dqc.laws.ProportionalFeedforward,
    "h-infinity": dqc.laws.HInfinity,
    "feedback-linearization": dqc.laws.FeedbackLinearization,
}


def test_runs_overshoot_and_lag_as_told():
    """T = 8 ms, a delay of 30 ms that is no multiple of it, a lag of 50 ms."""
    arm = dqc.load_robot("iiwa7")
    plant = dqc.plants.Servo(delay=0.030, time_constant=0.050)
    advice = advise_gains("iiwa7", period=0.008, delay=0.030, lag=0.050)
    rows: dict[Any, Any] = {row[0]: row for row in advice.table.rows}
    assert len(rows) == 8
    for kind, law in LAWS.items():
        _, percent, _, behind = rows[kind]
        parameters = advice.parameters[kind]
        goal = dqc.references.SetPoint(arm.fkm(START + 1e-4))
        record = dqc.simulate(arm, goal, law(**parameters), plant, START, 0.008, 4.0)
        overshoot = dqc.measures.evaluate(record).position_overshoot
        assert 100 * overshoot == pytest.approx(percent, abs=1.0), kind
        assert percent < 6
        line = dqc.references.Spiral(arm.fkm(START), radius=1e-6, length=0.2, duration=2.0, axis="y")
        record = dqc.simulate(arm, line, law(**parameters), plant, START, 0.008, 1.99)
        assert 1e3 * record.position_error[-1] == pytest.approx(behind, rel=0.05, abs=1.0), kind


@pytest.mark.slow
def test_twice_as_much_is_still_stable_and_why_is_said():
    advice = advise_gains("ur5", period=0.01)
    assert advice.parameters["proportional"]["gain"] in (99, 100)
    assert (
        advice.reasons[0].startswith("k = 1e+02 1/s: twice as much is the limit")
        or "1/s: twice" in advice.reasons[0]
    )
    late = advise_gains("ur5", period=0.001, delay=0.02, lag=0.05)
    assert any("70 ms decide, not the period" in line for line in late.reasons)


def test_a_mobile_base_is_refused():
    with pytest.raises(ValueRangeError, match="little-john has a mobile base"):
        advise_gains("little-john", period=0.05)


def called(words, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["dqcontrol", *words])
    code = 0
    try:
        cli.main()
    except SystemExit as end:
        code = end.code
    return code, capsys.readouterr()


def test_times_with_units_on_the_command_line(monkeypatch, capsys):
    code, said = called(
        ["gains", "iiwa7", "--period", "8ms", "--delay", "30 ms", "--lag", "0.05"], monkeypatch, capsys
    )
    assert code == 0
    assert "gain: 6.3" in said.out
    assert "delay and lag of 80 ms decide" in said.out
    code, said = called(["gains", "iiwa7", "--period", "8 minutes"], monkeypatch, capsys)
    assert code == 2
    assert "expected a number in s, or with a unit as 8ms, got '8 minutes'" in said.err

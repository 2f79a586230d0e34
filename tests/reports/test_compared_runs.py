"""The unit of what the inputs move, in all figures of several runs."""

import pytest

import dqcontrol as dqc
from dqcontrol.cli.result_commands import compare
from dqcontrol.experiments.run_comparison import unit_of_way
from dqcontrol.reports import redrawn

SPEC = {
    "name": "units",
    "robot": "iiwa7",
    "start": [0, 0.6, 0, 1.6, 0, 0.6, 0],
    "period": 0.05,
    "reference": {"kind": "circle", "radius": 0.05, "duration": 1},
    "laws": {"K": {"kind": "proportional", "gain": 5}, "FF": {"kind": "proportional-feedforward", "gain": 5}},
    "plant": {"kind": "integrator"},
}


def test_units_of_ways():
    arm, base = dqc.load_robot("iiwa7"), dqc.load_robot("little-john")
    assert unit_of_way([arm]) == "rad"
    assert unit_of_way([arm, base]) == unit_of_way([base]) == "rad or m"


@pytest.mark.parametrize("record", [pytest.param("all", marks=pytest.mark.slow), "metrics"])
def test_figures_of_revolute_arms_say_rad(tmp_path, monkeypatch, record):
    pytest.importorskip("matplotlib")
    given = []
    figures = "dqcontrol.figures.comparison_figures"
    monkeypatch.setattr(figures, lambda records, unit, around: given.append(unit) or {})
    study = dqc.run_study(SPEC | {"record": record}, jobs=1)
    study.save(tmp_path / "study")
    assert given == ["rad"]
    if record == "all":
        folders = sorted((tmp_path / "study/runs").glob("*")) or [tmp_path / "study"]
        redrawn.figures_of_results(folders)
        compare(*folders, out=tmp_path / "compared")
        assert given == ["rad"] * 3

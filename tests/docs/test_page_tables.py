"""Tables of the pages are those that come out; what the examples are there to show is so."""

import pytest
from page_blocks import PAGES, ROOT, blocks

import dqcontrol as dqc
from dqcontrol import experiments


@pytest.fixture(scope="module")
def demo():
    pytest.importorskip("mujoco")
    return experiments.run_study(ROOT / "examples/demo.yaml")


def test_demo_stays_on_the_drawing(demo):
    for label, run in demo.runs.items():
        assert run.record.stopped == "duration", label
        assert run.metrics.position.settled_peak < 10, label  # mm
        assert run.metrics.orientation.settled_peak < 2, label  # degrees
    for plant in ("servo", "physics"):
        with_feedforward, without = (demo.runs[f"{law} · {plant}"].metrics for law in ("K+FF", "K"))
        assert with_feedforward.error.mean < 0.6 * without.error.mean


def test_table_of_the_demo(demo):
    shown = (
        (ROOT / "docs/demo.md").read_text().partition("<!-- demo table: begin -->")[2].partition("<!--")[0]
    )
    for cell, own in zip(cells(shown), cells(demo.table().markdown()), strict=True):
        # MuJoCo's arithmetic differs between processors
        assert cell == own or float(cell) == pytest.approx(float(own), rel=0.02)


@pytest.mark.parametrize("kind", ["proportional", "proportional-feedforward"])
def test_circle_example_runs(kind):
    data = {"law": {"kind": kind, "gain": 4}}
    text = (ROOT / "examples/circle.yaml").read_text()
    import yaml

    run = experiments.run(
        {**yaml.safe_load(text.replace("1e-5", "1.0e-5").replace("2e-5", "2.0e-5")), **data}
    )
    assert run.metrics.position.settled_rms < 12


def test_feedforward_is_better_on_a_spiral_in_the_servo_plant():
    mean = {}
    for kind in ("proportional", "proportional-feedforward"):
        run = experiments.run(
            {
                "name": "spiral",
                "robot": "iiwa7",
                "start": [0, 0.8491, 0, 1.5708, 0, 0.8491, 0],
                "period": 0.008,
                "reference": {
                    "kind": "spiral",
                    "radius": 0.07,
                    "length": 0.07,
                    "axis": "y",
                    "turns": 3,
                    "duration": 24,
                    "offset": {"translation": [0, 0.05, 0.05], "rotation": [0, 0, 0.1]},
                },
                "law": {"kind": kind, "gain": 20},
                "plant": {"kind": "servo", "time_constant": 0.05, "sag": 1, "stiffness": 2000},
            }
        )
        mean[kind] = run.metrics.error.mean
    assert mean["proportional-feedforward"] <= 0.6 * mean["proportional"]


def test_open_loop_drifts_on_creeping_joints_and_closed_loop_does_not():
    study = experiments.run_study(ROOT / "examples/drift.yaml")
    end = {label: run.metrics.final_error for label, run in study.runs.items()}
    assert end["K+FF · creeping"] == pytest.approx(3.6e-4, rel=0.02)
    assert end["open · creeping"] > 50 * end["K+FF · creeping"]
    assert end["open · ideal"] < 1e-4


def test_table_of_the_tutorial(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    (spec,) = [block.text for block in blocks("tutorial.md") if block.name == "mine.yaml"]
    (tmp_path / "mine.yaml").write_text(spec, encoding="utf-8")
    text = PAGES["tutorial.md"].read_text(encoding="utf-8")
    shown = text.partition("<!-- tutorial table: begin -->")[2].partition("<!-- tutorial")[0]
    table = dqc.run_study("mine.yaml").table().markdown()
    for cell, own in zip(cells(shown), cells(table), strict=True):
        assert cell == own or float(cell) == pytest.approx(float(own), rel=0.02, abs=1e-3)


def cells(table):
    return [cell.strip() for row in table.splitlines() if row.startswith("| ") for cell in row.split("|")]


@pytest.mark.slow
def test_table_of_laws():
    study = dqc.run_study(ROOT / "examples/which-law.yaml")
    shown = PAGES["which-law.md"].read_text(encoding="utf-8").partition("law table: begin -->")[2]
    rows = [cells(row) for row in shown.partition("<!--")[0].splitlines()[1:]]
    plants = rows[0][2:-1]
    for row in rows[2:]:
        for plant, cell in zip(plants, row[2:-1], strict=True):
            own = study.runs[f"{row[1]} · {plant}"].metrics.position.settled_rms
            assert float(cell) == pytest.approx(own, rel=0.02), (row[1], plant)

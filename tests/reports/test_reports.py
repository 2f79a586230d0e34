"""Reports of runs and studies: what they say of a run, and the line that gives it again, pasted as it stands."""

import re
import shlex
import shutil
import sys
from contextlib import suppress
from dataclasses import replace
from html import unescape
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from matplotlib.figure import Figure

import dqcontrol as dqc
import dqcontrol.figures
from dqcontrol import cli
from dqcontrol.experiments import load_run, run_study_to, run_sweep_to
from dqcontrol.experiments.parameter_units import parameter_unit, with_unit
from dqcontrol.loop import Timing
from dqcontrol.loop.signals import Signal
from dqcontrol.measures.lyapunov import Certificate
from dqcontrol.reports import rewrite_reports
from dqcontrol.reports.about import command, evaluation_command, origins
from dqcontrol.reports.run_report import run_verdicts
from dqcontrol.reports.study_reports import study_verdicts
from dqcontrol.supervisor.interventions import INTERVENTIONS, VELOCITY
from dqcontrol.tables.tables import Column, Table
from dqcontrol_theses.reproduced import Reproduced

SPEC = {
    "name": "again",
    "robot": "ax18",
    "start": [0, -0.9, 0.9, 0.9, 0],
    "period": 0.02,
    "reference": {"kind": "circle", "radius": 0.02, "duration": 0.4},
    "law": {"kind": "partial-proportional", "part": "position", "gain": 2},
    "plant": {"kind": "servo", "encoder_noise": 1e-4},
    "seed": 7,
}


def paste(report, monkeypatch, where):
    """Run the line of a report in a folder; return the line."""
    page = report.read_text(encoding="utf-8")
    line = unescape(page.partition('<pre class="command">')[2].partition("</pre>")[0])
    monkeypatch.chdir(where)
    monkeypatch.setattr(sys, "argv", shlex.split(line))
    with suppress(SystemExit):  # of runs that are not good
        cli.main()
    return line


@pytest.fixture(scope="module")
def run():
    return dqc.run(SPEC)


@pytest.fixture
def plain(monkeypatch):
    """Draw no figures: their files are looked at elsewhere."""
    for name in ("run_figures", "comparison_figures"):
        monkeypatch.setattr(f"dqcontrol.figures.{name}", lambda *_, **__: {})


@pytest.mark.usefixtures("plain")
def test_the_line_of_a_run_gives_it_again(run, tmp_path, monkeypatch):
    first = run.save(tmp_path / "first run")
    line = paste(first / "report.html", monkeypatch, first)
    assert line == "dqcontrol run spec.yaml --out ../again"
    assert (tmp_path / "again/metrics.json").read_bytes() == (first / "metrics.json").read_bytes()
    np.testing.assert_array_equal(load_run(tmp_path / "again").q, run.q)
    run.save(first, force=True)  # nothing foreign lies there now
    page = (first / "report.html").read_text(encoding="utf-8")
    assert "<td>seed</td><td>7</td>" in page
    assert "<td>numpy</td>" in page


@pytest.mark.slow
@pytest.mark.usefixtures("plain")
def test_the_line_of_a_study_gives_it_again_and_its_page_leads_to_the_runs(tmp_path, monkeypatch):
    spec = {key: value for key, value in SPEC.items() if key != "law"}
    laws = {"slow": SPEC["law"], "fast": SPEC["law"] | {"gain": 10}}
    first = tmp_path / "study"
    run_study_to(spec | {"laws": laws}, first)
    paste(first / "report.html", monkeypatch, first)
    assert (tmp_path / "again/table.csv").read_bytes() == (first / "table.csv").read_bytes()
    shutil.rmtree(tmp_path / "again")
    paste(first / "fast-servo/report.html", monkeypatch, first / "fast-servo")
    assert (tmp_path / "again/metrics.json").read_bytes() == (first / "fast-servo/metrics.json").read_bytes()
    run_study_to(spec | {"laws": laws}, first, force=True)  # nothing foreign lies there now
    page = (first / "report.html").read_text(encoding="utf-8")
    assert '<a href="fast-servo/report.html">fast · servo</a>' in page
    assert (first / "fast-servo/report.html").is_file()


@pytest.fixture
def one_line(monkeypatch):
    """Draw figures that take no time."""
    figure = Figure(figsize=(1, 1))
    figure.subplots().plot([0, 1])
    monkeypatch.setattr("dqcontrol.figures.run_figures", lambda *_, **__: {"errors": lambda: figure})
    monkeypatch.setattr("dqcontrol.figures.comparison_figures", lambda *_, **__: {"paths": lambda: figure})
    monkeypatch.setattr("dqcontrol.figures.robot_picture", lambda *_: figure)


@pytest.mark.slow
@pytest.mark.usefixtures("one_line")
def test_figures_of_the_runs_of_a_study_are_drawn_on_demand(tmp_path):
    spec = {key: value for key, value in SPEC.items() if key != "law"}
    spec |= {"laws": {"slow": SPEC["law"], "fast": SPEC["law"] | {"gain": 10}}}
    study = tmp_path / "study"
    run_study_to(spec, study)
    assert '<figure id="paths">' in (study / "report.html").read_text(encoding="utf-8")
    page = (study / "fast-servo/report.html").read_text(encoding="utf-8")
    assert "dqcontrol report ." in page
    assert "<img" not in page
    command = page.partition('<pre class="command">')[2].partition("</pre>")[0]
    assert [path.parent.name for path in rewrite_reports([study], jobs=1)] == ["fast-servo", "slow-servo"]
    page = (study / "fast-servo/report.html").read_text(encoding="utf-8")
    assert page.count("<img") == 2
    assert '<figure id="errors">' in page
    assert "dqcontrol report ." not in page
    assert f'<pre class="command">{command}</pre>' in page
    run_study_to(spec, study, force=True, figures=False)  # nothing foreign lies there now
    pages = [study / "report.html", *study.glob("*/report.html")]
    assert not any("<img" in page.read_text(encoding="utf-8") for page in pages)
    run_study_to(spec, study, force=True, figures=True, jobs=1)
    assert sum("<img" in page.read_text(encoding="utf-8") for page in pages) == 3
    assert not list(study.glob("**/*.png"))  # they are drawn when somebody asks for them: dqcontrol figures


@pytest.mark.usefixtures("plain")
def test_the_head_says_what_a_run_is_about(run, tmp_path):
    page = (run.save(tmp_path / "run") / "report.html").read_text(encoding="utf-8")
    head = page.partition('<div class="about">')[2].partition("</div><")[2].partition("</div>")[0]
    told = [unescape(cell) for cell in re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", head)]
    facts = dict(zip(told[::2], told[1::2], strict=True))
    assert facts["Robot"].startswith("ax18: 5 joints, reach ")
    assert facts["Law"] == "partial-proportional: part position, gain 2 1/s"
    assert facts["Motion"] == "circle: radius 0.02 m, duration 0.4 s"
    assert facts["Plant"] == "servo: encoder noise 0.0001 rad or m"
    assert facts["Control period"] == "20 ms"
    assert facts["Verdict"].startswith(("✗ not followed", "✓ followed"))
    assert re.fullmatch(r"\d{4}-\d\d-\d\d \d\d:\d\d", facts["Date"])


@pytest.mark.usefixtures("plain")
def test_results_run_again_where_their_files_are_not(tmp_path):
    """Another machine: robot, drawing and function are gone, and their copies are used."""
    source = tmp_path / "source"
    source.mkdir()
    shutil.copy(Path(dqc.robots.__file__).parent / "models/ax18.yaml", source / "arm.yaml")
    (source / "line.txt").write_text("speed 0.05\nline 0.01 0\n")
    spec = SPEC | {"robot": "arm.yaml", "reference": {"kind": "drawing", "file": "line.txt"}}
    (source / "spec.yaml").write_text(yaml.safe_dump(spec))
    first = run_study_to(source / "spec.yaml", tmp_path / "run").runs
    shutil.rmtree(source)
    moved = (tmp_path / "run").rename(tmp_path / "moved")
    assert sorted(path.name for path in (moved / "inputs").iterdir()) == ["arm.yaml", "line.txt"]
    again = dqc.run(moved / "spec.yaml")
    np.testing.assert_array_equal(again.q, next(iter(first.values())).q)
    loaded = load_run(moved)
    np.testing.assert_array_equal(dqc.run(yaml.safe_load(loaded.spec)).q, again.q)


@pytest.mark.slow
@pytest.mark.usefixtures("plain")
def test_the_line_of_a_sweep_gives_it_again(tmp_path, monkeypatch):
    pytest.importorskip("pyarrow")
    over = {"law.gain": {"low": 1, "high": 9}}
    run_sweep_to(
        SPEC | {"sweep": {"method": "sobol", "points": 4, "over": over}}, tmp_path / "sweep", by="effort"
    )
    line = paste(tmp_path / "sweep/report.html", monkeypatch, tmp_path / "sweep")
    assert line == "dqcontrol sweep spec.yaml --by effort --out ../again"
    assert (tmp_path / "again/best.csv").read_bytes() == (tmp_path / "sweep/best.csv").read_bytes()


@pytest.mark.usefixtures("plain")
def test_the_line_of_a_comparison_gives_it_again_from_anywhere(run, tmp_path, monkeypatch):
    run.save(tmp_path / "a b")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["dqcontrol", "compare", "a b", "--out", "both"])
    cli.main()
    (tmp_path / "elsewhere").mkdir()
    paste(tmp_path / "both/report.html", monkeypatch, tmp_path / "elsewhere")
    assert (tmp_path / "elsewhere/again/table.csv").read_bytes() == (tmp_path / "both/table.csv").read_bytes()


@pytest.mark.usefixtures("plain")
def test_the_line_of_an_evaluation_gives_it_again_from_anywhere(run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    run.export("log.csv")
    (tmp_path / "wanted.yaml").write_text(yaml.safe_dump({"reference": SPEC["reference"]}))
    words = "evaluate log.csv --robot ax18 --reference wanted.yaml --duration 0.3 --angles rad --out first"
    monkeypatch.setattr(sys, "argv", ["dqcontrol", *words.split()])
    with pytest.raises(SystemExit, match="1"):  # the run did not follow
        cli.main()
    (tmp_path / "elsewhere").mkdir()
    line = paste(tmp_path / "first/report.html", monkeypatch, tmp_path / "elsewhere")
    assert "--duration 0.3" in line
    again = tmp_path / "elsewhere/again/metrics.json"
    assert again.read_bytes() == (tmp_path / "first/metrics.json").read_bytes()


def test_the_line_of_a_reproduction_names_what_was_chosen(tmp_path):
    table = Table([Column("Law")], [["K"]])
    done = Reproduced("pereira2016/circle", [table], plant="servo", conditions={"repeats": 2})
    assert done.command == "dqcontrol reproduce pereira2016/circle --plant servo --repeats 2"
    assert f"{done.command} --out again" in (done.save(tmp_path / "r") / "report.html").read_text(
        encoding="utf-8"
    )


def test_arguments_are_quoted_and_what_is_off_is_left_out():
    assert (
        command("run", "my spec.yaml", jobs=None, force=False, out="x")
        == "dqcontrol run 'my spec.yaml' --out x"
    )
    about = {
        "log": "l.csv",
        "robot": {"source": "ax18", "base_link": None, "tip_link": "tip"},
        "joints": ["a", "b"],
    }
    assert evaluation_command(about | {"skip_initial": 0.0}) == (
        "dqcontrol evaluate l.csv --robot ax18 --tip-link tip --skip-initial 0.0 --joints a,b --out again"
    )


def test_seeds_of_repeats_and_points_are_told():
    told = dict(origins(SPEC | {"repeats": 3, "sweep": {"seed": 5}}).rows)
    assert told["seeds"] == "7 … 9, one a repeat"
    assert told["seed of the points"] == "5"
    assert "seed" not in dict(origins({}).rows)


def verdicts(run, certificate=None) -> dict[str, Any]:
    rows: Any = run_verdicts(run, certificate).rows
    return {row[0]: (row[1], row[1].good, row[2]) for row in rows}


def test_a_good_run_is_called_good():
    slow = {"reference": SPEC["reference"] | {"duration": 6}, "law": SPEC["law"] | {"gain": 20}}
    found = verdicts(dqc.run(SPEC | slow | {"plant": {"kind": "integrator"}}))
    assert {question: good for question, (_, good, _) in found.items()} == {
        "End": True,
        "Task": True,
        "Joint limits": True,
        "Velocity limits": True,
        "Loop gains": True,
    }
    assert found["End"][2] == "duration; 6 s"


def test_a_bad_run_is_called_bad(run):
    record, limits = run.record, run.robot.limits
    q, command = record.q.copy(), record.command.copy()
    q[3, 1], command[5, 2] = limits.upper[1] + 0.1, -1.5 * limits.velocity[2]
    signal = Signal(INTERVENTIONS, ("",), ("",), np.array([[0.0], [VELOCITY], [0.0]] * 7))
    broken = replace(
        record, q=q, command=command, stopped="faulted at 0.2 s: too hot", readings={INTERVENTIONS: signal}
    )
    timing = Timing(0.02, 0.03 * np.arange(9), np.full(9, 0.01), np.full(9, 0.01), np.full(9, True))
    found = verdicts(replace(run, record=broken, timing=timing))
    assert found["End"][:2] == ("failed", False)
    assert found["Joint limits"] == ("exceeded", False, "joint_2: 0.1 rad beyond")
    assert found["Velocity limits"] == (
        "exceeded",
        False,
        "joint_3: commands up to 150 % of its limit, there or beyond in 5 % of the samples",
    )
    assert found["Supervisor"] == ("intervened", None, "7 times, first at 0.020 s: velocity limit")
    assert found["Control periods"][:2] == ("missed", False)
    quiet = replace(broken, readings={INTERVENTIONS: replace_values(signal, 0.0)})
    assert verdicts(replace(run, record=quiet))["Supervisor"][:2] == ("never intervened", True)


def replace_values(signal, value):
    return signal._replace(values=np.full_like(signal.values, value))


def test_stability_proof_and_range_are_judged():
    spec = {
        "name": "drive",
        "robot": "little-john",
        "start": [0, 0, 0, 0, -0.9, 0.9, 0.9, 0],
        "period": 0.05,
        "duration": 2,
        "reference": {"kind": "set-point", "offset": {"translation": [0.2, 0.0, 0]}},
        "law": {"kind": "feedback-linearization", "stiffness": 1.0, "damping": 1.0},
        "plant": {"kind": "integrator"},
    }
    run = dqc.run(spec)
    certificate = Certificate.recorded(run.record)
    assert certificate is not None
    found = verdicts(run, certificate)
    assert found["Lyapunov function V"][:2] == ("falls", True)
    assert found["Range of J"][:2] == ("not stuck", True)
    assert found["Loop gains"][:2] == ("good", True)
    rising = replace(certificate, pose_part=certificate.pose_part[::-1])
    assert verdicts(run, rising)["Lyapunov function V"][:2] == ("rises", False)
    stuck = run.record.readings["range_condition"]
    values = stuck.values.copy()
    values[-1, 1] = values[-1, 0]
    record = replace(
        run.record, readings={**run.record.readings, "range_condition": stuck._replace(values=values)}
    )
    assert verdicts(replace(run, record=record))["Range of J"][:2] == ("stuck", False)


def test_the_verdicts_of_repeats_count_those_that_failed():
    row = {
        "robot": "",
        "law": "K",
        "set": "",
        "plant": "",
        "seed": 0,
        "stopped": "duration",
        "limit_margin": 0.1,
        "verdict": "reached",
        "failure": "",
    }
    ended = {"stopped": "diverged at 1 s", "verdict": "diverged at 1 s", "failure": "ended"}
    bad = row | ended | {"repeat": 1, "limit_margin": -0.2}
    rows: Any = study_verdicts([row | {"repeat": 0}, bad]).rows
    ((label, count, end, task, kept, least),) = rows
    assert (label, count, end, kept, least) == ("K", "1 of 2", "failed", "exceeded", -0.2)
    assert task == "1 of 2; diverged at 1 s"
    assert (end.good, kept.good) == (False, False)


@pytest.mark.slow
def test_figures_of_saved_results_as_files_for_papers(run, tmp_path, monkeypatch, capsys):
    run.save(tmp_path / "run", figures=False)
    monkeypatch.chdir(tmp_path)
    draw = dqcontrol.figures.run_figures
    monkeypatch.setattr("dqcontrol.figures.run_figures", lambda *a, **o: {"errors": draw(*a, **o)["errors"]})
    words = "figures run --format pdf --format png --width single"
    monkeypatch.setattr(sys, "argv", ["dqcontrol", *words.split()])
    cli.main()
    assert capsys.readouterr().out == "results: figures\nerrors\n"
    assert (tmp_path / "figures/errors.pdf").read_bytes()[:5] == b"%PDF-"
    png = (tmp_path / "figures/errors.png").read_bytes()
    assert int.from_bytes(png[16:20], "big") == 1050  # 3.5 in of 300 dots
    for words, message in (
        ("figures", "give at least one folder"),
        ("figures nowhere --out other", "nowhere: no such file"),
        ("figures run --format gif --out other", "gif"),
        ("figures run", "figures: exists"),
    ):
        monkeypatch.setattr(sys, "argv", ["dqcontrol", *words.split()])
        with pytest.raises(SystemExit) as end:
            cli.main()
        assert end.value.code == 2
        error = capsys.readouterr().err
        assert (message in error, error.count("\n")) == (True, 1), error


def test_units_of_parameters_come_from_their_descriptions():
    assert with_unit("laws.*.gain") == "laws.*.gain [1/s]"
    assert with_unit("error_weight") == "error_weight"
    assert parameter_unit("plant.encoder_noise") == "rad or m"
    assert parameter_unit("plants.servo.delay") == "s"
    assert parameter_unit("plants.servo.stiffness") == ""  # N·m/rad of servos, but a share of compliant arms
    assert parameter_unit("stiffness") == "1/s²"
    assert parameter_unit("no.such.key") == ""

"""`dqcontrol evaluate` and `dqcontrol convert` as a person types them."""

import re
import shlex
import shutil
import subprocess
import sys

import pytest
import yaml
from log_files import CIRCLE

import dqcontrol as dqc
from dqcontrol import cli


@pytest.fixture(scope="module")
def run():
    return dqc.run(CIRCLE)


@pytest.fixture(scope="module")
def saved(run, tmp_path_factory):
    return run.save(tmp_path_factory.mktemp("saved") / "run", figures=False)


@pytest.fixture
def here(run, saved, tmp_path, monkeypatch):
    """Work in a folder with a run, its table and its reference."""
    shutil.copytree(saved, tmp_path / "run")
    (tmp_path / "run/errors.png").write_bytes(b"\x89PNG\r\n\x1a\n\0\0")
    run.export(tmp_path / "log.csv")
    (tmp_path / "circle.yaml").write_text(yaml.safe_dump({"reference": CIRCLE["reference"]}))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def call(line, monkeypatch, capsys):
    """Run a command line and return its exit code and what it printed."""
    monkeypatch.setattr(sys, "argv", shlex.split(line))
    code = 0
    try:
        cli.main()
    except SystemExit as end:
        code = end.code
    return code, *capsys.readouterr()


@pytest.mark.slow
def test_evaluate_prints_the_metrics_and_writes_the_results(run, here, monkeypatch, capsys):
    line = "dqcontrol evaluate log.csv --robot iiwa7 --reference circle.yaml --out found"
    code, out, err = call(line, monkeypatch, capsys)
    assert (code, err) == (1, "")  # the law lags: it is measured, and said
    assert out.splitlines()[:2] == [run.verdict.words, "results: found"]
    assert re.search(rf"Position error RMS +│ {run.metrics.position.rms:.4g} +│ mm", out)
    assert {"record.mcap", "report.html", "metrics.json"} <= {p.name for p in (here / "found").iterdir()}
    assert call(line, monkeypatch, capsys)[0] == 2  # nothing is overwritten unasked
    assert call(f"{line} --force", monkeypatch, capsys)[0] == 1
    code, out, _ = call("dqcontrol compare run found --wide", monkeypatch, capsys)
    assert code == 0
    assert "end of the log" in out


def test_evaluate_says_first_what_failed_and_ends_with_1(here, monkeypatch, capsys):
    code, out, _ = call("dqcontrol evaluate run", monkeypatch, capsys)
    assert code == 1
    assert re.match(r"too late: .* mm behind; not followed: errs by \d+", out)
    code, out, _ = call("dqcontrol evaluate log.csv --robot iiwa7 --reference log.csv", monkeypatch, capsys)
    assert (code, out.splitlines()[0]) == (0, "followed")


def test_evaluate_writes_nothing_unasked(here, monkeypatch, capsys):
    before = sorted(here.rglob("*"))
    assert call("dqcontrol evaluate run", monkeypatch, capsys)[0] == 1
    assert sorted(here.rglob("*")) == before


def test_convert_writes_every_format_and_overwrites_only_by_force(here, monkeypatch, capsys):
    for suffix in ("csv", "parquet", "mat"):
        code, out, _ = call(f"dqcontrol convert run data/out.{suffix}", monkeypatch, capsys)
        assert (code, out) == (0, f"results: data/out.{suffix}\n")
        code, _, err = call(f"dqcontrol convert run data/out.{suffix}", monkeypatch, capsys)
        assert code == 2
        assert err.startswith(f"dqcontrol: data/out.{suffix}: exists")
        assert call(f"dqcontrol convert run data/out.{suffix} --force", monkeypatch, capsys)[0] == 0
    assert (here / "data" / "out.csv").read_bytes() == (here / "log.csv").read_bytes()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("evaluate nothing.csv --robot iiwa7 --reference circle.yaml", "nothing.csv: no such file"),
        (
            "evaluate log.csv --robot iiwa8 --reference circle.yaml",
            "unknown name 'iiwa8'; did you mean 'iiwa7'",
        ),
        ("evaluate log.csv --reference circle.yaml", "log.csv does not name its robot; give one (--robot)"),
        ("evaluate log.csv --robot iiwa7", "reference: log.csv holds none; give a file (--reference)"),
        (
            "evaluate bad.csv --robot iiwa7 --reference circle.yaml",
            "bad.csv:3: q4: expected a number, got 'x'",
        ),
        ("evaluate log.csv --robot iiwa7 --reference circle.yaml --out run", "run: exists"),
        ("evaluate log.csv --robot iiwa7 --reference circle.yaml --angles grad", "Invalid value"),
        (
            "evaluate circle.yaml --robot iiwa7 --reference circle.yaml",
            "circle.yaml:1: joints missing: joint_1",
        ),
        ("evaluate run/report.html --robot iiwa7 --reference circle.yaml", "run/report.html:1: "),
        ("evaluate run/errors.png --robot iiwa7 --reference circle.yaml", "run/errors.png: not a text file"),
        (
            "convert run out.xls",
            "out.xls: suffix: unknown name '.xls'; did you mean '.csv'? (allowed: .csv, .mat, .parquet)",
        ),
        ("convert nothing out.csv", "nothing: no such file"),
    ],
)
def test_a_mistake_gives_one_line_and_exit_code_2(here, monkeypatch, capsys, arguments, message):
    names = ["time", *(f"q{i + 1}" for i in range(7))]
    (here / "bad.csv").write_text(",".join(names) + "\n0,1,1,1,1,1,1,1\n1,1,1,1,x,1,1,1\n")
    code, out, err = call(f"dqcontrol {arguments}", monkeypatch, capsys)
    assert (code, out) == (2, "")
    assert message in err
    assert err.startswith("dqcontrol: ")
    assert err.count("\n") == 1


@pytest.mark.slow
def test_a_mistake_in_a_process_of_its_own_shows_no_traceback(tmp_path):
    command = [
        sys.executable,
        "-m",
        "dqcontrol",
        "evaluate",
        "no.mcap",
        "--robot",
        "iiwa7",
        "--reference",
        "a.yaml",
    ]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.splitlines() == ["dqcontrol: no.mcap: no such file"]

"""The command line as a person uses it: results where they are said to be, mistakes in one line with exit code 2."""

import re
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest
import yaml

from dqcontrol import cli, load_robot
from dqcontrol.cli import screen
from dqcontrol.errors import LimitWarning
from dqcontrol.plants.linear_model import LinearModel

SPEC = {
    "name": "tiny",
    "robot": "iiwa7",
    "start": [0, 0.6, 0, 1.6, 0, 0.6, 0],
    "period": 0.01,
    "reference": {"kind": "circle", "radius": 0.05, "duration": 1.0},
    "law": {"kind": "proportional", "gain": 5},  # it lags, so that its runs end with 1
    "plant": {"kind": "integrator"},
}


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "spec.yaml").write_text(yaml.safe_dump(SPEC))
    return tmp_path


def call(*arguments, capsys):
    """Run the command line and return its exit code and what it printed."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["dqcontrol", *map(str, arguments)])
        try:
            cli.main()
            code = 0
        except SystemExit as end:
            code = end.code or 0
    out, err = capsys.readouterr()
    # What is compiled by now hangs on the tests before; tests/compiled look at what is said of it.
    lines = [line for line in err.splitlines(keepends=True) if not line.startswith("dqcontrol: compiling")]
    return code, out, "".join(lines)


def test_run_writes_a_folder_and_prints_the_table(here, capsys):
    code, out, _ = call("run", "spec.yaml", capsys=capsys)
    assert code == 1
    assert "proportional · integrator" in out
    assert "results: results/tiny" in out
    names = {path.name for path in (here / "results/tiny").iterdir()}
    assert {"spec.yaml", "record.mcap", "metrics.json", "report.html"} <= names
    assert '<figure id="path">' in (here / "results/tiny/report.html").read_text(encoding="utf-8")


@pytest.mark.parametrize("repeats", [1, 2])
def test_results_are_kept_though_nobody_reads_what_is_printed(here, capsys, monkeypatch, repeats):
    """As by `dqcontrol run spec.yaml | head -1`, or with a name of a column that there is not."""
    (here / "spec.yaml").write_text(yaml.safe_dump(SPEC | {"repeats": repeats}))

    monkeypatch.setenv(screen.COLUMNS, "")  # the command line sets it, here for this test alone

    def closed(*words, **options):
        raise BrokenPipeError

    with monkeypatch.context() as patch:
        patch.setattr("builtins.print", closed)
        call("run", "spec.yaml", "--no-figures", "--out", "piped", capsys=capsys)
    code, _, err = call(
        "run", "spec.yaml", "--no-figures", "--columns", "nonsense", "--out", "named", capsys=capsys
    )
    assert code == 2
    assert err.splitlines()[-1].startswith("dqcontrol: columns: unknown name 'nonsense'")
    for name in ("piped", "named"):
        assert (here / name / "report.html").exists() or (here / name / "metrics.json").exists()


def test_results_are_never_overwritten_unasked(here, capsys):
    assert call("run", "spec.yaml", "--no-figures", "--out", "out", capsys=capsys)[0] == 1
    before = (here / "out/metrics.json").stat().st_mtime_ns
    code, _, err = call("run", "spec.yaml", "--out", "out", capsys=capsys)
    assert (code, err.count("\n")) == (2, 1)
    assert "out: exists" in err
    assert "--force" in err
    assert (here / "out/metrics.json").stat().st_mtime_ns == before
    assert call("run", "spec.yaml", "--no-figures", "--out", "out", "--force", capsys=capsys)[0] == 1
    assert (here / "out/metrics.json").stat().st_mtime_ns != before
    (here / "precious").mkdir()
    (here / "precious/thesis.tex").write_text("years of work")
    code, _, err = call("run", "spec.yaml", "--out", "precious", "--force", capsys=capsys)
    assert code == 2
    assert "never replaced" in err
    assert (here / "precious/thesis.tex").read_text() == "years of work"


@pytest.mark.slow
def test_a_study_and_its_comparison(here, capsys):
    spec = {key: value for key, value in SPEC.items() if key != "law"}
    spec["laws"] = {
        "K": SPEC["law"],
        "K+FF": {"kind": "proportional-feedforward", "gain": 5},
    }
    (here / "study.yaml").write_text(yaml.safe_dump(spec))
    assert call("run", "study.yaml", "--out", "study", capsys=capsys)[0] == 1
    assert {"K-integrator", "K+FF-integrator", "table.md", "table.csv"} <= {
        path.name for path in (here / "study").iterdir()
    }
    code, out, _ = call(
        "compare", "study/K-integrator", "study/K+FF-integrator", "--out", "both", capsys=capsys
    )
    assert code == 0
    assert "K+FF-integrator" in out
    for page in ("study", "both"):
        assert '<figure id="paths">' in (here / page / "report.html").read_text(encoding="utf-8")
    rerun = call("run", "study/K-integrator/spec.yaml", "--out", "again", capsys=capsys)
    assert rerun[0] == 1  # as in the study, K lags
    assert (here / "again/metrics.json").read_text() == (here / "study/K-integrator/metrics.json").read_text()


REPEATED = {**SPEC, "plant": {"kind": "servo", "encoder_noise": 1e-4}, "repeats": 3}


@pytest.mark.slow
def test_a_study_with_repeats(here, capsys):
    pytest.importorskip("pyarrow")
    (here / "repeats.yaml").write_text(yaml.safe_dump(REPEATED))
    code, out, err = call("run", "repeats.yaml", "--jobs", 1, capsys=capsys)
    assert code == 1
    assert re.search(r"│ proportional +│ +3 │ +0 │ +0 │ +\d+\.\d+ ± 0\.\d+ ", out), out
    assert "3/3" in err
    (here / "other.yaml").write_text(yaml.safe_dump({**REPEATED, "name": "other", "seed": 9}))
    assert call("run", "other.yaml", capsys=capsys)[0] == 1
    code, out, _ = call("compare", "results/tiny", "results/other", "--out", "both", capsys=capsys)
    assert code == 0
    assert re.search(r"│ tiny +│ +3 │ +0 │", out)
    assert re.search(r"│ other +│ +3 │ +0 │", out)
    assert {path.name for path in (here / "both").iterdir()} == {
        "spec.yaml", "report.html", "table.md", "table.csv", "table.tex", ".dqcontrol-results",
    }  # fmt: skip


def test_an_interrupted_study_says_how_it_goes_on(here, capsys, monkeypatch):
    pytest.importorskip("pyarrow")
    from dqcontrol.experiments import trials

    (here / "repeats.yaml").write_text(yaml.safe_dump(REPEATED))
    execute = trials.execute

    def interrupted(setting, case, repeat, **options):
        if repeat == 2:
            raise KeyboardInterrupt
        return execute(setting, case, repeat, **options)

    with monkeypatch.context() as patch:
        patch.setattr(trials, "execute", interrupted)
        code, _, err = call("run", "repeats.yaml", "--no-figures", capsys=capsys)
    assert code == 130
    assert err.endswith(
        "dqcontrol: interrupted; finished trials are kept: rerun the same command to resume\n"
    )
    assert not (here / "results/tiny").exists()
    code, _, err = call("run", "repeats.yaml", "--no-figures", capsys=capsys)
    assert code == 1
    assert "dqcontrol: resuming: 2 of 3 trials already done\n" in err
    assert not (here / "results/.tiny.part").exists()


def test_trials_that_diverge_are_said_at_the_end(here, capsys):
    laws = {"good": SPEC["law"], "bad": {"kind": "proportional", "gain": 1.7e308}}
    far = {"kind": "set-point", "duration": 1, "offset": {"rotation": [0, 0, 3.0]}}
    spec = {**REPEATED, "reference": far, "laws": laws}
    del spec["law"]
    (here / "bad.yaml").write_text(yaml.safe_dump(spec))
    code, out, _ = call("run", "bad.yaml", "--no-figures", capsys=capsys)
    assert code == 1
    assert "bad · servo: 3 of 3 repeats diverged at 0 s: the command is not finite (seed 0)\n" in out


@pytest.mark.slow
def test_shapes_of_robots(here, capsys):
    options = ("--pairs", "--write", "mine.yaml", "--picture", "panda.png")
    code, out, _ = call("robots", "shapes", "panda", *options, capsys=capsys)
    assert code == 0
    assert "panda: 10 shapes, 15 of" in out
    assert load_robot("mine.yaml").shapes == load_robot("panda").shapes
    assert Path("panda.png").read_bytes().startswith(b"\x89PNG")
    code, _, err = call("robots", "shapes", "panda", "--picture", "panda.gif", capsys=capsys)
    assert code == 2
    assert "panda.gif: must end in .png, .pdf, .svg" in err


def test_robots(here, capsys):
    code, out, _ = call("list", "robots", capsys=capsys)
    assert code == 0
    assert {"iiwa7", "meka-a2", "ax18"} <= set(re.findall(r"[\w-]+", out))
    code, out, _ = call("robots", "show", "iiwa7", capsys=capsys)
    assert code == 0
    assert "reach 0.926 m" in out


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"robot": "iwa7"}, r"robot: unknown name 'iwa7'; did you mean 'iiwa7'"),
        ({"law": {"kind": "proportionl", "gain": 1}}, r"spec.yaml: law\.?.*proportionl"),
        (
            {"law": {"kind": "proportional", "gian": 1}},
            r"spec.yaml: law: unknown key 'gian'; did you mean 'gain'",
        ),
        ({"law": {"kind": "proportional", "gain": 0}}, r"law.gain: expected a number > 0.0, got 0"),
        ({"law": {"kind": "proportional", "gain": float("nan")}}, r"spec.yaml: law.gain: must be finite"),
        ({"start": [0, 1]}, r"start: expected shape \(…, 7\), got shape \(2,\)"),
        ({"start": [0, 9, 0, 0, 0, 0, 0]}, r"start: joint_2 is 9, outside its limits"),
        ({"repeats": 0}, r"spec.yaml: repeats: expected a whole number >= 1, got 0"),
        ({"seed": -1}, r"spec.yaml: seed: expected a whole number >= 0, got -1"),
        (
            {"parameter_sets": {"a": {"proportionl": {}}}},
            r"spec.yaml: parameter_sets.a: unknown name .* did you mean 'proportional'",
        ),
        (
            {"parameter_sets": {"a": {"proportional": {"error_weight": 1}}}},
            r"parameter_sets.a.proportional: unknown key 'error_weight'",
        ),
        ({"robots": {"a": {"source": "iiwa7"}}}, r"spec.yaml: robots.a: missing key 'start'"),
        ({"perod": 1}, r"spec.yaml: unknown key 'perod'; did you mean 'period'"),
        ({"period": "fast"}, r"spec.yaml: period: expected"),
        (
            {"reference": {"kind": "circle", "radius": 3, "duration": 10}},
            r"t = .* s .* m out of reach of iiwa7",
        ),
        ({"reference": {"kind": "drawing", "file": "none.txt"}}, r"none.txt: no such file"),
    ],
)
def test_mistakes_in_a_spec(here, capsys, change, message):
    (here / "spec.yaml").write_text(yaml.safe_dump({**SPEC, **change}))
    code, out, err = call("run", "spec.yaml", capsys=capsys)
    assert code == 2
    assert err.startswith("dqcontrol: ")
    assert err.count("\n") == 1
    assert re.search(message, err), err
    assert not out
    assert not (here / "results").exists()


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("spec.yaml", "name: [unclosed", r"spec.yaml:\d: "),
        ("spec.yaml", "", "spec.yaml: is empty"),
        ("spec.yaml", "name: a\nname: b\n", "spec.yaml:2: key 'name' appears twice"),
    ],
)
def test_malformed_files(here, capsys, name, text, message):
    (here / name).write_text(text)
    code, _, err = call("run", name, capsys=capsys)
    assert (code, err.count("\n")) == (2, 1)
    assert re.search(message, err), err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["run"], "SPEC"),
        (["run", "missing.yaml"], "missing.yaml: no such file"),
        (["compare"], "give at least one folder"),
        (["compare", "nowhere"], "nowhere: no such file"),
        (["robots", "show", "iwa7"], "did you mean 'iiwa7'"),
        (["robots", "show", "bad.urdf"], "bad.urdf"),
        (["rn", "spec.yaml"], "rn"),
        (["run", "spec.yaml", "--frce"], "frce"),
        (["run", "spec.yaml", "--jobs", "0"], "jobs: expected an integer ≥ 1, got 0"),
    ],
)
def test_mistakes_on_the_command_line(here, capsys, arguments, message):
    (here / "bad.urdf").write_text('<!DOCTYPE robot [<!ENTITY a "b">]><robot name="x"/>')
    code, _, err = call(*arguments, capsys=capsys)
    assert (code, err.count("\n")) == (2, 1)
    assert message in err
    assert "Traceback" not in err


def test_help_says_what_every_argument_and_option_is():
    lines = [
        line for line in cli.app.generate_docs(output_format="markdown").splitlines() if line[:3] == "* `"
    ]
    assert len(lines) > 60
    assert (
        "* `--out, -o PATH`: New folder for the results; default: results/NAME, NAME from the spec." in lines
    )
    for line in lines:
        assert re.match(r"\* `[^`]+`: [\w.]", line), line


def test_installed_command_reports_its_version():
    command = Path(sys.executable).parent / "dqcontrol"
    out = subprocess.run([command, "--version"], capture_output=True, text=True, check=True).stdout
    assert re.fullmatch(r"\d+\.\d+\.\d+\n", out)


def test_check_moves_nothing_and_tells_instability_by_its_exit_code(here, capsys):
    code, out, err = call("check", "spec.yaml", capsys=capsys)
    assert (code, err) == (0, "")
    assert "good" in out
    assert [path.name for path in here.iterdir()] == ["spec.yaml"]
    fast = SPEC | {"law": {"kind": "proportional", "gain": 250}}
    (here / "spec.yaml").write_text(yaml.safe_dump(fast))
    code, out, err = call("check", "spec.yaml", capsys=capsys)
    assert (code, err) == (1, "")
    assert (
        "proportional · integrator: position unstable: k = 250 1/s, limit 200 1/s; largest recommended k = 100 1/s"
        in out
    )
    code, _, err = call("run", "spec.yaml", "--no-figures", capsys=capsys)
    assert code == 1
    assert "dqcontrol: warning: proportional · integrator: position unstable" in err
    (here / "spec.yaml").write_text("robot: 3")
    code, _, err = call("check", "spec.yaml", capsys=capsys)
    assert (code, err.count("\n")) == (2, 1)


def test_a_warning_is_said_once_whatever_filters_do(capsys):
    with warnings.catch_warnings():
        warnings.showwarning = cli._warnings_once()
        for _ in range(2):
            warnings.simplefilter("always")
            warnings.warn("too far", LimitWarning, stacklevel=1)
    assert capsys.readouterr().err == "dqcontrol: warning: too far\n"


def test_sweep_and_compare_list_the_best_points(here, capsys):
    pytest.importorskip("pyarrow")
    (here / "sweep.yaml").write_text(
        yaml.safe_dump(SPEC | {"sweep": {"over": {"law.gain": [2, 20], "seed": [0]}}})
    )
    code, out, err = call("sweep", "sweep.yaml", capsys=capsys)
    assert code == 1, err  # as `run` ends where the task alone was missed
    assert "results: results/tiny" in out
    assert re.match(r"\d of 2 runs failed, \d of them like point 0, .*: not followed: ", out.splitlines()[0])
    assert '<figure id="sweep">' in (here / "results/tiny/report.html").read_text(encoding="utf-8")
    places = [row.split("│")[1:4] for row in out.splitlines() if row.startswith("│")]
    assert [[cell.strip() for cell in row] for row in places] == [["1", "1", "20"], ["2", "0", "2"]]
    code, out, _ = call("compare", "results/tiny", "--by", "effort", capsys=capsys)
    assert code == 0
    assert "best 2 of 2 by effort" in out
    assert "law.gain" in out
    for arguments in (
        ["sweep", "spec.yaml"],
        ["run", "sweep.yaml"],
        ["compare", "results/tiny", "--by", "eror"],
    ):
        code, _, err = call(*arguments, capsys=capsys)
        assert (code, err.count("\n")) == (2, 1)


def test_help_of_any_command_loads_nothing_heavy(tmp_path):
    script = """
import sys
from dqcontrol.cli import COMMANDS, whole_app
for command in ("", *COMMANDS, "reproduce"):
    whole_app()([*command.split(), "--help"], result_action="return_value")
    loaded = {"numpy", "numba", "matplotlib", "scipy", "mujoco", "pyarrow"} & set(sys.modules)
    print(f"loaded by '{command}':", *loaded)
"""
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    found = [line for line in done.stdout.splitlines() if line.startswith("loaded by")]
    assert found == [f"loaded by '{command}':" for command in ("", *cli.COMMANDS, "reproduce")]


@pytest.mark.parametrize("command", ["robots solve", "robots list", "compare", "figures", "learn"])
def test_help_lists_no_options_that_undo_others(capsys, command):
    cli.whole_app()([*command.split(), "--help"], result_action="return_value")
    assert not re.search("--(no|empty)-", capsys.readouterr().out)


def test_a_matrix_that_cannot_be_computed_with_is_told_in_a_line(here, monkeypatch, capsys):
    def fail(*_):
        raise np.linalg.LinAlgError("Singular matrix")

    monkeypatch.setattr("dqcontrol.experiments.check", fail)
    code, _, err = call("check", "spec.yaml", capsys=capsys)
    assert code == 2
    assert err.startswith("dqcontrol: cannot be computed: Singular matrix; look for a zero")


def test_a_loop_whose_matrix_is_not_finite_is_unstable():
    model = LinearModel(np.ones((1, 1)), np.full((1, 1), 0.01))
    with np.errstate(over="ignore", invalid="ignore"):
        assert np.isinf(model.poles(np.inf)).all()


def test_plan_prints_the_way_and_what_is_proved_of_it(here, capsys):
    spec = SPEC | {
        "robot": "panda",
        "start": [0, -0.8, 0, -2.4, 0, 1.6, 0.8],
        "world": {"post": {"capsule": [0.05, 1.0], "position": [0.3, 0.2, 0.5]}},
        "constraints": {"clear_of": "all", "acceleration": 10},
        "reference": {"kind": "plan-to", "goal": {"configuration": [1.5, -0.8, 0, -2.4, 0, 1.6, 0.8]}},
        "law": {"kind": "guided-proportional", "gain": 2},
    }
    (here / "spec.yaml").write_text(yaml.safe_dump(spec))
    code, out, err = call("plan", "spec.yaml", capsys=capsys)
    assert (code, err) == (0, "")
    assert "panda: " in out
    assert "85.9" in out  # 1.5 rad
    assert re.search(
        r"\d s; certified: least room \d\S* mm beyond what is asked \(post: panda_link\d\); \d+ edges, seed 0",
        out,
    )
    (here / "spec.yaml").write_text(yaml.safe_dump(spec | {"start": [0.6, -0.8, 0, -2.4, 0, 1.6, 0.8]}))
    code, out, err = call("plan", "spec.yaml", capsys=capsys)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert err.startswith("dqcontrol: spec.yaml: reference: start: post: panda_link")
    (here / "spec.yaml").write_text(yaml.safe_dump(spec | {"period": 5.0e-324}))
    code, out, err = call("plan", "spec.yaml", capsys=capsys)
    assert (code, err) == (
        2,
        "dqcontrol: spec.yaml: reference: period: takes inf steps; at most 10 million\n",
    )
    (here / "spec.yaml").write_text(yaml.safe_dump(SPEC))
    code, out, err = call("plan", "spec.yaml", capsys=capsys)
    assert (code, out) == (2, "")
    assert "reference: expected kind plan-to, got " in err

"""What a new user meets first: `dqcontrol` alone, `new`, lists of kinds, joint angles for a pose, shell completion."""

import os
import sys

import numpy as np
import pytest
import yaml
from test_cli import SPEC, call, here  # noqa: F401

from dqcontrol import cli
from dqcontrol.algebra import translation
from dqcontrol.cli import start_commands
from dqcontrol.experiments import check
from dqcontrol.experiments.new_spec import new_spec
from dqcontrol.experiments.prepared_experiment import prepare
from dqcontrol.experiments.spec import read_spec
from dqcontrol.robots import load_robot


def test_alone_it_says_what_can_be_done_here(here, capsys):  # noqa: F811
    (here / "gains.yaml").write_text(yaml.safe_dump({**SPEC, "sweep": {"over": {"law.gain": [1]}}}))
    (here / "arm.urdf").write_text("<robot/>")
    (here / "results/done").mkdir(parents=True)
    (here / "results/done/spec.yaml").write_text("name: done\n")
    code, out, _ = call(capsys=capsys)
    assert code == 0
    for line in (
        "run spec.yaml",
        "sweep gains.yaml",
        "robots show arm.urdf",
        "view results/done",
        "new my.yaml",
    ):
        assert f"  dqcontrol {line} " in out
    assert max(map(len, out.splitlines())) <= 100


def test_files_here_that_never_end_are_not_read(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "endless.yaml").symlink_to("/dev/zero")
    os.mkfifo(tmp_path / "pipe.yaml")
    code, out, _ = call(capsys=capsys)
    assert code == 0
    assert "Here:" not in out


def test_in_an_empty_folder_it_says_how_to_start(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    out = call(capsys=capsys)[1]
    assert "Here:" not in out
    assert "dqcontrol new my.yaml" in out


def test_defaults_make_an_experiment_that_is_stable(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, out, _ = call("new", "first.yaml", "--yes", capsys=capsys)
    assert (code, out.splitlines()[-1]) == (
        0,
        "next: dqcontrol check first.yaml, then dqcontrol run first.yaml",
    )
    assert list(check("first.yaml").remarks()) == []
    code, _, err = call("new", "first.yaml", "--yes", capsys=capsys)
    assert (code, "--force" in err) == (2, True)


@pytest.mark.parametrize("motion", start_commands.MOTIONS)
def test_every_motion_fits(tmp_path, capsys, monkeypatch, motion):
    monkeypatch.chdir(tmp_path)
    given = [
        "--robot",
        "ur5",
        "--motion",
        motion,
        "--period",
        "125 Hz",
        "--law",
        "both",
        "--plant",
        "integrator",
    ]
    assert call("new", "m.yaml", *given, capsys=capsys)[0] == 0
    spec, _ = read_spec("m.yaml")
    assert (spec.period, list(spec.laws), spec.reference.duration) == (0.008, ["K", "K+FF"], 8)
    assert not check("m.yaml").unstable


def test_questions_are_asked_and_answers_checked(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    answers = iter(["ur5", "squar"])
    monkeypatch.setattr("builtins.input", lambda question: next(answers))
    code, _, err = call("new", capsys=capsys)
    assert (code, "--yes for defaults" in err) == (2, True)  # no terminal
    monkeypatch.setattr(sys.stdin, "isatty", lambda: True)
    code, _, err = call("new", capsys=capsys)
    assert (code, "motion: unknown 'squar'; did you mean 'square'?" in err) == (2, True)
    code, _, err = call("new", "--yes", "--period", "8 mm", capsys=capsys)
    assert (code, "period: expected a time, as 8 ms, or a rate, as 125 Hz, got '8 mm'" in err) == (2, True)


@pytest.mark.parametrize(
    ("what", "some"),
    [
        ("laws", ["proportional-feedforward", "gain", "J_w⁺ [−k_O"]),
        ("references", ["circle", "via-points", "radius"]),
        ("plants", ["servo", "integrator"]),
    ],
)
def test_lists_of_kinds(capsys, what, some):
    out = call("list", what, capsys=capsys)[1]
    for word in some:
        assert word in out
    assert "`" not in out


def test_joint_angles_for_a_pose(capsys, monkeypatch):
    monkeypatch.delenv("COLUMNS", raising=False)  # that workers of the tests have: all columns are printed
    at = ["--position", "0.4", "-0.2", "0.4", "--rpy", "180deg", "0", "-30deg"]
    code, out, _ = call("robots", "solve", "ur5", *at, "--top", "3", capsys=capsys)
    assert code == 0
    assert "room to limits" in out
    arm, text = load_robot("ur5"), out.splitlines()[-1].partition("   #")[0]
    hand = arm.fkm(np.array(yaml.safe_load(text)["start"]))
    assert translation(hand) == pytest.approx([0.4, -0.2, 0.4], abs=1e-4)
    code, out, _ = call("robots", "solve", "panda", "--position", "0.5", "0", "0.4", capsys=capsys)
    assert (code, "-0.0 " in out, "e-" in out) == (0, False, False)  # joints at 0 to rounding
    code, _, err = call("robots", "solve", "ur5", "--position", "4", "0", "0", capsys=capsys)
    assert (code, err.startswith("dqcontrol: start: unreachable: the position is 3")) == (2, True)


@pytest.mark.parametrize(
    "shell", ["bash", *(pytest.param(each, marks=pytest.mark.slow) for each in ("zsh", "fish"))]
)
def test_shells_complete_commands_and_options(shell):
    script = cli.whole_app().generate_completion(shell=shell)
    for word in ("reproduce", "robots", "solve", "scheduler", "install-completion"):
        assert word in script


def test_a_file_that_is_there_is_not_replaced_by_a_script(tmp_path, capsys):
    mine = tmp_path / ".bashrc"
    mine.write_text("mine\n")
    code, _, err = call("--install-completion", "--shell", "bash", "--output", str(mine), capsys=capsys)
    assert (code, err) == (2, f"dqcontrol: {mine}: exists already; choose another name or remove it\n")
    assert mine.read_text() == "mine\n"


@pytest.mark.parametrize("robot", ["panda", "ur5", "barrett-wam"])
def test_a_first_motion_stays_above_the_table(robot):
    """Arms stand on what is z = 0 in their base frame: neither hand nor joints go there."""
    text, _ = new_spec("first", robot, "set-point", "8 ms", "proportional", "integrator")
    scene = prepare(yaml.safe_load(text)).scenes[""]
    assert translation(scene.samples[:, :8])[:, 2].min() > 0.05
    assert translation(scene.robot.frames(scene.start))[:, 2].min() >= -0.005  # whole degrees

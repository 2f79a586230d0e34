"""`dqcontrol export` as a person types it: a controller of a spec, and what mistakes say."""

import shlex
import sys
from pathlib import Path
from typing import get_args

import pytest
import yaml
from exported import SPEC, make, needs_c

from dqcontrol import cli
from dqcontrol.cli.experiment_commands import Target
from dqcontrol.compiled.object_code import TARGETS
from dqcontrol.export.controller_folder import _BUILT


@pytest.fixture
def call(tmp_path, monkeypatch, capsys):
    """Return a function that runs a command line in a folder with a spec and a folder of a run."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "spec.yaml").write_text(yaml.safe_dump(SPEC), encoding="utf-8")
    (tmp_path / "run").mkdir()

    def call(line):
        monkeypatch.setattr(sys, "argv", shlex.split(f"dqcontrol export {line}"))
        try:
            cli.main()
        except SystemExit as end:
            return end.code, capsys.readouterr().err
        return 0, capsys.readouterr().out

    return call


def test_a_controller_is_exported_once(call):
    code, said = call("spec.yaml --out c")
    assert code == 0
    assert "native: " in said
    assert "kB of code" in said
    assert said.startswith("results: c (try: make -C c test)\n")
    code, said = call("spec.yaml --out c")
    assert (code, said) == (
        2,
        "dqcontrol: c: exists; choose another folder, or replace it with --force (force=True)\n",
    )
    assert call("spec.yaml --out c --force")[0] == 0
    for built in _BUILT:  # by make
        Path("c", built).touch()
    assert call("spec.yaml --out c --force")[0] == 0
    Path("c/notes.txt").touch()
    assert call("spec.yaml --out c --force") == (
        2,
        "dqcontrol: c: holds 'notes.txt', which no run wrote; it is not replaced\n",
    )


def test_torques_of_an_impedance_are_refused_with_what_to_take_instead(call):
    soft = SPEC | {
        "plant": {"kind": "mujoco", "timestep": 0.0005, "impedance": {"stiffness": 800, "turn_stiffness": 20}}
    }
    Path("soft.yaml").write_text(yaml.safe_dump(soft), encoding="utf-8")
    code, said = call("soft.yaml --out c")
    assert code == 2
    assert said.startswith("dqcontrol: plant.impedance: its torques are the plant's")
    assert "give 'contact', which is exported" in said
    assert not Path("c").exists()


@needs_c
@pytest.mark.slow
def test_what_make_leaves_is_known(call):
    assert call("spec.yaml --out c")[0] == 0
    before = {path for path in Path("c").rglob("*") if path.is_file()}
    make("c", "all", "test", "bench", "run", "hosts")
    made = {str(path.relative_to("c")) for path in Path("c").rglob("*") if path.is_file()} - {
        str(path.relative_to("c")) for path in before
    }
    assert made == set(_BUILT)
    make("c", "clean")
    assert {path for path in Path("c").rglob("*") if path.is_file()} == before


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("spec.yaml", 'Command "export" parameter --out requires an argument'),
        ("spec.yaml log.csv --out c", "takes no further argument, got 'log.csv'"),
        ("run --out c", "run: is a folder; a controller is exported from its spec, run/spec.yaml"),
        ("spce.yaml --out c", "spce.yaml: "),
        ("spec.yaml --out c --target arm", "Invalid value"),
    ],
)
def test_mistakes_are_said_in_a_line(call, line, message):
    code, said = call(line)
    assert code == 2
    assert said.startswith(f"dqcontrol: {message}")
    assert said.count("\n") == 1


def test_all_targets_may_be_chosen():
    assert set(get_args(Target)) == set(TARGETS)

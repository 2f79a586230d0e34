"""`dqcontrol export` as a person types it: a controller of a spec or signals of a run, and what mistakes say."""

import shlex
import sys

import pytest
import yaml
from exported import SPEC

from dqcontrol import cli


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
    assert "results: c (try: make -C c test)" in said
    code, said = call("spec.yaml --out c")
    assert (code, said) == (
        2,
        "dqcontrol: c: exists; choose another folder, or replace it with --force (force=True)\n",
    )
    assert call("spec.yaml --out c --force")[0] == 0


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("spec.yaml", "out: missing: write dqcontrol export spec.yaml --out FOLDER"),
        (
            "spec.yaml log.csv",
            "spec.yaml: is not the folder of a run, whose signals log.csv could take",
        ),
        ("run", "run: is a folder; name a file for its signals (.csv, .parquet, .mat), or give a spec"),
        ("run --out c", "run: is a folder; a controller is exported from its spec: run/spec.yaml"),
        ("spce.yaml --out c", "spce.yaml: "),
        ("spec.yaml --out c --target arm", "target: unknown name 'arm'"),
    ],
)
def test_mistakes_are_said_in_a_line(call, line, message):
    code, said = call(line)
    assert code == 2
    assert said.startswith(f"dqcontrol: {message}")
    assert said.count("\n") == 1

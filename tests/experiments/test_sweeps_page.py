"""The example of docs/sweeps.md, with fewer points."""

import re
import shlex
import sys
from pathlib import Path

import pytest

from dqcontrol import cli

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "sweeps.md").read_text(encoding="utf-8")


@pytest.fixture
def page(tmp_path, monkeypatch):
    """Work in a folder with the example, of 16 points instead of 512."""
    text = (ROOT / "examples" / "sweep.yaml").read_text(encoding="utf-8")
    fewer, count = re.subn(r"points: \d+", "points: 16", text)
    assert count == 1
    (tmp_path / "examples").mkdir()
    (tmp_path / "examples" / "sweep.yaml").write_text(fewer, encoding="utf-8")
    monkeypatch.chdir(tmp_path)


def test_commands_and_python_of_the_page_run(page, monkeypatch, capsys):
    block = re.findall(r"```console\n(.*?)```", PAGE, flags=re.S)[0]
    for line in block.splitlines():
        monkeypatch.setattr(sys, "argv", shlex.split(line.removeprefix("$ ")))
        cli.main()  # a mistake would raise SystemExit
    assert "law" in capsys.readouterr().out
    [code] = re.findall(r"```python\n(.*?)```", PAGE, flags=re.S)
    exec(code.replace('"results/sweep")', '"results/again")', 1), {})
    assert Path("effort.png").stat().st_size > 10_000

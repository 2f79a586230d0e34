"""The examples of docs/own-data.md."""

import re
import shlex
import sys
from pathlib import Path

import numpy as np
import pytest
from log_files import EPOCH, joint_state, numbers, pose_stamped, write_bag, write_mcap

import dqcontrol as dqc
from dqcontrol import cli

PAGE = (Path(__file__).parents[2] / "docs" / "own-data.md").read_text(encoding="utf-8")
SPEC = {
    "name": "own",
    "robot": "iiwa7",
    "start": [0, 0.6, 0, 1.6, 0, 0.6, 0],
    "period": 0.02,
    "reference": {"kind": "circle", "radius": 0.05, "duration": 2},
    "law": {"kind": "proportional", "gain": 5},
    "plant": {"kind": "integrator"},
}


def fenced(language):
    return re.findall(rf"```{language}\n(.*?)```", PAGE, flags=re.S)


@pytest.fixture
def page(tmp_path, monkeypatch):
    """Work in a folder with the files that the page speaks of: those it shows and those that stand for the user's."""
    run = dqc.run(SPEC)
    for name, text in re.findall(r"<!-- (\S+) -->\n```(?:csv|yaml)\n(.*?)```", PAGE, flags=re.S):
        (tmp_path / name).write_text(text, encoding="utf-8")
    run.save(tmp_path / "results" / "circle")
    names, messages = list(run.record.joint_names), []
    for k, time in enumerate(run.time):
        stamp = EPOCH + round(time * 1e9)
        position = run.record.desired_position[k]
        messages.append(("/joint_states", stamp, joint_state(stamp, names, run.q[k])))
        messages.append(("/velocity_controller/commands", stamp, numbers(run.command[k])))
        messages.append(("/target", stamp, pose_stamped(stamp, position, run.desired[k, :4])))
    write_bag(tmp_path / "bag", messages)
    write_mcap(tmp_path / "log.mcap", messages)
    taught = np.column_stack([run.time, run.q])
    header = "time," + ",".join(f"q{i + 1}" for i in range(7))
    np.savetxt(tmp_path / "taught.csv", taught, delimiter=",", header=header, comments="")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_the_commands_of_the_page_run(page, monkeypatch, capsys):
    lines = [line[2:] for block in fenced("console") for line in block.splitlines() if line.startswith("$ ")]
    assert len(lines) >= 6
    for line in lines:
        monkeypatch.setattr(sys, "argv", shlex.split(line))
        cli.main()  # a mistake would raise SystemExit
        captured = capsys.readouterr()
        assert captured.err == "", line
        assert captured.out, line


def test_the_python_of_the_page_runs(page):
    blocks = fenced("python")
    assert blocks
    for block in blocks:
        exec(block, {})

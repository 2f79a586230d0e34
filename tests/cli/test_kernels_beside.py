"""Kernels of every run, compiled by a second process on the first run of a machine."""

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from dqcontrol.cli import experiment_commands
from dqcontrol.compiled import compile as compiling, kernel_cache
from dqcontrol.loop.rollout import rollout
from dqcontrol.measures.run_numbers import measure_kernel

SPEC = """
name: circle
robot: iiwa7
start: [0, 0.6, 0, 1.6, 0, 0.6, 0]
period: 0.01
reference: {kind: circle, radius: 0.07, duration: 1}
law: {kind: proportional-feedforward, gain: 4}
plant: {kind: servo}
"""


@pytest.fixture
def started(monkeypatch, tmp_path):
    """Commands of processes that would be started, with an empty cache and two processors."""
    found = []
    monkeypatch.setattr(subprocess, "Popen", lambda command, **_: found.append(command))
    monkeypatch.setattr(os, "cpu_count", lambda: 2)
    monkeypatch.setattr(kernel_cache, "root", lambda: tmp_path)
    monkeypatch.setattr(kernel_cache, "is_kept", lambda function: False)
    return found


def test_new_kernels_start_one_process(started):
    experiment_commands.compile_beside()
    assert started == [[sys.executable, "-P", "-m", "dqcontrol.cli.experiment_commands"]]


@pytest.mark.parametrize(
    ("owner", "name", "value"),
    [
        (kernel_cache, "is_kept", lambda function: True),
        (kernel_cache, "root", lambda: None),
        (os, "cpu_count", lambda: 1),
        (compiling, "IS_PLAIN", True),
    ],
)
def test_nothing_starts_where_it_would_not_help(started, monkeypatch, owner, name, value):
    monkeypatch.setattr(owner, name, value)
    experiment_commands.compile_beside()
    assert started == []


@pytest.mark.slow
def test_the_second_process_compiles_into_the_same_cache(tmp_path):
    environment = {
        **os.environ,
        "PYTHONPATH": str(Path(experiment_commands.__file__).parents[2]),
        "DQCONTROL_CACHE": str(tmp_path / "kernels"),
    }
    (tmp_path / "circle.yaml").write_text(SPEC, encoding="utf-8")
    beside = subprocess.Popen([sys.executable, "-m", "dqcontrol.cli.experiment_commands"], env=environment)
    assert beside.wait(300) == 0
    folder = tmp_path / "kernels"
    compiled = {path.name for path in folder.rglob("*.nbi")}
    for kernel in (rollout, measure_kernel):
        assert any(kernel.__name__ in name for name in compiled), (kernel.__name__, compiled)
    before = {path: path.stat().st_mtime_ns for path in folder.rglob("*.nbi")}
    time.sleep(0.01)
    done = subprocess.run(
        [sys.executable, "-m", "dqcontrol", "run", "circle.yaml", "--no-figures"],
        env=environment,
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert all(path.stat().st_mtime_ns == stamp for path, stamp in before.items())
    assert set(folder.rglob("*.nbi")) > set(before)

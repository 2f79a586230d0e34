"""`dqcontrol doctor --compile`: what it runs, and what it says."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

import dqcontrol
from dqcontrol.cli import doctor_command
from dqcontrol.experiments.prepared_experiment import prepare


@pytest.mark.parametrize("case", doctor_command.CASES)
def test_each_case_is_a_spec(case):
    assert len(prepare(doctor_command.case_spec(case)).cases) == 1


@pytest.mark.slow
def test_a_second_time_finds_all_in_the_cache(tmp_path):
    program = (
        "from dqcontrol.cli import doctor_command as a; a.CASES = {'ideal joints': a.CASES['ideal joints']}; "
        "print(a.compile_ahead(), a.compile_ahead())"
    )
    done = subprocess.run(
        [sys.executable, "-c", program],
        env={
            **os.environ,
            "PYTHONPATH": str(Path(dqcontrol.__file__).parents[1]),
            "DQCONTROL_CACHE": str(tmp_path / "cache"),
        },
        capture_output=True,
        text=True,
        check=True,
    )
    first, second = map(int, done.stdout.split())
    assert first > 3
    assert second == 0
    assert "compiling 1 of 1: ideal joints" in done.stderr

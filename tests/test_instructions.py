"""What a step costs in instructions, counted by callgrind: whatever else runs beside, the count is the same."""

import os
import re
import runpy
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parent.parent / "benchmarks/instructions.py"
STEPS = 1_000, 101_000
EXPECTED = 4906  # a step of law K on ideal joints; 5127 before parameters, state and scratch had names
MOST = 1.25  # of that: other versions of LLVM


def instructions(steps, environment):
    """Return how many instructions a run of so many steps takes, with all that Python does before."""
    callgrind = ["valgrind", "--tool=callgrind", "--trace-children=yes", "--callgrind-out-file=/dev/null"]
    command = [*callgrind, sys.executable, str(SCRIPT), str(steps)]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    assert done.returncode == 0, done.stderr
    return int(re.findall(r"Collected : (\d+)", done.stderr)[-1])


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("valgrind") is None, reason="valgrind is not installed")
def test_a_step_takes_no_more_instructions_than_it_did(tmp_path):
    environment = {**os.environ, **runpy.run_path(str(SCRIPT))["PLAIN"], "DQCONTROL_CACHE": str(tmp_path)}
    # Kernels are compiled outside of valgrind.
    subprocess.run([sys.executable, str(SCRIPT), "10"], env=environment, check=True)
    few, many = (instructions(steps, environment) for steps in STEPS)
    count = (many - few) / (STEPS[1] - STEPS[0])
    print(f"{count:.0f} instructions a step, {EXPECTED} expected")
    assert 0.5 * EXPECTED < count < MOST * EXPECTED

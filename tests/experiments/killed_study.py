"""Kills a study with -9 while it runs, as tests of sweeps and repeats need it."""

import subprocess
import sys
import time

from dqcontrol.experiments.working_folder import working_folder


def run_and_kill(program, spec, target, *arguments):
    """Run a Python program on a spec's path until its study has kept the first trials, then kill it."""
    part = working_folder(target)
    process = subprocess.Popen([sys.executable, "-c", program, spec, target, *arguments])
    try:
        while not list(part.glob("part-*.parquet")) and process.poll() is None:
            time.sleep(0.01)
    finally:
        process.kill()
        process.wait()
    assert not target.exists()

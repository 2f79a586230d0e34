"""Kills a study with -9 while it runs, as tests of sweeps and repeats need it."""

import subprocess
import sys
import time

from dqcontrol.experiments.results_folder import working_folder

# What a program gives its study as `progress`: on a busy machine it is seen late that there is something to kill.
WAITS = """
import signal, sys
from pathlib import Path
from dqcontrol.experiments.results_folder import working_folder

def wait_once_trials_are_kept(done, total):
    if list(working_folder(Path(sys.argv[2])).glob("part-*.parquet")):
        signal.pause()
"""


def run_and_kill(program, spec, target, *arguments):
    """Run a Python program on a spec's path until its study has kept the first trials, then kill it.

    The program's study takes ``progress=wait_once_trials_are_kept``.
    """
    part = working_folder(target)
    process = subprocess.Popen([sys.executable, "-c", WAITS + program, spec, target, *arguments])
    try:
        while not list(part.glob("part-*.parquet")) and process.poll() is None:
            time.sleep(0.01)
    finally:
        process.kill()
        process.wait()
    assert not target.exists()

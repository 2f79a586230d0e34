"""LeRobot's own library, in an environment of its own: it needs PyTorch and other versions of what is here."""

import os
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PYTHON = Path(os.environ.get("DQCONTROL_LEROBOT") or ROOT / ".venv-lerobot/bin/python")


@pytest.fixture
def lerobot(tmp_path):
    """Return a function that runs a program, or a module's arguments, with LeRobot and gives what it printed."""
    if not PYTHON.is_file():
        pytest.skip(f"{PYTHON} is missing; make lerobot installs LeRobot (5 GB)")

    def run(*arguments, timeout=900):
        done = subprocess.run(
            [PYTHON, *map(str, arguments)],
            capture_output=True,
            text=True,
            timeout=timeout,
            check=False,
            cwd=tmp_path,
            env={
                "PATH": os.environ["PATH"],
                "HOME": str(tmp_path),
                "HF_HOME": str(tmp_path / "hub"),
                "HF_HUB_OFFLINE": "1",
                "PYTHONPATH": str(ROOT / "src"),
                "DQCONTROL_CACHE": os.environ.get("DQCONTROL_LEROBOT_CACHE")
                or str(ROOT / ".venv-lerobot/cache"),
            },
        )
        assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
        return done.stdout

    return run

"""What grows while a robot moves: an hour of it takes less than 10 MB of memory.

So many minutes as MINUTES in the environment says; an hour was once measured, of all three at once.
"""

import os
import sys
from pathlib import Path

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2: pip install 'dqcontrol[ros2]'")

from nodes import PATIENT

MINUTES = float(os.environ.get("MINUTES", "1"))
BEGIN = 15.0  # s until all that is taken once has been
MOST, HOUR = 10.0, 60.0  # MB, minutes


def anonymous(process):
    """Return the memory that a process has to itself, MB: not that of its files."""
    lines = Path(f"/proc/{process.pid}/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("RssAnon")) / 1024


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_an_hour_of_moving_takes_less_than_ten_megabytes(spec, start, node, tmp_path):
    seconds = 60.0 * MINUTES + 60.0
    circle = {"kind": "circle", "radius": 0.05, "duration": seconds, "turns": max(round(seconds / 6), 1)}
    path = spec(reference=circle)
    running = {"robot": start("robot", path)}
    words = ("--autostart", "--out", tmp_path / "controller", *PATIENT)
    running["controller"] = start("controller", path, *words, until="active")
    program = [sys.executable, "-u", "-m", "dqcontrol", "run"]
    running["real-time run"] = start(path, "--real-time", "--out", tmp_path / "run", program=program)
    node.serve(seconds=BEGIN)
    before = {name: anonymous(one) for name, one in running.items()}
    node.serve(seconds=60.0 * MINUTES)
    growth = {name: anonymous(one) - before[name] for name, one in running.items()}
    print(", ".join(f"{name} {grown:.2f} MB" for name, grown in growth.items()), f"in {MINUTES:g} min")
    assert all(one.poll() is None for one in running.values())
    assert max(growth.values()) < MOST * max(MINUTES / HOUR, 0.1)

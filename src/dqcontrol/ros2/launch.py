"""Starts a controller and a simulated robot as processes of their own, and ends them together."""

from __future__ import annotations

import ctypes
import signal
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import yaml

from dqcontrol.loop.clock import allows_real_time
from dqcontrol.loop.interrupts import counted_interrupts

_PRIORITY = 20  # of both processes, where that is allowed: their work is a tenth of their periods
_SET_DEATH_SIGNAL = 1  # PR_SET_PDEATHSIG of prctl(2)
_LOOK = 0.2  # s between two looks at whether a user wants it to end


def launch_pair(
    spec: Mapping[str, Any],
    robot: Sequence[str],
    controller: Sequence[str],
    ros_arguments: Sequence[str] = (),
) -> int:
    """Run a robot and its controller until one ends; return the controller's exit code.

    Parameters
    ----------
    spec
        Of both, of one run.
    robot, controller
        Their options on the command line.
    ros_arguments
        What ROS is told by both.
    """
    priority = ["--priority", str(_PRIORITY)] if allows_real_time(_PRIORITY) else []
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"{spec['name']}.yaml"
        path.write_text(yaml.safe_dump(dict(spec), allow_unicode=True), encoding="utf-8")
        last = ["--", *ros_arguments] if ros_arguments else []
        return _run(
            [
                ["robot", str(path), *priority, *robot, *last],
                ["controller", str(path), *priority, "--autostart", *controller, *last],
            ]
        )


def _run(lines: Sequence[Sequence[str]]) -> int:
    """Run robot and controller until one ends, or the user wants it; return the exit code of what failed."""
    with counted_interrupts() as interrupts:
        interrupts.only_count()
        running = [  # in sessions of their own: Ctrl-C is for this process, which ends them in order
            subprocess.Popen(
                [sys.executable, "-m", "dqcontrol", "ros2", *words],
                start_new_session=True,
                preexec_fn=end_with_parent,
            )
            for words in lines
        ]
        robot, controller = running
        told = 0
        try:
            while controller.poll() is None and robot.poll() is None:
                if told < interrupts.count:
                    told += 1
                    controller.terminate()  # not SIGINT, which processes in the background ignore while they start
                with suppress(subprocess.TimeoutExpired):
                    controller.wait(_LOOK)
            survived = robot.poll() is None
        finally:
            for process in (controller, robot):
                process.terminate()
                process.wait()
        code = controller.returncode or (0 if survived else robot.returncode)
        return code if code >= 0 else 128 - code


def end_with_parent() -> None:
    """Ask for SIGHUP when the launching process is killed, on Linux: no robot moves on with nobody to stop it.

    Not for SIGTERM: it comes once for each thread of that process, and a second SIGTERM breaks off what the first stops
    softly. The process needs a session of its own, which no terminal hangs up, as a launcher under ``nohup`` ignores.
    """
    if sys.platform == "linux":
        signal.signal(signal.SIGHUP, signal.SIG_DFL)
        with suppress(OSError, AttributeError):  # a C library without it
            ctypes.CDLL(None).prctl(_SET_DEATH_SIGNAL, signal.SIGHUP)

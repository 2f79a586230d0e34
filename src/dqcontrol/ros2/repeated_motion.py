"""Motions on the robot behind ROS 2 topics, one after the other, with a slow way back to the start after each."""

from __future__ import annotations

import ctypes
import signal
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import yaml

from dqcontrol.arrays import Array
from dqcontrol.errors import Error
from dqcontrol.experiments.prepared_experiment import prepare
from dqcontrol.files.output_file import yaml_text
from dqcontrol.logs.servos.excitation import write_joint_motion
from dqcontrol.loop import Record, Signal, has_failed
from dqcontrol.loop.clock import allows_real_time
from dqcontrol.loop.control import reference_time
from dqcontrol.loop.interrupts import counted_interrupts
from dqcontrol.recording import load_record
from dqcontrol.references.points import DUAL_QUATERNION
from dqcontrol.references.sample import TIME
from dqcontrol.references.straight import PEAK_SPEED, progress
from dqcontrol.robots import Robot
from dqcontrol.ros2.loading import load_simulated
from dqcontrol.ros2.tracked_hand import TRACKED, read_tracked
from dqcontrol.tuning.learnt_motion import TRACKED_POSE, write_motion

if TYPE_CHECKING:
    from dqcontrol.references import Points
    from dqcontrol.tuning.spec_blocks import LearnProblem


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
        robot, controller = (_started(words) for words in lines)
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


def _started(words: Sequence[str], **pipes: Any) -> subprocess.Popen[str]:
    """Start a node in a session of its own: Ctrl-C is for this process, which ends its nodes in order and softly."""
    command = [sys.executable, "-m", "dqcontrol", "ros2", *words]
    return subprocess.Popen(command, text=True, start_new_session=True, preexec_fn=end_with_parent, **pipes)


def end_with_parent() -> None:
    """Ask for SIGHUP when the launching process is killed, on Linux: no robot moves on with nobody to stop it.

    Not for SIGTERM: it comes once for each thread of that process, and a second SIGTERM breaks off what the first stops
    softly. The process needs a session of its own, which no terminal hangs up, as a launcher under ``nohup`` ignores.
    """
    if sys.platform == "linux":
        signal.signal(signal.SIGHUP, signal.SIG_DFL)
        with suppress(OSError, AttributeError):  # a C library without it
            ctypes.CDLL(None).prctl(_SET_DEATH_SIGNAL, signal.SIGHUP)


Interface = Literal["velocity", "position", "trajectory"]

_SLOW = 0.15  # of the joints' speed limits, at most, on the way back
_LEAST, _REST = 2.0, 1.0  # s of the way back, and of the rest behind it
_GAIN = 2.0  # 1/s, towards the start
_UNKNOWN_SPEED = 1.0  # rad/s or m/s of joints without a limit


class RobotBehindTopics:
    """What `dqcontrol.learn` takes as its ``runner``: controllers in processes of their own drive the robot.

    Each motion is one `dqcontrol ros2 controller` with the spec's law and supervisor; a last one takes the joints back
    to the spec's start on minimum-jerk motions, at most at 0.15 of their speed limits.

    Parameters
    ----------
    folder
        Takes a folder for each motion, with its spec and recording.
    interface
        What commands are: ``"velocity"``, ``"position"`` or ``"trajectory"``.
    network
        Do not keep to the loopback.
    ros_arguments
        What follows ``--`` on the command line, for all controllers.
    """

    def __init__(
        self,
        folder: Path,
        interface: Interface = "velocity",
        *,
        network: bool = False,
        ros_arguments: Sequence[str] = (),
    ) -> None:
        self._folder = folder.resolve()
        self._options = ["--interface", interface, *(["--network"] if network else [])]
        self._last = ["--", *ros_arguments] if ros_arguments else []

    def __call__(self, problem: LearnProblem, motion: Points | None, number: int) -> Record:
        """Run a motion and go back; return what the controller recorded.

        Raises
        ------
        Error
            If a controller stopped the robot, or found none.
        """
        folder = self._folder / f"repeat-{number}"
        folder.mkdir(parents=True, exist_ok=True)
        data = dict(problem.data)
        if motion is not None:
            write_motion(folder / "motion.csv", motion, ())
            data["reference"] = problem.points(folder / "motion.csv")
        spec = folder / "spec.yaml"
        spec.write_text(yaml_text(data), encoding="utf-8")
        tracked = problem.block.measured_by == "tracker"
        seeing = ["--tracker", problem.block.tracker.topic] if tracked else []
        record = self._driven(spec, folder / "run", *seeing)
        if not has_failed(record.stopped):
            self._go_back(problem, record.measured[-1], folder)
        desired = record.desired.copy()
        desired[:, TIME] = reference_time(record.time, load_simulated(spec).longest_advance)
        record = replace(record, desired=desired)
        if tracked:
            poses = read_tracked(folder / "run" / TRACKED, record.time)
            signal = Signal(TRACKED_POSE, DUAL_QUATERNION, ("",) * 8, poses)
            record = replace(record, readings={**record.readings, TRACKED_POSE: signal})
        return record

    def _go_back(self, problem: LearnProblem, now: Array, folder: Path) -> None:
        """Take the joints from where they are to the spec's start, slowly."""
        setting = prepare(problem.data)
        robot, start, period = setting.scene.robot, setting.scene.start, problem.spec.period
        duration = max(slow_time(robot, now, start), problem.block.return_time or 0.0)
        time = period * np.arange(int(np.ceil((duration + _REST) / period)) + 1, dtype=np.float64)
        share: Array = np.clip(time / duration, 0.0, 1.0)[:, None]
        positions = now + progress(share) * (start - now)
        more: dict[str, Any] = {key: problem.data[key] for key in ("supervisor",) if key in problem.data}
        plant = problem.data.get("plant") or {"kind": "servo"}
        back = folder / "back"
        back.mkdir(exist_ok=True)
        note = "Back to where the next repeat starts."
        write_joint_motion(back / "back.yaml", robot, time, positions, now, plant, note, _GAIN, more)
        self._driven(back / "back.yaml", back / "run")

    def _driven(self, spec: Path, folder: Path, *options: str) -> Record:
        """Let a controller drive the robot as a spec says, and return its recording."""
        words = [
            "controller",
            str(spec),
            *self._options,
            "--autostart",
            "--out",
            str(folder),
            "--force",
            *options,
        ]
        process = _started([*words, *self._last], stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
        try:
            log, _ = process.communicate()
        finally:
            if process.poll() is None:  # interrupted: it stops the robot softly first
                process.terminate()
                process.wait()
        if process.returncode:
            last = next((line for line in reversed(log.splitlines()) if line.strip()), "it said nothing")
            raise Error(f"ros2 controller {spec.name}: {last}")
        return load_record(folder / "record.mcap")


def slow_time(robot: Robot, begin: Array, end: Array) -> float:
    """Return in which time a minimum-jerk motion of the joints keeps well below their speed limits, s."""
    speeds = robot.limits.velocity
    speeds = np.where(np.isfinite(speeds), speeds, _UNKNOWN_SPEED)
    return max(float(np.max(PEAK_SPEED * np.abs(end - begin) / (_SLOW * speeds))), _LEAST)

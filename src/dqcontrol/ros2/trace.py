"""What a controller measured and commanded, as a run like any other."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dqcontrol.errors import Error
from dqcontrol.experiments.run import Run
from dqcontrol.loop import Record
from dqcontrol.references.sample import TIME
from dqcontrol.ros2.loading import Loaded

Array = NDArray[np.float64]


class Tracer:
    """Keeps what happened at each sample."""

    def __init__(self) -> None:
        self._rows: list[tuple[float, Array, Array, Array]] = []

    def take(self, time: float, measured: Array, command: Array, desired: Array) -> None:
        """Keep a sample: time since the start in s, joints (n,), inputs (m,), desired motion (21,)."""
        if not self._rows or time > self._rows[-1][0]:
            self._rows.append((time, measured.copy(), command.copy(), desired.copy()))

    def run(self, loaded: Loaded, stopped: str) -> Run:
        """Return the samples as a run.

        Raises
        ------
        Error
            If there are none.
        """
        if not self._rows:
            raise Error("ros2: the controller was never active, so there is nothing to save")
        time, measured, command, desired = (np.array(column) for column in zip(*self._rows, strict=True))
        desired[:, TIME] = time
        robot = loaded.robot
        record = Record(
            time=time,
            q=measured,
            measured=measured,
            command=command,
            pose=robot.fkm(measured),
            desired=desired,
            joint_names=robot.joint_names,
            input_names=robot.input_names,
            stopped=stopped,
        )
        text = loaded.setting.single_text(loaded.case, 0)
        return Run(text, robot, record, loaded.setting.spec.settle, "ROS 2", "measured")

"""Recording of a controller's measurements and commands while the robot moves; in the end a run like any other."""

from __future__ import annotations

import math
import sys
import threading
from collections.abc import Callable
from pathlib import Path

from dqcontrol.errors import Error
from dqcontrol.experiments.real_time import StreamedRun
from dqcontrol.experiments.run import Run
from dqcontrol.loop.control import Control, Phase
from dqcontrol.loop.record import Record
from dqcontrol.loop.supervision import BlackBox
from dqcontrol.recording import RecordStream, load_record
from dqcontrol.ros2.loading import Loaded

_SWITCH = 1e-4  # s: how long writing a black box may keep the loop from holding the robot


class Recorder:
    """Streams each motion of a controller to a run's folder.

    Parameters
    ----------
    folder
        A new folder.
    loaded
        The spec.
    force
        Replace the folder, if it holds an earlier run.

    Raises
    ------
    ExistsError
        If the folder exists (and is not an earlier run, with ``force``).
    """

    def __init__(self, folder: Path, loaded: Loaded, *, force: bool = False) -> None:
        self._loaded = loaded
        text = loaded.setting.single_text(loaded.case, 0)
        self._streamed = StreamedRun(folder, loaded.robot, text, force=force)
        self._stream: RecordStream | None = None
        self._is_open, self._last = False, -math.inf
        self._lost: Error | None = None
        self._keeping: threading.Thread | None = None

    def start(self) -> None:
        """Begin the recording of a motion; that of an earlier one stays beside it.

        Raises
        ------
        Error
            If it cannot be written.
        """
        self._wait()
        if not self._is_open:  # or the last start failed
            self._stream, self._last, self._is_open = self._streamed.record(), -math.inf, True
            self._lost = None

    def take(self, control: Control, time: float) -> None:
        """Record the controller's last step, at a time since the start, s; what comes after the reference is left out.

        Messages give the times, so one may not be later than the last; the reference's time waits where they jump.
        """
        is_new = time > self._last and not control.target.is_over(control.time)
        if self._stream and self._is_open and is_new:
            self._last = time
            control.record(self._stream, time, control.measured)

    def end(self, phase: Phase, outcome: str) -> None:
        """Close the recording of a motion that ended in a phase, for a reason."""
        if self._stream and self._is_open:
            self._is_open = False
            halted = f"halted at {max(self._last, 0.0):g} s: " if phase is Phase.STOPPED else ""
            try:
                self._stream.close(halted + outcome)
            except Error as error:
                self._lost = error  # `save` says it

    def keep(self, black_box: BlackBox, stopped: str, tell: Callable[[str], object]) -> None:
        """Write the last seconds before a stop beside the recording, in a thread: it takes up to some seconds.

        Parameters
        ----------
        black_box
            Of the controller.
        stopped
            Why the robot stopped.
        tell
            Called from the thread with where they are, or why they cannot be written.
        """
        self._wait()
        if self._stream and len(black_box):
            words = (black_box.record(stopped), tell)
            self._keeping = threading.Thread(target=self._write, args=words, name="black box")
            self._keeping.start()

    def _write(self, last_seconds: Record, tell: Callable[[str], object]) -> None:
        switch = sys.getswitchinterval()
        sys.setswitchinterval(_SWITCH)
        try:
            tell(f"the last seconds: {self._streamed.keep(last_seconds)}")
        except Error as error:
            tell(f"the last seconds before the stop are lost: {error}")
        finally:
            sys.setswitchinterval(switch)

    def _wait(self) -> None:
        """Wait until the last seconds before a stop are written."""
        if self._keeping:
            self._keeping.join()
            self._keeping = None

    def save(self) -> Path:
        """Judge the last motion by what was measured, and return the folder with all that a run has.

        Raises
        ------
        Error
            If there was none, or its recording could not be written.
        """
        self._wait()
        if not self._stream or self._last < 0:
            raise Error("ros2: the controller was never active, so there is nothing to save")
        if self._lost:
            raise self._lost
        loaded, record = self._loaded, load_record(self._stream.path)
        text = loaded.setting.single_text(loaded.case, 0)
        run = Run(text, loaded.robot, record, loaded.setting.spec.skip_initial, "ROS 2", "measured")
        self._streamed.complete(run)
        return self._streamed.folder

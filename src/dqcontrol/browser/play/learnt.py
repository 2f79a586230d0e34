"""Learning from repetition, on the robot that somebody looks at."""

from __future__ import annotations

import tempfile
import threading
import time
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.browser.play.session import PlaySession, RecordedRows
from dqcontrol.errors import Error
from dqcontrol.loop import part_of

if TYPE_CHECKING:
    from dqcontrol.loop import Record
    from dqcontrol.references import Points
    from dqcontrol.tuning.spec_blocks import LearnProblem

_LOOK = 0.02  # s


class _EndedError(Error):
    """The robot does something else by now."""


def learn_in(session: PlaySession, repeats: int) -> threading.Thread:
    """Let the robot of a session repeat its reference, shifted by what it missed, in a thread; say how it goes.

    It ends as soon as the robot is told something else.
    """
    thread = threading.Thread(target=_learn, args=(session, repeats), name="learning", daemon=True)
    thread.start()
    return thread


def _learn(session: PlaySession, repeats: int) -> None:
    from dqcontrol.tuning import learn
    from dqcontrol.tuning.learnt_motion import write_motion

    spec = dict(session.spec)
    wanted: list[Array] = []  # positions, of the first run
    said: list[str] = []
    recorded: list[RecordedRows] = []  # by the repeat before
    with tempfile.TemporaryDirectory(prefix="dqcontrol-") as name:

        def run(problem: LearnProblem, motion: Points | None, number: int) -> Record:
            reference = spec["reference"]
            if motion is not None:
                file = Path(name) / f"repeat-{number}.csv"
                write_motion(file, motion, ())
                reference = problem.points(file)
            record = _repeat(session, {**spec, "reference": reference}, recorded)
            wanted[:] = wanted or [record.desired_position]
            count = min(len(record), len(wanted[0]))
            error = np.linalg.norm(record.position[:count] - wanted[0][:count], axis=1)
            said.append(f"{1e3 * np.sqrt(np.mean(error**2)):.1f}")
            session.tell(f"the end effector missed the path by {', '.join(said)} mm (RMS, repeat by repeat)")
            return record

        with session.trying(), suppress(_EndedError):
            learn(spec, repeats, runner=run)


def _repeat(session: PlaySession, spec: dict[str, Any], recorded: list[RecordedRows]) -> Record:
    """Let the robot follow a motion from its start; return what it did, or raise if it is told something else."""
    with session.lock:
        if recorded and session.rows is not recorded[0]:
            raise _EndedError("the robot does something else by now")
        if not session.begin(spec):
            raise _EndedError(session.told[-1])
        rows = session.rows
        recorded[:] = [rows]
        count = len(session.setting.cases[0].scene.samples)
    while len(rows) < count:
        if session.rows is not rows or session.is_closed:
            raise _EndedError("the robot does something else by now")
        time.sleep(_LOOK)
    return part_of(session.record(), 0, count)  # it goes on until this thread looks again

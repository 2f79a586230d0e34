"""The folder of a run that fills while a robot moves."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from dqcontrol.errors import Error, writing
from dqcontrol.experiments.results_folder import SPEC_FILE, added_files, check_new, new_folder, note_contents
from dqcontrol.experiments.run import Run
from dqcontrol.loop.record import Record
from dqcontrol.recording.mcap import FOLDER, save_last_seconds
from dqcontrol.recording.stream import RecordStream, prepare_to_record
from dqcontrol.robots import Robot

RECORD = "record.mcap"


class StreamedRun:
    """A folder with spec and recording from the moment the robot moves: whatever ends it, these stay.

    Parameters
    ----------
    folder
        A new folder; made with the first recording.
    robot
        Which moves.
    spec
        Text of the run's spec.
    force
        Replace the folder, if it holds an earlier run.

    Raises
    ------
    ExistsError
        If the folder exists (and is not an earlier run, with ``force``).
    """

    folder: Path

    def __init__(self, folder: str | Path, robot: Robot, spec: str, *, force: bool = False) -> None:
        check_new(folder, force=force)
        self.folder, self._robot, self._spec, self._force = Path(folder), robot, spec, force
        self._count = 0
        prepare_to_record(robot)

    @property
    def path(self) -> Path:
        """Path of the last recording."""
        return self.folder / RECORD

    def record(self) -> RecordStream:
        """Begin a recording; an earlier one stays beside it under its number.

        Raises
        ------
        Error
            If it cannot be written.
        """
        with writing(self.folder):
            if not self._count:
                with new_folder(self.folder, force=self._force) as new:
                    (new / SPEC_FILE).write_text(self._spec, encoding="utf-8")
            else:
                self.path.rename(self.folder / f"record-{self._count}.mcap")
            self._count += 1
            recording = RecordStream(self.path, self._robot, self._spec)
            note_contents(self.folder)
        return recording

    def keep(self, last_seconds: Record) -> Path:
        """Write what a black box held at a stop, and return its folder in this one.

        Raises
        ------
        Error
            If it cannot be written; it says what stopped the motion.
        """
        with _telling(last_seconds.stopped), writing(self.folder):
            kept = save_last_seconds(last_seconds, self.folder / FOLDER, self._spec)
            note_contents(self.folder)
        return kept

    def complete(self, run: Run, *, figures: bool = True) -> None:
        """Write what came of the last recording, with all that was not streamed, in its place.

        Raises
        ------
        Error
            If it cannot be written; it says what ended the motion, and the recording is still there.
        """
        with _telling(run.record.stopped), writing(self.folder), added_files(self.folder) as new:
            run.write(new, figures=figures)


@contextmanager
def _telling(stopped: str) -> Iterator[None]:
    """Say, where something cannot be written after a motion, what ended the motion: nothing else may say it."""
    try:
        yield
    except Error as error:
        raise Error(f"{error}; the recording is there, and ends with: {stopped}") from None

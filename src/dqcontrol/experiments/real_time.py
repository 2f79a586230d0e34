"""One run in real time, recorded while it moves."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from dqcontrol.errors import Error, writing
from dqcontrol.experiments import results_folder
from dqcontrol.experiments.check import warn_unstable
from dqcontrol.experiments.failure_hints import warn_of_failures
from dqcontrol.experiments.prepared_experiment import prepare
from dqcontrol.experiments.run import Run, as_run, execute
from dqcontrol.loop import Clock, Record
from dqcontrol.loop.supervision import BlackBox, Watch
from dqcontrol.recording import RecordStream
from dqcontrol.recording.mcap import FOLDER, save_last_seconds
from dqcontrol.recording.stream import broken_off, prepare_to_record
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
        results_folder.check_new(folder, force=force)
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
                with results_folder.new_folder(self.folder, force=self._force) as new:
                    (new / results_folder.SPEC_FILE).write_text(self._spec, encoding="utf-8")
            else:
                self.path.rename(self.folder / f"record-{self._count}.mcap")
            self._count += 1
            recording = RecordStream(self.path, self._robot, self._spec)
            results_folder.note_contents(self.folder)
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
            results_folder.note_contents(self.folder)
        return kept

    def complete(self, run: Run, *, figures: bool = True) -> None:
        """Write what came of the last recording, with all that was not streamed, in its place.

        Raises
        ------
        Error
            If it cannot be written; it says what ended the motion, and the recording is still there.
        """
        with (
            _telling(run.record.stopped),
            writing(self.folder),
            results_folder.added_files(self.folder) as new,
        ):
            run.write(new, figures=figures)


@contextmanager
def _telling(stopped: str) -> Iterator[None]:
    """Say, where something cannot be written after a motion, what ended the motion: nothing else may say it."""
    try:
        yield
    except Error as error:
        raise Error(f"{error}; the recording is there, and ends with: {stopped}") from None


def run_in_real_time(
    source: str | Path | dict[str, Any],
    folder: str | Path,
    *,
    force: bool = False,
    figures: bool = True,
    clock: Clock | None = None,
    watch: Watch | None = None,
    computed: Callable[[Run], None] | None = None,
) -> Run:
    """Run a spec of one run at its control period, and write its folder; the recording grows while it moves.

    Whatever ends it, the folder holds spec and recording up to there; and if it did not end by itself, the last seconds
    of a supervised robot in a folder ``black-box`` of their own.

    Parameters
    ----------
    source
        Path of a YAML file, or the same as a dictionary.
    folder
        A new folder.
    force
        Replace it, if it holds an earlier run.
    figures
        As for `Run.save`.
    clock
        One that skips missed periods if omitted.
    watch
        Called with time (s) and reasons whenever what the supervisor does changes.
    computed
        Called with the run before its figures and report are written.

    Raises
    ------
    Error
        If something is missing, malformed or does not fit, before anything moves; or the robot fails.
    """
    setting = prepare(source)
    case = setting.only_case("spec" if isinstance(source, dict) else source, "in real time there is one")
    (expected,) = warn_unstable(setting, stacklevel=2)
    clock = clock or Clock(overrun="skip")
    robot = case.scene.robot
    streamed = StreamedRun(folder, robot, setting.single_text(case, 0), force=force)
    black_box = BlackBox(robot, setting.spec.period)
    with ExitStack() as stack:
        begun: list[RecordStream] = []

        def begin() -> RecordStream:
            begun.append(stack.enter_context(streamed.record()))
            return begun[0]

        try:
            record = execute(setting, case, clock=clock, watch=watch, recording=begin, black_box=black_box)
        except BaseException as error:
            _keep(black_box, streamed, broken_off(error))
            raise
        begun[0].close(record.stopped)
    if record.stopped.startswith(("halted", "faulted", "diverged")):
        _keep(black_box, streamed, record.stopped)
    done = replace(as_run(setting, case, 0, record), timing=clock.timing, expected=expected)
    with results_folder.told_first(computed, done):
        streamed.complete(done, figures=figures)
        warn_of_failures([(case, [done.metrics.flat()])], stacklevel=2)
    return done


def _keep(black_box: BlackBox, streamed: StreamedRun, stopped: str) -> None:
    """Write what the black box holds, if a supervisor filled it."""
    if len(black_box):
        streamed.keep(black_box.record(stopped))

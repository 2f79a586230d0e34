"""One run in real time, recorded while it moves."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

from dqcontrol.experiments.check import warn_unstable
from dqcontrol.experiments.failure_hints import warn_of_failures
from dqcontrol.experiments.prepared_experiment import prepare
from dqcontrol.experiments.results_folder import told_first
from dqcontrol.experiments.run import Run, as_run, execute
from dqcontrol.experiments.streamed_run import StreamedRun
from dqcontrol.loop import Clock
from dqcontrol.loop.black_box import BlackBox
from dqcontrol.loop.supervision import Watch
from dqcontrol.recording import RecordStream


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
            _keep(black_box, streamed, f"broken off: {error or type(error).__name__}")
            raise
        begun[0].close(record.stopped)
    if record.stopped.startswith(("halted", "faulted", "diverged")):
        _keep(black_box, streamed, record.stopped)
    done = replace(as_run(setting, case, 0, record), timing=clock.timing, expected=expected)
    with told_first(computed, done):
        streamed.complete(done, figures=figures)
        warn_of_failures([(case, [done.metrics.flat()])], stacklevel=2)
    return done


def _keep(black_box: BlackBox, streamed: StreamedRun, stopped: str) -> None:
    """Write what the black box holds, if a supervisor filled it."""
    if len(black_box):
        streamed.keep(black_box.record(stopped))

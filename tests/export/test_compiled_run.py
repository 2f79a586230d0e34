"""Runs in real time whose law and supervisor step in C: recorded, watched and stopped as those in Python."""

import os
import signal
import threading

import numpy as np
import pytest
from exported import SPEC, needs_c

import dqcontrol as dqc
from dqcontrol.browser import GrowingRecording
from dqcontrol.errors import Error, ValueRangeError
from dqcontrol.experiments import load_run
from dqcontrol.export import compiled_run, run_compiled_in_real_time
from dqcontrol.export.controller_parts import controller_parts

SHORT = SPEC | {
    "duration": 0.4,
    "plant": {"kind": "servo", "time_constant": 0.05},
    "supervisor": {"stale_after": 1000.0, "ramp": 0.1},  # machines that run tests are busy
}


class Sink:
    """Takes samples as a recording does."""

    failure = ""

    def __init__(self):
        self.rows = []

    def take(self, sample, q, measured, command, interventions=0.0):
        self.rows.append([sample[-1], *command, interventions])


@needs_c
@pytest.mark.parametrize(
    "over",
    [
        pytest.param(None, marks=pytest.mark.slow),
        "udp",
        pytest.param("shared-memory", marks=pytest.mark.slow),
    ],
)
def test_the_loop_does_what_a_simulation_does(tmp_path, over):
    parts, seen, sink = controller_parts(SHORT), [], Sink()
    host = compiled_run._host(parts, compiled_run._startable_plant(parts), tmp_path, over)
    compiled_run._watched(host, sink, lambda *what: seen.append(what))
    rows = host.rows[: host.written]
    assert len(sink.rows) == len(rows.time)
    assert not rows.command[-1].any(), "it comes to rest"
    assert "soft stop" in seen[-1][1]
    simulated = dqc.run(SHORT)
    on_time = np.isclose(rows.time[:40], simulated.time[:40])
    on_time[1:] &= (np.diff(rows.q[:40], axis=0) != 0).any(axis=1)  # the robot's answer came
    same = slice(40 if on_time.all() else np.argmin(on_time))  # after that a simulation has other samples
    np.testing.assert_array_equal(rows.command[same], simulated.command[same])
    np.testing.assert_array_equal(rows.q[same], simulated.q[same])


@needs_c
@pytest.mark.slow
@pytest.mark.parametrize("over", [None, "udp", "shared-memory"])
def test_a_stop_leaves_the_last_seconds_in_a_folder_of_their_own(tmp_path, over):
    strict = SHORT["supervisor"] | {"tracking_error": 1e-4}
    run = run_compiled_in_real_time(
        SHORT | {"supervisor": strict}, tmp_path / "out", figures=False, over=over
    )
    assert "tracking error" in run.record.stopped
    kept = load_run(tmp_path / "out/black-box")
    assert kept.record.stopped == run.record.stopped
    np.testing.assert_array_equal(kept.q, run.q)


@needs_c
@pytest.mark.slow
@pytest.mark.parametrize("over", ["udp", "shared-memory"])
def test_a_robot_that_falls_silent_is_braked_and_named(tmp_path, over):
    spec = SHORT | {"duration": 6, "supervisor": {"stale_after": 0.3}}
    parts = controller_parts(spec)
    host = compiled_run._host(parts, compiled_run._startable_plant(parts), tmp_path, over)

    class Killing(Sink):
        def take(self, sample, q, measured, command, interventions=0.0):
            super().take(sample, q, measured, command, interventions)
            if len(self.rows) == 50:
                host._processes[0].kill()

    with pytest.raises(Error, match="_robot ended with -9"):
        compiled_run._watched(host, Killing(), None)
    rows = host.rows[: host.written]
    assert rows.status[-1] == 2  # stopped
    assert not rows.command[-1].any()
    assert rows.time[-1] < 6


@needs_c
@pytest.mark.slow
def test_one_that_is_broken_off_leaves_them_too(tmp_path):
    class BrokenError(Exception):
        pass

    def watch(*_):
        raise BrokenError("by its watcher")

    with pytest.raises(BrokenError):
        run_compiled_in_real_time(SHORT, tmp_path / "out", figures=False, watch=watch)
    assert load_run(tmp_path / "out/black-box").record.stopped == "broken off: by its watcher"


@needs_c
@pytest.mark.slow
def test_it_is_looked_at_while_it_moves(tmp_path):
    long, path, seen = SHORT | {"duration": 6}, tmp_path / "out/record.mcap", []

    def look():
        growing = GrowingRecording(path, dqc.load_robot(SHORT["robot"]))
        seen.append(growing.first().stopped)
        growing.close()

    looking = []

    def watch(*_):  # its first words come from the moving robot
        if not looking:
            looking.append(threading.Thread(target=look))
            looking[0].start()

    run_compiled_in_real_time(long, tmp_path / "out", figures=False, watch=watch)
    looking[0].join()
    assert seen == [""], "it runs while samples are there"


@needs_c
@pytest.mark.slow
def test_it_is_recorded_as_any_run(tmp_path):
    seen = []
    run = run_compiled_in_real_time(SHORT, tmp_path / "out", watch=lambda *what: seen.append(what))
    assert run.record.stopped == "duration"
    assert not run.command[-1].any(), "it comes to rest"
    assert "soft stop" in seen[-1][1]
    loaded = load_run(tmp_path / "out")
    np.testing.assert_array_equal(loaded.q, run.q)
    assert {"timing.png", "report.html"} <= {path.name for path in (tmp_path / "out").iterdir()}


@needs_c
@pytest.mark.slow
@pytest.mark.parametrize("over", [None, "udp"])
def test_an_interrupt_stops_softly(tmp_path, over):
    sent = []

    def send(*_):
        if not sent:
            sent.append(threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGINT)))
            sent[0].start()

    slow = SHORT["supervisor"] | {"velocity": 0.005}
    long = SHORT | {"duration": 12, "supervisor": slow}
    run = run_compiled_in_real_time(long, tmp_path / "out", watch=send, over=over)
    assert run.record.duration < 6
    assert not run.command[-1].any()


def test_plants_that_do_not_step_in_c_are_refused(tmp_path):
    with pytest.raises(
        ValueRangeError, match=r"^plant: 'mujoco' does not step in C; with --compiled use servo"
    ):
        run_compiled_in_real_time(SHORT | {"plant": {"kind": "mujoco"}}, tmp_path / "out")
    assert not (tmp_path / "out").exists()

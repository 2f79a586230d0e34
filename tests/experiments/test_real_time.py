"""A run in real time: its folder grows while it moves, and stays whatever happens; Ctrl-C stops softly."""

import gc
import os
import signal
import sys
import threading
import time
from contextlib import contextmanager

import numpy as np
import pytest
import yaml

from dqcontrol import cli
from dqcontrol.compiled import compile
from dqcontrol.errors import Error, ExistsError, ShapeError
from dqcontrol.experiments import load_run, run_in_real_time
from dqcontrol.experiments.real_time import StreamedRun
from dqcontrol.loop import Clock
from dqcontrol.measures.task_range import RANGE
from dqcontrol.plants import CompiledPlant
from dqcontrol.recording import load_record
from dqcontrol.robots import load_robot

SPEC = {
    "name": "tiny",
    "robot": "iiwa7",
    "start": [0, 0.6, 0, 1.6, 0, 0.6, 0],
    "period": 0.01,
    "reference": {"kind": "circle", "radius": 0.05, "duration": 0.8},
    "law": {"kind": "proportional", "gain": 5},
    "plant": {"kind": "servo"},
    "supervisor": {"velocity": 0.1, "stale_after": 1000.0},  # machines that run tests are busy
}


@pytest.mark.slow
@pytest.mark.usefixtures("few_figures")
def test_the_folder_of_a_run_with_its_timing(tmp_path):
    seen, begin = [], time.monotonic()
    run = run_in_real_time(SPEC, tmp_path / "out", watch=lambda *what: seen.append(what))
    assert time.monotonic() - begin >= 0.8
    assert run.timing is not None
    assert len(run.timing.begin) == len(run.record) == 82, "81 samples, and one that brakes"
    assert not run.command[-1].any()
    assert seen[0][0] < 0.5
    assert "velocity limit" in seen[0][1]
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert {"spec.yaml", "record.mcap", "metrics.json", "report.html"} <= names
    assert "streamed.mcap" not in names
    report = (tmp_path / "out/report.html").read_text()
    assert f"{run.timing.overruns} began late, {run.timing.missed} periods missed" in report
    assert '<figure id="timing">' in report
    loaded = load_run(tmp_path / "out")
    assert np.array_equal(loaded.q, run.q)
    assert loaded.record.stopped == "duration"
    with pytest.raises(ExistsError):
        run_in_real_time(SPEC, tmp_path / "out")
    with pytest.raises(
        ShapeError, match=r"^spec: describes several runs \(2 repeats\); in real time there is one$"
    ):
        run_in_real_time(SPEC | {"repeats": 2}, tmp_path / "other")
    assert not (tmp_path / "other").exists()


@pytest.mark.parametrize("first", [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.slow)])
def test_an_interrupt_stops_softly(tmp_path, first):
    slow = {"supervisor": {"velocity": 0.005, "stale_after": 1000.0}}
    long = SPEC | slow | {"reference": SPEC["reference"] | {"duration": 30}}
    before = signal.getsignal(first)
    sent = []

    def send(*_):
        if not sent:
            sent.append(threading.Timer(0.3, os.kill, (os.getpid(), first)))
            sent[0].start()

    run = run_in_real_time(long, tmp_path / "out", figures=False, watch=send)
    assert signal.getsignal(first) is before
    assert run.record.stopped.endswith("soft stop")
    assert len(run.record) < 3001
    assert np.abs(np.diff(run.command, axis=0)).max() <= 10.0 * 0.01 * (1 + 1e-9)
    assert not run.command[-1].any()


def test_a_robot_that_fails_leaves_what_was_recorded(tmp_path, monkeypatch):
    step, calls = CompiledPlant.step, []

    def failing(self, command):
        calls.append(command)
        if len(calls) > 40:
            raise Error("plant: the robot does not answer")
        step(self, command)

    monkeypatch.setattr(CompiledPlant, "step", failing)
    with pytest.raises(Error, match="does not answer"):
        run_in_real_time(SPEC, tmp_path / "out")
    record = load_record(tmp_path / "out/record.mcap")
    assert len(record) == 42
    assert not record.command[-1].any(), "at rest before the error is raised"
    box = load_run(tmp_path / "out/black-box")
    assert np.array_equal(box.command, record.command)
    assert box.record.stopped == "broken off: plant: the robot does not answer"
    assert record.stopped == "broken off: plant: the robot does not answer"
    assert (tmp_path / "out/spec.yaml").is_file()


@pytest.mark.slow
def test_of_a_mobile_robot_the_range_condition_is_recorded_too(tmp_path):
    circle = SPEC["reference"] | {"duration": 0.1}
    mobile = SPEC | {"robot": "little-john", "start": [0, 0, 0, 0, -0.9, 0.9, 0.9, 0], "reference": circle}
    run_in_real_time(mobile | {"plant": {"kind": "integrator"}}, tmp_path / "out", figures=False)
    assert RANGE in load_run(tmp_path / "out").record.readings


class Watching(Clock):
    """A clock that knows whether it is running."""

    is_running = False

    @contextmanager
    def running(self, period, steps):
        with super().running(period, steps):
            self.is_running = True
            yield
        self.is_running = False


@pytest.mark.slow
@pytest.mark.parametrize("plant", ["servo", "compliant", "mobile"])
def test_nothing_is_compiled_or_loaded_while_the_robot_moves(tmp_path, monkeypatch, plant):
    """As in a process that has used no kernel yet; compiling one takes a second, even loading one is several ms."""
    for kernel in [thing for thing in gc.get_objects() if type(thing) is compile.Kernel]:
        for made in ("compiled", "pointer"):
            monkeypatch.delitem(kernel.__dict__, made, raising=False)
    clock, late, make = Watching(overrun="skip"), [], compile._compile

    def spy(function, *how):
        if clock.is_running:
            late.append(function.__qualname__)
        return make(function, *how)

    monkeypatch.setattr(compile, "_compile", spy)
    spec = SPEC | {"plant": {"kind": plant}, "reference": SPEC["reference"] | {"duration": 0.5}}
    if plant == "mobile":
        spec |= {"robot": "little-john", "start": [0, 0, 0, 0, -0.9, 0.9, 0.9, 0]}
    run_in_real_time(spec, tmp_path / "out", figures=False, clock=clock)
    assert late == []


def test_killed_a_folder_may_be_replaced_when_asked(tmp_path):
    robot = load_robot("iiwa7")
    killed = StreamedRun(tmp_path / "out", robot, "name: killed")
    recording = killed.record()
    with pytest.raises(ExistsError, match="--force"):
        StreamedRun(tmp_path / "out", robot, "")
    StreamedRun(tmp_path / "out", robot, "", force=True)
    recording.close()


@pytest.mark.slow
def test_from_the_command_line(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "spec.yaml").write_text(yaml.safe_dump(SPEC))
    monkeypatch.setattr(sys, "argv", ["dqcontrol", "run", "spec.yaml", "--real-time", "--no-figures"])
    with pytest.raises(SystemExit) as end:  # the supervisor's velocity limit keeps it from the goal
        cli.main()
    assert end.value.code == 1
    said = capsys.readouterr()
    assert said.out.startswith("held by the supervisor: velocity limit for ")
    assert "<img" not in (tmp_path / "results/tiny/report.html").read_text()
    assert "82 steps of 10 ms:" in said.out
    assert "periods missed" in said.out
    assert said.out.splitlines()[1] == "results: results/tiny"
    assert said.out.endswith("ended: duration\n")
    assert "s: " in said.err
    assert "velocity limit" in said.err

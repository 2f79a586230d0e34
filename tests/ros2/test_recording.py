"""The recording of a controller's motion: watched while it grows, killed, and on a full disk."""

import errno
import resource
import signal
import time

import numpy as np
import pytest
from msgspec.structs import replace

pytest.importorskip("rclpy", reason="needs ROS 2: pip install 'dqcontrol[ros2]'")

from nodes import PATIENCE, PATIENT

from dqcontrol.browser import growing_recording
from dqcontrol.cli.result_commands import _follow, _take_news
from dqcontrol.errors import Error
from dqcontrol.experiments import load_run
from dqcontrol.experiments.run import Run
from dqcontrol.loop.control import Control, Phase, reference_time
from dqcontrol.recording import load_record
from dqcontrol.ros2.loading import load
from dqcontrol.ros2.recorder import Recorder
from dqcontrol.supervisor import list_interventions

CIRCLE = {"kind": "circle", "radius": 0.05, "duration": 30.0, "turns": 10}


@pytest.mark.slow
def test_a_loop_is_watched_while_it_goes_on_and_killed_it_leaves_what_was_seen(spec, start, tmp_path):
    out, path = tmp_path / "out", spec(reference=CIRCLE)
    start("robot", path)
    controller = start("controller", path, "--autostart", "--out", out, *PATIENT, until="active")
    tracks = []
    following = _follow(growing_recording(out), "loop", tracks)
    growing, track = following
    for _ in range(4):
        before, end = len(track.record), time.monotonic() + PATIENCE
        while len(track.record) == before:
            assert time.monotonic() < end
            assert _take_news([following], None)
            time.sleep(0.02)
    controller.send_signal(signal.SIGKILL)
    controller.wait()
    growing.close()
    record = load_run(out).record
    assert record.time[-1] >= track.record.time[-1]
    assert record.stopped.startswith("cut off at")


@pytest.mark.slow
def test_a_full_disk_stops_a_process_and_its_last_line_says_so(spec, start, tmp_path):
    out, path = tmp_path / "out", spec(reference=CIRCLE)
    start("robot", path)
    # room for the head and the chunk of a second, 50 kB
    controller = start("controller", path, "--autostart", "--out", out, *PATIENT, file_limit=80_000)
    log, _ = controller.communicate(timeout=PATIENCE)
    assert "stopped: stop category 1: emergency stop: the recording cannot be written: File too large" in log
    assert (
        log.splitlines()[-1]
        == f"dqcontrol: {out}/record.mcap: the recording cannot be written: File too large"
    )
    assert len(load_record(out / "record.mcap")) > 20


@pytest.fixture
def moved(spec, tmp_path):
    """Return what moves a robot that obeys at once, with control and recorder, until it has stopped for some reason."""
    loaded = load(spec(reference=CIRCLE))
    control = Control(
        loaded.prepared_law("spec"), loaded.target("spec"), loaded.prepared_supervisor("velocity")
    )
    recorder, start = Recorder(tmp_path / "out", loaded), loaded.case.scene.start

    def move(act):
        recorder.start()
        control.activate(start)
        for k in range(3000):
            act(k)
            control.step(0.01 * k, control.position.copy(), 0.0)
            recorder.take(control, 0.01 * (k - k % 2))  # messages may say the same time twice
            if control.phase in (Phase.INACTIVE, Phase.STOPPED):
                recorder.end(control.phase, control.reason)
                return
        raise AssertionError("it never stopped")

    return move, control, recorder


def test_a_recording_of_late_messages_tells_how_far_the_reference_was(spec, tmp_path):
    """The reference waits for messages that come late; from the recorded times alone it is known where it was."""
    loaded = load(spec(reference=CIRCLE))
    patient = replace(loaded.supervisor, stale_after=10.0)
    loaded.supervisor, draw, time, seen = patient, np.random.default_rng(4), 0.0, []
    control = Control(
        loaded.prepared_law("spec"), loaded.target("spec"), loaded.prepared_supervisor("velocity")
    )
    recorder = Recorder(tmp_path / "out", loaded)
    recorder.start()
    control.activate(loaded.case.scene.start)
    for _ in range(200):
        control.step(time, control.position.copy(), 0.0)
        recorder.take(control, time)
        seen.append(control.time)
        time += 0.01 * draw.choice([0.5, 1.0, 1.0, 6.0])
    recorder.end(Phase.INACTIVE, "duration")
    recorded = load_record(tmp_path / "out" / "record.mcap").time
    assert seen[-1] < 0.8 * recorded[-1]
    assert np.abs(reference_time(recorded, 0.015) - seen).max() < 1e-9


def test_what_stopped_a_motion_is_in_its_recording_and_an_earlier_motion_stays_beside_it(moved, tmp_path):
    move, control, recorder = moved
    with pytest.raises(Error, match="never active"):
        recorder.save()
    move(lambda k: k == 30 and control.deactivate())
    move(lambda k: k == 30 and control.emergency_stop())
    record, first = (load_record(tmp_path / "out" / f"{name}.mcap") for name in ("record", "record-1"))
    assert first.stopped == "soft stop"
    assert record.stopped == f"halted at {record.time[-1]:g} s: emergency stop"
    told = list_interventions(record.time, record.readings["interventions"].values)
    assert told[-1] == (0.3, record.time[-1], "emergency stop")


def test_a_full_disk_stops_a_motion(moved, tmp_path):
    move, control, recorder = moved
    move(lambda k: k == 30 and control.deactivate())  # what it compiles is kept before the disk is full

    def wait(k):
        if k == 600:  # more than fits
            recorder._stream._thread.join(PATIENCE)

    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (40_000, hard))
        move(wait)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert control.stop == (
        "stop category 1: emergency stop: the recording cannot be written: File too large"
    )
    with pytest.raises(Error) as caught:
        recorder.save()
    path = tmp_path / "out" / "record.mcap"
    assert str(caught.value) == f"{path}: the recording cannot be written: File too large"
    assert len(load_record(path)) > 20


def test_what_stopped_a_motion_is_said_even_if_the_disk_is_full_in_the_end(moved, tmp_path, monkeypatch):
    move, control, recorder = moved

    def write(_run, _folder, **_options):
        raise OSError(errno.ENOSPC, "No space left on device")

    move(lambda k: k == 30 and control.emergency_stop())
    monkeypatch.setattr(Run, "write", write)
    with pytest.raises(Error) as caught:
        recorder.save()
    halted = load_record(tmp_path / "out" / "record.mcap").stopped
    assert str(caught.value) == (
        f"{tmp_path / 'out'}: cannot be written: No space left on device; "
        f"the recording is there, and ends with: {halted}"
    )
    assert halted.endswith("emergency stop")

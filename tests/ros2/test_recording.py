"""The recording of a controller's motion: watched while it grows, killed, and on a full disk."""

import signal
import time

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2: pip install 'dqcontrol[ros2]'")

from conftest import PATIENCE, PATIENT

from dqcontrol.browser import growing_recording
from dqcontrol.cli.view_command import _follow, _take_news
from dqcontrol.errors import Error
from dqcontrol.experiments import load_run
from dqcontrol.limits import list_interventions
from dqcontrol.loop.control import Control, Phase
from dqcontrol.recording import load_record
from dqcontrol.ros2.loading import load
from dqcontrol.ros2.recorder import Recorder

CIRCLE = {"kind": "circle", "radius": 0.05, "duration": 30.0, "turns": 10}


def test_a_loop_is_watched_while_it_goes_on_killed_it_leaves_all_but_a_second_and_a_full_disk_stops_it(
    spec, start, tmp_path
):
    out, path = tmp_path / "out", spec(reference=CIRCLE)
    start("robot", path)
    controller = start("controller", path, "--autostart", "--out", out, *PATIENT, until="active")
    active, tracks = time.monotonic(), []
    following = _follow(growing_recording(out), "loop", tracks)
    growing, track = following
    for _ in range(4):
        before, end = len(track.record), time.monotonic() + PATIENCE
        while len(track.record) == before:
            assert time.monotonic() < end
            assert _take_news([following], None)
            time.sleep(0.02)
    assert time.monotonic() - active - track.record.time[-1] < 3.0  # a second on a quiet machine
    controller.send_signal(signal.SIGKILL)
    killed = time.monotonic() - active
    controller.wait()
    growing.close()
    record = load_run(out).record
    assert record.time[-1] > killed - 3.0  # a second, and what a machine full of tests is late
    assert record.stopped.startswith("cut off at")
    assert record.position_error.max() < 0.05

    words = (
        "controller",
        path,
        "--autostart",
        "--out",
        out,
        "--force",
        *PATIENT,
        "-p",
        "start_tolerance:=1.0",
    )
    log, _ = start(*words, file_limit=40_000).communicate(timeout=PATIENCE)
    assert "stopped: stop category 1: emergency stop: the recording cannot be written: File too large" in log
    assert log.splitlines()[-1] == (
        f"dqcontrol: {out}/record.mcap: the recording cannot be written: File too large"
    )
    assert 20 < len(load_record(out / "record.mcap")) != len(record)


def test_what_stopped_a_motion_is_in_its_recording_and_an_earlier_motion_stays_beside_it(spec, tmp_path):
    loaded = load(spec(reference=CIRCLE))
    control = Control(
        loaded.prepared_law("spec"), loaded.target("spec"), loaded.prepared_supervisor("velocity")
    )
    recorder, start = Recorder(tmp_path / "out", loaded), loaded.case.scene.start
    with pytest.raises(Error, match="never active"):
        recorder.save()
    for motion in (1, 2):
        recorder.start()
        control.activate(start)
        for k in range(200):
            if k == 30 and motion == 1:
                control.deactivate()
            elif k == 30:
                control.emergency_stop()
            control.step(0.01 * k, control.position.copy(), 0.0)  # as a robot that obeys at once
            recorder.take(control, 0.01 * (k - k % 2))  # messages may say the same time twice
            if control.phase in (Phase.INACTIVE, Phase.STOPPED):
                break
        recorder.end(control.phase, control.reason)
    record, first = (load_record(tmp_path / "out" / f"{name}.mcap") for name in ("record", "record-1"))
    assert first.stopped == "soft stop"
    assert record.stopped == f"halted at {record.time[-1]:g} s: emergency stop"
    told = list_interventions(record.time, record.readings["interventions"].values)
    assert told[-1] == (0.3, record.time[-1], "emergency stop")

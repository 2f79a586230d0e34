"""Recordings written while the robot moves: equal to the saved ones, killed, on a full disk."""

import resource
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.errors import Error, ExistsError, FileFormatError
from dqcontrol.loop.simulate import simulate_prepared
from dqcontrol.recording import RecordStream, load_record

Q0 = np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])
T = 0.01

DRIVE = """
import resource, sys
import numpy as np, dqcontrol as dqc
from dqcontrol.supervisor import Supervisor
from dqcontrol.loop import Clock
from dqcontrol.recording import RecordStream
from dqcontrol.loop.simulate import simulate_prepared

path, seconds, limit = sys.argv[1], float(sys.argv[2]), int(sys.argv[3])
arm, q = dqc.load_robot("iiwa7"), np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])
circle = dqc.references.Circle(arm.fkm(q), radius=0.05, duration=4.0)
law = dqc.laws.ProportionalFeedforward(gain=10.0).prepare(arm, circle, 0.005)
samples = circle.samples(0.005 * np.arange(round(seconds / 0.005)))
recording = RecordStream(path, arm, "name: killed")
if limit:
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
record = simulate_prepared(law, dqc.plants.Servo(), q, samples, supervisor=Supervisor(stale_after=1000.0),
    clock=Clock(), recording=lambda: recording,
    progress=lambda done, count: print(samples[done - 1, -1], flush=True))
print("ended", record.stopped, np.abs(record.command[-1]).max(), flush=True)
recording.close(record.stopped)
"""


@pytest.fixture(scope="module")
def arm():
    return dqc.load_robot("iiwa7")


def driven(arm, path, **options):
    circle = dqc.references.Circle(arm.fkm(Q0), radius=0.05, duration=4.0, turns=2)
    law = dqc.laws.Proportional(gain=10.0).prepare(arm, circle, T)
    samples = circle.samples(T * np.arange(401))
    with RecordStream(path, arm, "name: test") as recording:
        return simulate_prepared(
            law, dqc.plants.Servo(encoder_noise=1e-4), Q0, samples, recording=lambda: recording, **options
        )


def test_what_is_streamed_is_what_is_recorded(arm, tmp_path):
    record = driven(arm, tmp_path / "record.mcap", supervisor=dqc.supervisor.Supervisor(velocity=0.1))
    loaded = load_record(tmp_path / "record.mcap")
    for name in ("time", "q", "measured", "command", "pose", "desired"):
        assert np.array_equal(getattr(loaded, name), getattr(record, name)), name
    codes = record.readings["interventions"].values
    assert codes.any()
    assert np.array_equal(loaded.readings["interventions"].values, codes)
    assert loaded.stopped == "duration"
    assert dqc.recording.load_metadata(tmp_path / "record.mcap")["spec"] == "name: test"
    with pytest.raises(ExistsError):
        RecordStream(tmp_path / "record.mcap", arm)


def test_a_file_cut_anywhere_is_read_as_far_as_it_goes(arm, tmp_path):
    record = driven(arm, tmp_path / "whole.mcap")
    data = (tmp_path / "whole.mcap").read_bytes()
    rng, lengths = np.random.default_rng(7), []
    for size in sorted(rng.integers(100, len(data) - 1, 25).tolist()):
        (tmp_path / "cut.mcap").write_bytes(data[:size])
        try:
            loaded = load_record(tmp_path / "cut.mcap")
        except FileFormatError:
            lengths.append(0)
            continue
        lengths.append(len(loaded))
        assert np.array_equal(loaded.q, record.q[: len(loaded)])
        assert loaded.stopped.startswith("cut off at") or len(loaded) == len(record)
    assert lengths == sorted(lengths)
    assert len(set(lengths)) > 3
    assert lengths[0] < 100 < lengths[-1]


def slowly(done, count):
    time.sleep(0.02)


def start(path, seconds, limit=0):
    return subprocess.Popen(
        [sys.executable, "-c", DRIVE, str(path), str(seconds), str(limit)], stdout=subprocess.PIPE, text=True
    )


def test_killed_at_any_moment(tmp_path):
    process = start(tmp_path / "record.mcap", 60)
    assert process.stdout
    reached = kept = 0.0
    while reached < 2.0 or kept < reached - 1.0:  # on a busy machine what is written lags for some time
        reached = float(process.stdout.readline())
        kept = load_record(tmp_path / "record.mcap").time[-1] if reached > 1.0 else 0.0
    process.send_signal(signal.SIGKILL)
    process.wait()
    loaded = load_record(tmp_path / "record.mcap")
    assert loaded.time[-1] >= kept
    assert loaded.stopped == f"cut off at {loaded.time[-1]:g} s: the recording has no end"
    assert np.diff(loaded.time) == pytest.approx(0.005)
    assert loaded.position_error.max() < 0.05


@pytest.mark.slow
def test_a_full_disk_stops_the_robot_and_says_so(tmp_path):
    process = start(tmp_path / "record.mcap", 60, limit=100_000)
    output, _ = process.communicate()
    last = output.splitlines()[-1]
    assert last.startswith("ended halted at"), output
    assert "the recording cannot be written: File too large" in last
    assert last.endswith(" 0.0"), "it stands still"
    assert process.returncode == 1, "and close says so too"
    loaded = load_record(tmp_path / "record.mcap")
    assert len(loaded) > 20
    assert loaded.stopped.startswith("cut off at")


def test_a_full_disk_without_a_supervisor_ends_the_loop(arm, tmp_path, monkeypatch):
    driven(arm, tmp_path / "before.mcap")  # what it compiles is kept before the disk is full
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    circle = dqc.references.Circle(arm.fkm(Q0), radius=0.05, duration=2.0)
    law = dqc.laws.Proportional(gain=10.0).prepare(arm, circle, T)
    recording = RecordStream(tmp_path / "record.mcap", arm)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, hard))
        samples = circle.samples(T * np.arange(20_000))
        record = simulate_prepared(
            law, dqc.plants.Servo(), Q0, samples, recording=lambda: recording, progress=slowly
        )
        with pytest.raises(Error, match=r"record.mcap: the recording cannot be written: File too large"):
            recording.close(record.stopped)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert record.stopped.startswith("halted at")
    assert len(record) < 20_000

"""Runs in real time whose law and supervisor step in C: recorded, watched and stopped as those in Python."""

import os
import select
import signal
import socket
import subprocess
import sys
import threading

import numpy as np
import pytest
from exported import SPEC, make, needs_c

import dqcontrol as dqc
from dqcontrol.browser import GrowingRecording
from dqcontrol.errors import Error, ValueRangeError
from dqcontrol.experiments import load_run
from dqcontrol.export import compiled_run, export_controller, run_compiled_in_real_time
from dqcontrol.export.controller_parts import controller_parts
from dqcontrol.supervisor.interventions import EMERGENCY

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


LONG = SHORT | {"duration": 60, "supervisor": {"stale_after": 1000.0, "ramp": 0.1, "velocity": 0.02}}
WORDS, HEARTBEAT = 8, 7  # of dqc_watch
STARTER = """
import subprocess, sys
loop = subprocess.Popen(sys.argv[1:])
print(loop.pid, flush=True)
loop.wait()
"""


@pytest.fixture(scope="module")
def hosts(tmp_path_factory):
    """Return the folder of loops and robots of the long run."""
    folder = export_controller(LONG, tmp_path_factory.mktemp("hosts") / "c").folder
    make(folder, "all", "hosts")
    return folder / "hosts/realtime"


@pytest.fixture
def robot(hosts, request):
    """Return the kind and the place of a robot that is there."""
    over = request.param
    place = f"/dqcontrol-test-{os.getpid()}" if over == "shared" else str(compiled_run._free_port())
    with subprocess.Popen([hosts / f"{over}_robot", place], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout
        assert process.stdout.readline() == "ready\n"
        yield over, place
        process.kill()


def watched_file(path, rows):
    """Return a file for a loop whose watcher has a heartbeat, and what the loop writes to it."""
    kind = compiled_run.row_type(7, 7)
    with path.open("wb") as file:
        file.truncate(8 * WORDS + rows * kind.itemsize)
    watch = np.memmap(path, dtype=np.int64, mode="r+", shape=WORDS)
    watch[HEARTBEAT] = 1
    return watch, np.memmap(path, dtype=kind, mode="r+", offset=8 * WORDS).view(np.recarray)


def await_end(process):
    """Wait for the end of a process that is no child."""
    try:
        end = os.pidfd_open(process)
    except ProcessLookupError:
        return
    with os.fdopen(end):
        assert select.select([end], [], [], 60)[0], "it drives on"


@needs_c
@pytest.mark.slow
@pytest.mark.parametrize("robot", ["udp", "shared"], indirect=True)
@pytest.mark.parametrize("is_killed", [True, False])
def test_a_loop_whose_watcher_is_killed_or_silent_brakes(hosts, robot, is_killed, tmp_path):
    """By its parent's death at once, by its heartbeat after 2 s; without them it would drive on for 60 s."""
    over, place = robot
    watch, rows = watched_file(tmp_path / "watch", 7000)
    command = [sys.executable, "-c", STARTER, hosts / f"{over}_loop", place, "0", tmp_path / "watch"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as starter:
        assert starter.stdout
        loop = int(starter.stdout.readline())
        while is_killed and watch[0] < 20:
            assert starter.poll() is None
        if is_killed:
            starter.kill()
        await_end(loop)
    done = rows[: int(watch[0])]
    assert done.status[-1] == 2
    assert int(done.interventions[-1]) & EMERGENCY
    assert not done.command[-1].any()
    moving = np.abs(done.command).max(axis=1)
    assert moving[:-1].max() > 0.01
    assert np.abs(np.diff(done.command, axis=0)).max() <= 0.1 + 1e-9  # 10 rad/s² in 10 ms
    assert done.time[-1] < 50


@needs_c
@pytest.mark.slow
@pytest.mark.parametrize("robot", ["udp"], indirect=True)
def test_a_loop_without_room_comes_to_rest(hosts, robot, tmp_path):
    over, place = robot
    watch, rows = watched_file(tmp_path / "watch", 30)
    watch[HEARTBEAT] = 0  # nobody watches
    subprocess.run([hosts / f"{over}_loop", place, "0", tmp_path / "watch"], check=True)
    assert watch[0] == 30
    assert np.abs(rows.command[-2]).max() > 1e-3
    assert not rows.command[-1].any()
    assert rows.status[-1] == 3


@needs_c
@pytest.mark.slow
@pytest.mark.parametrize("robot", ["udp"], indirect=True)
def test_a_robot_outlives_a_datagram_that_is_no_command(robot):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.connect(("127.0.0.1", int(robot[1])))
        sender.settimeout(30)
        sender.send(b"x")
        sender.send(bytes(8 * (1 + 8)))  # a number too many
        sender.send(bytes(8 * (1 + 7)))  # a greeting
        assert len(sender.recv(1000)) == 8 * (1 + 7 + 7)


def test_there_is_room_for_the_longest_braking():
    """Of a ramp, and of joints that take 87 s from their limit to rest."""
    slow = {"ramp": 30.0, "velocity": 1.0, "acceleration": 0.0115}
    parts = controller_parts(SHORT | {"supervisor": slow})
    assert compiled_run._capacity(parts) >= len(parts.samples) + (30 + 1 / 0.0115) / parts.period


@pytest.mark.parametrize(
    ("statuses", "supervised", "said"),
    [
        ([0, -11, 2], False, "halted at 0.02 s: no measurement came in its period"),
        ([0, -6, 2], False, "halted at 0.02 s: the law failed"),
        ([0, 0, 2], False, "halted at 0.02 s: asked to end"),
        ([0, 1, 2], True, "halted at 0.02 s: stop category 1: emergency stop"),
        ([0, 1, 3], True, "halted at 0.02 s: stop category 1: emergency stop"),
    ],
)
def test_every_stop_says_why(statuses, supervised, said):
    parts = controller_parts(SHORT if supervised else SHORT | {"supervisor": False})
    rows = np.zeros(3, compiled_run.row_type(7, 7)).view(np.recarray)
    rows.time[:], rows.status[:] = [0, 0.01, 0.02], statuses
    rows.interventions[1:] = EMERGENCY if supervised else 0
    assert compiled_run._why(parts, rows) == said


ONE_JOINT = """<robot name="one"><link name="base"/><link name="arm"/><link name="tip"/>
<joint name="hinge" type="revolute"><axis xyz="0 0 1"/><parent link="base"/><child link="arm"/>
<limit lower="-2" upper="2" velocity="1" effort="1"/></joint>
<joint name="end" type="fixed"><origin xyz="0.3 0 0"/><parent link="arm"/><child link="tip"/></joint></robot>"""


@needs_c
def test_a_robot_of_one_joint_is_recorded_too(tmp_path):
    """Rows of one number were flat, which no recording takes."""
    (tmp_path / "one.urdf").write_text(ONE_JOINT)
    robot = {"source": str(tmp_path / "one.urdf"), "base_link": "base", "tip_link": "tip"}
    spec = SHORT | {"robot": robot, "start": [0.3], "duration": 0.1, "reference": {"kind": "set-point"}}
    parts = controller_parts(spec)
    host = compiled_run._host(parts, compiled_run._startable_plant(parts), tmp_path, None)
    compiled_run._watched(host, Sink(), None)
    record = compiled_run._record(parts, host.rows[: host.written])
    assert record.q.shape == record.command.shape == (len(record), 1)
    assert record.stopped == "duration"


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
    assert '<figure id="timing">' in (tmp_path / "out/report.html").read_text(encoding="utf-8")


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
    assert run.record.stopped.endswith("stop category 2: soft stop")
    assert not run.command[-1].any()


def test_plants_that_do_not_step_in_c_are_refused(tmp_path):
    with pytest.raises(
        ValueRangeError, match=r"^plant: 'mujoco' does not step in C; with --compiled use servo"
    ):
        run_compiled_in_real_time(SHORT | {"plant": {"kind": "mujoco"}}, tmp_path / "out")
    assert not (tmp_path / "out").exists()

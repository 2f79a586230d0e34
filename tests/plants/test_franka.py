"""Franka arms: the real clients ``franky`` and ``pylibfranka`` against a double of FCI; no robot was met."""

import os
import subprocess
import sys
import time
from importlib.util import find_spec

import numpy as np
import pytest
from robot_doubles import double_of, drivers, seconds_to_rest

import dqcontrol as dqc
from dqcontrol.errors import Error, MissingExtraError, ShapeError, ValueRangeError
from dqcontrol.experiments import run_in_real_time
from dqcontrol.plants import FrankaArm

pytest.importorskip("franky", reason="franky-control has no wheel here")

START = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]
TIMEOUT = 0.5  # s: more than a loaded machine keeps this process waiting
WINDOW = 0.02 + 0.5 / 10 + 0.05  # s: 20 packets; from 0.5 rad/s; jerk, and filters
SPEC = {
    "name": "franka", "robot": "panda", "start": START, "period": 0.01,
    "reference": {"kind": "circle", "radius": 0.03, "duration": 2.0},
    "law": {"kind": "proportional-feedforward", "gain": 5.0},
    "supervisor": {"stale_after": 1.0, "ramp": 0.1},
}  # fmt: skip
PATIENT = {"timeout": 1.0}  # a loaded machine wakes this process late


@pytest.fixture(scope="module")
def driving():
    with drivers() as process:
        yield process


@pytest.fixture
def robot():
    with double_of("franka_double.py", q=START) as double:
        yield double


def started(double, start=START, period=0.01, robot="panda", **options):
    plant = FrankaArm(host=double.host, **PATIENT | options)
    return plant.start(dqc.load_robot(robot), np.array(start), period, 10, 0)


@pytest.mark.slow  # a second in which a busy machine does not run it ends it
def test_a_spec_runs_as_on_a_simulated_robot_and_ends_at_rest(robot, tmp_path):
    spec = {**SPEC, "plant": {"kind": "franka", "host": robot.host, **PATIENT}}
    done = run_in_real_time(spec, tmp_path / "run", figures=False)
    assert done.record.stopped == "duration"
    assert done.record.q.std(axis=0).max() > 0.01
    assert done.record.position_error.max() < 0.02
    state = robot.until(lambda state: not state["client"])
    assert (state["fault"], np.abs(state["dq"]).max() < 1e-9) == ("", True)


NAIVE = """
import sys, numpy as np, pylibfranka, dqcontrol as dqc
start, panda = np.array({start}), dqc.load_robot("panda")
law = dqc.laws.Proportional(gain=5.0).prepare(panda, None, 0.001)
command, state, sample = np.zeros(7), law.initial_state(start), np.zeros(21)
sample[:8] = panda.fkm(start + 0.2)
law.step(start, sample, 0, state, command)  # compiled now
arm = pylibfranka.Robot(sys.argv[1], pylibfranka.RealtimeConfig.kIgnore)
control = arm.start_joint_velocity_control(pylibfranka.ControllerMode.JointImpedance)
try:
    for k in range(500):
        measured, _ = control.readOnce()
        law.step(np.array(measured.q), sample, k, state, command)
        control.writeOnce(pylibfranka.JointVelocities(command.tolist()))
except pylibfranka.ControlException as error:
    print(error)
"""


def test_a_loop_that_begins_late_takes_no_old_state_for_silence(robot):
    live = started(robot, timeout=0.2)
    time.sleep(0.5)
    live.step(np.zeros(7))
    assert live.fault == ""
    live.close()


def test_the_program_keeps_its_own_priority(robot):
    before = os.sched_getscheduler(0), os.sched_getparam(0).sched_priority
    live = started(robot)
    live.step(np.zeros(7))
    assert (os.sched_getscheduler(0), os.sched_getparam(0).sched_priority) == before
    live.close()


def test_a_naive_loop_trips_it(robot):
    if find_spec("pylibfranka") is None:
        pytest.skip("pylibfranka has no wheel here")
    naive = [
        sys.executable,
        "-c",
        NAIVE.format(start=START),
        robot.host,
    ]  # both clients do not fit in one process
    said = subprocess.run(naive, capture_output=True, text=True, check=True).stdout
    assert "joint_motion_generator_velocity_discontinuity" in said
    assert robot.state()["fault"] == "joint_motion_generator_velocity_discontinuity"


@pytest.mark.slow
def test_the_same_law_behind_the_supervisor_gets_there(robot):
    panda = dqc.load_robot("panda")
    live = dqc.loop.Live(
        panda, dqc.laws.Proportional(gain=5.0), FrankaArm(host=robot.host, **PATIENT), 0.01, start=START,
        supervisor=dqc.supervisor.Supervisor(stale_after=1.0),
    )  # fmt: skip
    live.target = panda.fkm(np.array(START) + 0.2)
    for _ in range(400):
        live.step()
        time.sleep(0.01)
    assert live.state.missing < 1e-3, live.condition
    assert robot.state()["fault"] == ""
    robot.state(mode=5)  # somebody opened a brake
    while not live.is_stopped:
        live.step()
        time.sleep(0.01)
    assert "Franka at" in live.condition


def refused(double, error, words, **options):
    with pytest.raises(error, match=words):
        started(double, **options)
    state = double.state()
    assert np.array_equal(state["q"], START) or state["dq"] == [0.3] * 7  # which it did before


def test_what_is_wrong_is_said_in_one_line_and_nothing_moves(robot):
    refused(robot, ShapeError, "has 7 joints, the robot of the spec 6", robot="ur5", start=[0.0] * 6)
    refused(robot, ValueRangeError, "joint 2 .* is at -44.9772; must lie in", start=np.degrees(START))
    refused(
        robot,
        ValueRangeError,
        "stands elsewhere: joint 3 .* write start: ",
        start=[0, -0.785, 0.3, *START[3:]],
    )
    refused(robot, ValueRangeError, "period: must be 0.002 … 0.05 s", period=0.001)
    first = started(robot)
    refused(robot, Error, "is driven already, from this computer")
    first.close()


def test_robots_that_refuse_are_left_alone():
    with double_of("franka_double.py", q=START, moving=0.3) as double:
        refused(double, Error, r"moves, joint . .* at 0\.\d+ rad/s; it must stand")
    with double_of("franka_double.py", q=START, version=9) as double:
        refused(double, Error, "[Ii]ncompatible")
    with double_of("franka_double.py", q=START) as double:
        double.state(mode=5)
        refused(double, Error, "robot mode UserStopped")


def test_a_robot_that_is_not_there_leaves_no_run_behind(tmp_path):
    nobody = {**SPEC, "plant": {"kind": "franka", "host": "127.9.9.8"}}
    with pytest.raises(Error, match=r"Franka at 127\.9\.9\.8: .*refused"):
        run_in_real_time(nobody, tmp_path / "run", figures=False)
    assert not (tmp_path / "run").exists()


def test_without_the_client_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "franky", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'dqcontrol\[franka\]'"):
        FrankaArm(host="127.9.9.9").start(dqc.load_robot("panda"), np.array(START), 0.01, 10, 0)


def rest_after(process, how, seed):
    panda = {"kind": "FrankaArm", "robot": "panda", "start": START, "timeout": TIMEOUT}
    return seconds_to_rest(process, how, "franka_double.py", seed, **panda)


@pytest.mark.parametrize("how", ["freeze"])
def test_it_rests_after_a_failure(driving, how):
    assert rest_after(driving, how, 0) <= WINDOW


@pytest.mark.slow
@pytest.mark.parametrize("how", ["kill", "freeze", "unplug"])
def test_it_rests_within_the_window_whatever_fails(driving, how):
    for seed in range(34):  # 102 moments
        assert rest_after(driving, how, seed) <= WINDOW


@pytest.mark.slow
def test_a_minute_behind_law_supervisor_and_constraints(robot, tmp_path):
    minute = {
        **SPEC, "period": 0.005, "plant": {"kind": "franka", "host": robot.host, **PATIENT},
        "reference": {"kind": "circle", "radius": 0.1, "turns": 10, "duration": 60.0},
        "law": {"kind": "proportional-feedforward", "gain": 5.0, "constraints": {"acceleration": 5.0}},
        # A loaded machine may keep this process waiting for `timeout`, and the velocity goes on meanwhile.
        "supervisor": {**SPEC["supervisor"], "tracking_error": 1.0},
    }  # fmt: skip
    done = run_in_real_time(minute, tmp_path / "run", figures=False)
    state = robot.state()
    assert (done.record.stopped, state["fault"]) == ("duration", "")
    assert np.median(done.record.position_error) < 0.03
    print(f"{done.timing.missed} periods missed of {len(done.record)}; {state['lost_in_all']} packets lost")

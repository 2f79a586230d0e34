"""UR arms: the real client ``ur_rtde`` against a double of the controller; no robot was met."""

import sys
import time

import numpy as np
import pytest
from robot_doubles import double_of, drivers, seconds_to_rest

import dqcontrol as dqc
from dqcontrol.errors import Error, MissingExtraError, ShapeError, ValueRangeError
from dqcontrol.experiments import run_in_real_time
from dqcontrol.plants import UniversalRobot

pytest.importorskip("rtde_control", reason="ur_rtde has no wheel here")

START = [0.0, -1.2, 1.4, -1.7, -1.5, 0.0]
TIMEOUT = 0.5  # s: more than a loaded machine keeps this process waiting
WINDOW = TIMEOUT + 0.002 + 0.5 / 20  # s: the watchdog, then from 0.5 rad/s at the double's 20 rad/s²
SPEC = {
    "name": "ur", "robot": "ur5", "start": START, "period": 0.008,
    "reference": {"kind": "circle", "radius": 0.02, "duration": 2.0},
    "law": {"kind": "proportional-feedforward", "gain": 5.0},
    "supervisor": {"stale_after": 1.0, "ramp": 0.1},
}  # fmt: skip
PATIENT = {"timeout": 1.0, "lookahead": 0.2}  # a loaded machine wakes the double and this process late


@pytest.fixture(scope="module")
def driving():
    with drivers() as process:
        yield process


@pytest.fixture
def robot():
    with double_of("ur_double.py", q=START) as double:
        yield double


def spec(double, **plant):
    return {**SPEC, "plant": {"kind": "ur", "host": double.host, **PATIENT, **plant}}


def started(double, start=START, period=0.008, robot="ur5", **options):
    plant = UniversalRobot(host=double.host, **PATIENT | options)
    return plant.start(dqc.load_robot(robot), np.array(start), period, 10, 0)


@pytest.mark.slow  # a second in which a busy machine does not run it ends it
@pytest.mark.parametrize("mode", ["integrated", "velocity"])
def test_a_spec_runs_as_on_a_simulated_robot_and_ends_at_rest(robot, tmp_path, mode):
    done = run_in_real_time(spec(robot, command_mode=mode), tmp_path / "run", figures=False)
    assert done.record.stopped == "duration"
    assert done.record.q.std(axis=0).max() > 0.01
    assert done.record.position_error.max() < 0.02
    state = robot.until(lambda state: not state["running"])
    assert (state["fault"], np.abs(state["qd"]).max() < 1e-9) == ("", True)
    assert state["fastest"] < 1.0


def test_a_program_that_one_connection_hears_of_late_is_no_program_that_ended():
    with double_of("ur_double.py", q=START, reads_late=100) as double:
        live = started(double)
        live.step(np.zeros(6))
        assert live.fault == ""
        live.close()


def test_a_naive_loop_trips_it(robot):
    arm, live = dqc.load_robot("ur5"), started(robot)
    law = dqc.laws.Proportional(gain=20.0).prepare(arm, None, 0.008)
    command, state, sample = np.zeros(6), law.initial_state(live.q), np.zeros(21)
    sample[:8] = arm.fkm(np.array(START) + 0.4)
    for k in range(200):
        law.step(live.measured, sample, k, state, command)
        live.step(command)
        if live.fault:
            break
        time.sleep(0.008)
    assert "protective stop" in live.fault
    assert robot.state()["fault"].startswith("joint")
    live.step(command)  # sent no more
    live.close()


@pytest.mark.slow
def test_the_same_law_behind_the_supervisor_gets_there(robot):
    arm = dqc.load_robot("ur5")
    live = dqc.loop.Live(
        arm, dqc.laws.Proportional(gain=5.0), UniversalRobot(host=robot.host, **PATIENT), 0.008, start=START,
        supervisor=dqc.supervisor.Supervisor(stale_after=1.0, acceleration=2.0),
    )  # fmt: skip
    live.target = arm.fkm(np.array(START) + 0.1)
    for _ in range(400):
        live.step()
        time.sleep(0.008)
    assert live.state.missing < 1e-3, live.condition
    assert robot.state()["fault"] == ""
    robot.state(fault="somebody pressed it")
    robot.until(lambda state: not state["running"])
    while not live.is_stopped:
        live.step()
        time.sleep(0.008)
    assert "emergency" in live.condition
    assert "protective stop" in live.condition


def refused(double, error, words, **options):
    with pytest.raises(error, match=words):
        started(double, **options)
    state = double.state()
    assert state["mode"] is None
    assert np.array_equal(state["q"], START) or state["qd"] == [0.3] * 6  # which it did before


def test_what_is_wrong_is_said_in_one_line_and_nothing_moves(robot):
    refused(robot, ShapeError, "has 6 joints, the robot of the spec 7", robot="iiwa7", start=[0.0] * 7)
    refused(robot, ValueRangeError, "joint 2 .* is at -68.7549; must lie in", start=np.degrees(START))
    refused(
        robot,
        ValueRangeError,
        r"stands elsewhere: joint 2 .* at -1\.2, not at 1\.4; write start: \[0\.0000, -1",
        start=[0, 1.4, -1.2, -1.7, -1.5, 0],
    )
    refused(robot, ValueRangeError, "period: must be 0.002 … 0.05 s", period=0.2)
    first = started(robot)
    refused(robot, Error, "is driven already, from this computer")
    first.close()
    started(robot).close()  # as soon as the first let go


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"moving": 0.3}, r"moves, joint . .* at 0\.\d+ rad/s; it must stand"),
        ({"power": False}, "its power is off, or its brakes are on"),
        ({"in_use": True}, "already in use"),
        ({"remote": False}, "enable remote control"),
        ({"version": [3, 1, 0, 0]}, "its PolyScope is 3.1; 3.4 is needed"),
    ],
)
def test_robots_that_refuse_are_left_alone(options, words):
    with double_of("ur_double.py", q=START, **options) as double:
        refused(double, Error, words)


def test_a_robot_that_is_not_there_leaves_no_run_behind(tmp_path):
    nobody = {**SPEC, "plant": {"kind": "ur", "host": "127.9.9.9"}}
    with pytest.raises(Error, match=r"UR at 127\.9\.9\.9: .*(onnect|refused)"):
        run_in_real_time(nobody, tmp_path / "run", figures=False)
    assert not (tmp_path / "run").exists()


def test_an_earlier_run_stays_if_the_robot_is_not_there(tmp_path):
    dqc.run({**SPEC, "plant": {"kind": "servo"}}).save(tmp_path / "run", figures=False)
    before = {path: path.read_bytes() for path in (tmp_path / "run").rglob("*") if path.is_file()}
    nobody = {**SPEC, "plant": {"kind": "ur", "host": "127.9.9.9"}}
    with pytest.raises(Error, match=r"UR at 127\.9\.9\.9: "):
        run_in_real_time(nobody, tmp_path / "run", force=True, figures=False)
    assert {path: path.read_bytes() for path in (tmp_path / "run").rglob("*") if path.is_file()} == before


def test_it_goes_to_the_start_if_it_is_told_how_fast(robot):
    start = np.add(START, [0.1, 0.0, 0.0, 0.0, 0.0, -0.05])
    live = started(robot, start=start, approach=0.3)
    np.testing.assert_allclose(live.measured, start, atol=5e-3)
    live.close()
    state = robot.until(lambda state: not state["running"])
    assert (state["fault"], state["fastest"] < 0.4) == ("", True)
    np.testing.assert_allclose(state["q"], start, atol=5e-3)


def test_a_robot_always_has_a_supervisor(robot):
    with pytest.raises(ValueRangeError, match="a robot always has one"):
        dqc.run({**spec(robot), "supervisor": False})
    assert robot.state()["commands"] == 0


def test_without_the_client_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "rtde_receive", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'dqcontrol\[ur\]'"):
        UniversalRobot(host="127.9.9.9").start(dqc.load_robot("ur5"), np.array(START), 0.008, 10, 0)


def rest_after(process, how, mode, seed):
    ur = {"kind": "UniversalRobot", "robot": "ur5", "start": START, "command_mode": mode, "timeout": TIMEOUT}
    return seconds_to_rest(process, how, "ur_double.py", seed, **ur)


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["integrated", "velocity"])
@pytest.mark.parametrize("how", ["kill", "freeze", "unplug"])
def test_it_rests_within_the_window_whatever_fails(driving, how, mode):
    for seed in range(17):  # with both modes 102 moments
        assert rest_after(driving, how, mode, seed) <= WINDOW


@pytest.mark.parametrize("how", ["unplug"])
def test_it_rests_after_a_failure(driving, how):
    assert rest_after(driving, how, "velocity", 0) <= WINDOW


@pytest.mark.slow
def test_a_minute_at_500_hz_behind_law_supervisor_and_constraints(robot, tmp_path):
    minute = {
        **spec(robot), "period": 0.002,
        "reference": {"kind": "circle", "radius": 0.1, "turns": 10, "duration": 60.0},
        "law": {"kind": "proportional-feedforward", "gain": 5.0, "constraints": {"acceleration": 5.0}},
    }  # fmt: skip
    done = run_in_real_time(minute, tmp_path / "run", figures=False)
    assert (done.record.stopped, robot.state()["fault"]) == ("duration", "")
    assert np.median(done.record.position_error) < 0.03
    print(f"{done.timing.missed} periods missed of {len(done.record)}")


@pytest.mark.slow
def test_it_learns_from_repeats_and_goes_back_to_the_start_between_them(robot):
    repeated = {
        **spec(robot, approach=0.3),
        "reference": {"kind": "circle", "radius": 0.03, "duration": 2.0, "ramp": 0.5},
        "law": {"kind": "proportional-feedforward", "gain": 2.0},
    }  # fmt: skip
    found = dqc.learn(repeated, 1, real_time=True, model={"kind": "servo", "time_constant": 0.1})
    assert found.gain > 3  # its errors: 8.5 mm, then 0.7 mm, on a quiet machine
    assert robot.state()["fault"] == ""

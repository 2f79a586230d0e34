"""UR, Franka and xArm: each maker's real client against a double of its controller; no robot was met."""

import os
import sys
import time

import numpy as np
import pytest
from makers_arms import FRANKA, UR, XARM
from robot_doubles import drivers

import dqcontrol as dqc
from dqcontrol.errors import Error, MissingExtraError, ShapeError, ValueRangeError
from dqcontrol.experiments import run_in_real_time


@pytest.fixture(params=[UR, FRANKA, XARM], ids=lambda arm: arm.kind)
def arm(request):
    request.param.skip_without_client()
    return request.param


@pytest.fixture
def robot(arm):
    with arm.double_of() as double:
        yield double


@pytest.fixture(scope="module")
def driving():
    with drivers() as process:
        yield process


@pytest.mark.slow  # a second in which a busy machine does not run it ends it
def test_a_spec_runs_as_on_a_simulated_robot_and_ends_at_rest(arm, robot, tmp_path):
    done = run_in_real_time(arm.spec(robot.host), tmp_path / "run", figures=False)
    assert done.record.stopped == "duration"
    assert done.record.q.std(axis=0).max() > 0.01
    assert done.record.position_error.max() < 0.02
    state = robot.until(lambda state: not state["is_driven"] and np.abs(state["qd"]).max() < 1e-9)
    assert state["fault"] == ""
    assert state["fastest"] < 1.0


@pytest.mark.slow  # seconds of real time each
def test_a_law_behind_the_supervisor_gets_there_and_an_emergency_stop_stops_it(arm, robot):
    loaded = dqc.load_robot(arm.robot)
    live = dqc.loop.Live(
        loaded, dqc.laws.Proportional(gain=5.0), arm.plant(host=robot.host, **arm.patient), arm.period,
        start=arm.start, supervisor=dqc.supervisor.Supervisor(stale_after=1.0, acceleration=2.0),
    )  # fmt: skip
    live.target = loaded.fkm(np.array(arm.start) + 0.1)
    for _ in range(400):
        live.step()
        time.sleep(arm.period)
    assert live.state.missing < 1e-3, live.condition
    assert robot.state()["fault"] == ""
    robot.state(**arm.pressed)
    late = time.monotonic() + 60
    while not live.is_stopped and time.monotonic() < late:
        live.step()
        time.sleep(arm.period)
    assert arm.plant(host=robot.host).address in live.condition


def test_what_is_wrong_is_said_in_one_line_and_nothing_moves(arm, robot):
    count = len(arm.start)
    other = ("iiwa7", 7) if count == 6 else ("ur5", 6)
    arm.refused(
        robot, ShapeError, f"has {count} joints, the robot of the spec {other[1]}",
        robot=other[0], start=[0.0] * other[1],
    )  # fmt: skip
    arm.refused(robot, ValueRangeError, "joint 2 .* is at -.*; must lie in", start=np.degrees(arm.start))
    swapped = [arm.start[0], arm.start[1] + 0.3, *arm.start[2:]]
    arm.refused(robot, ValueRangeError, r"stands elsewhere: joint 2 .*; write start: \[-?\d", start=swapped)
    arm.refused(robot, ValueRangeError, "period: must be 0.002 … 0.05 s", period=0.2)
    first = arm.started(robot)
    with pytest.raises(Error, match="is driven already, from this computer"):
        arm.started(robot)
    first.close()
    arm.started(robot).close()  # as soon as the first let go


def test_a_robot_that_moves_is_left_alone(arm):
    with arm.double_of(moving=0.3) as double:
        arm.refused(double, Error, r"moves, joint . .* at 0\.\d+ rad/s; it must stand")


def test_a_robot_that_is_not_there_leaves_no_run_behind(arm, tmp_path):
    with pytest.raises(Error, match=r" at 127\.9\.9\.9: .*(onnect|refused)"):
        run_in_real_time(arm.spec("127.9.9.9"), tmp_path / "run", figures=False)
    assert not (tmp_path / "run").exists()


def test_an_earlier_run_stays_if_the_robot_is_not_there(arm, tmp_path):
    dqc.run({**arm.spec(""), "plant": {"kind": "servo"}}).save(tmp_path / "run", figures=False)
    before = {path: path.read_bytes() for path in (tmp_path / "run").rglob("*") if path.is_file()}
    with pytest.raises(Error, match=r" at 127\.9\.9\.9: "):
        run_in_real_time(arm.spec("127.9.9.9"), tmp_path / "run", force=True, figures=False)
    assert {path: path.read_bytes() for path in (tmp_path / "run").rglob("*") if path.is_file()} == before


def test_it_goes_to_the_start_if_it_is_told_how_fast(arm, robot):
    start = np.array(arm.start)
    start[[0, -1]] += [0.1, -0.05]
    live = arm.started(robot, start=start, approach=0.3)
    np.testing.assert_allclose(live.measured, start, atol=5e-3)
    live.close()
    state = robot.until(lambda state: not state["is_driven"] and np.abs(state["qd"]).max() < 1e-9)
    assert (state["fault"], state["fastest"] < 0.4) == ("", True)
    np.testing.assert_allclose(state["q"], start, atol=5e-3)


def test_a_loop_that_begins_late_takes_no_old_state_for_silence(arm, robot):
    live = arm.started(robot, timeout=0.2)
    time.sleep(0.5)
    live.step(np.zeros(len(arm.start)))
    assert live.fault == ""
    live.close()


@pytest.mark.skipif(not hasattr(os, "sched_getscheduler"), reason="the system has no such priorities")
def test_the_program_keeps_its_own_priority(arm, robot):
    before = os.sched_getscheduler(0), os.sched_getparam(0).sched_priority
    live = arm.started(robot)
    live.step(np.zeros(len(arm.start)))
    assert (os.sched_getscheduler(0), os.sched_getparam(0).sched_priority) == before
    live.close()


def test_a_robot_always_has_a_supervisor(arm, robot):
    with pytest.raises(ValueRangeError, match="a robot always has one"):
        dqc.run({**arm.spec(robot.host), "supervisor": False})
    assert not robot.state()["is_driven"]


def test_without_the_client_the_extra_is_named(arm, monkeypatch):
    for module in ("rtde_receive", "franky", "xarm.wrapper"):
        monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(MissingExtraError, match=rf"pip install 'dqcontrol\[{arm.kind}\]'"):
        arm.plant(host="127.9.9.9").start(dqc.load_robot(arm.robot), np.array(arm.start), arm.period, 10, 0)


@pytest.mark.parametrize(("arm", "how"), [(UR, "unplug"), (FRANKA, "freeze"), (XARM, "kill")])
def test_it_rests_after_a_failure(driving, arm, how):
    arm.skip_without_client()
    assert arm.seconds_to_rest(driving, how, 0) <= arm.window


@pytest.mark.slow
@pytest.mark.parametrize("how", ["kill", "freeze", "unplug"])
def test_it_rests_within_the_window_whatever_fails(driving, arm, how):
    for seed in range(34):  # 102 moments
        assert arm.seconds_to_rest(driving, how, seed) <= arm.window


@pytest.mark.slow
def test_a_minute_behind_law_supervisor_and_constraints(arm, robot, tmp_path):
    spec = arm.spec(robot.host)
    minute = {
        **spec, "period": arm.fastest_period,
        "reference": {"kind": "circle", "radius": 0.1, "turns": 10, "duration": 60.0},
        "law": {"kind": "proportional-feedforward", "gain": 5.0, "constraints": {"acceleration": 5.0}},
        # A loaded machine may keep this process waiting for `timeout`, and a velocity goes on meanwhile.
        "supervisor": {**spec["supervisor"], "tracking_error": 1.0},
    }  # fmt: skip
    done = run_in_real_time(minute, tmp_path / "run", figures=False)
    assert (done.record.stopped, robot.state()["fault"]) == ("duration", "")
    assert np.median(done.record.position_error) < 0.03
    print(f"{done.timing.missed} periods missed of {len(done.record)}, {robot.state()}")

"""UR arms by ``ur_rtde``: what only they have; the rest is in test_makers_arms.py."""

import time

import numpy as np
import pytest
from makers_arms import UR
from robot_doubles import drivers

import dqcontrol as dqc
from dqcontrol.errors import Error
from dqcontrol.experiments import run_in_real_time

pytest.importorskip("rtde_control", reason="ur_rtde has no wheel here")


@pytest.fixture
def robot():
    with UR.double_of() as double:
        yield double


@pytest.mark.slow  # a second in which a busy machine does not run it ends it
def test_it_takes_velocities_as_well(robot, tmp_path):
    done = run_in_real_time(UR.spec(robot.host, command_mode="velocity"), tmp_path / "run", figures=False)
    assert done.record.stopped == "duration"
    assert done.record.position_error.max() < 0.02
    state = robot.until(lambda state: not state["is_driven"])
    assert (state["fault"], np.abs(state["qd"]).max() < 1e-9) == ("", True)


def test_a_program_that_one_connection_hears_of_late_is_no_program_that_ended():
    with UR.double_of(reads_late=100) as double:
        live = UR.started(double)
        live.step(np.zeros(6))
        assert live.fault == ""
        live.close()


def test_a_naive_loop_trips_it(robot):
    arm, live = dqc.load_robot("ur5"), UR.started(robot)
    law = dqc.laws.Proportional(gain=20.0).prepare(arm, None, 0.008)
    command, state, sample = np.zeros(6), law.initial_state(live.q), np.zeros(21)
    sample[:8] = arm.fkm(np.array(UR.start) + 0.4)
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


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"power": False}, "its power is off, or its brakes are on"),
        ({"in_use": True}, "already in use"),
        ({"remote": False}, "enable remote control"),
        ({"version": [3, 1, 0, 0]}, "its PolyScope is 3.1; 3.4 is needed"),
    ],
)
def test_robots_that_refuse_are_left_alone(options, words):
    with UR.double_of(**options) as double:
        UR.refused(double, Error, words)


@pytest.mark.slow
@pytest.mark.parametrize("how", ["kill", "freeze", "unplug"])
def test_velocities_end_within_the_window_whatever_fails(how):
    with drivers() as process:
        for seed in range(17):
            assert UR.seconds_to_rest(process, how, seed, command_mode="velocity") <= UR.window


@pytest.mark.slow
def test_it_learns_from_repeats_and_goes_back_to_the_start_between_them(robot):
    repeated = {
        **UR.spec(robot.host, approach=0.3),
        "reference": {"kind": "circle", "radius": 0.03, "duration": 2.0, "ramp": 0.5},
        "law": {"kind": "proportional-feedforward", "gain": 2.0},
    }
    found = dqc.learn(repeated, 1, real_time=True, model={"kind": "servo", "time_constant": 0.1})
    assert found.gain > 3  # its errors: 8.5 mm, then 0.7 mm, on a quiet machine
    assert robot.state()["fault"] == ""

import json
from dataclasses import replace

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.errors import ShapeError, ValueRangeError
from dqcontrol.loop.record import Record, part_of
from dqcontrol.loop.signals import ACTUATORS, Signal
from dqcontrol.measures.metrics import evaluate
from dqcontrol.robots.limits import Limits
from dqcontrol.robots.serial_arm import SerialArm

ONE = np.array([1.0, 0, 0, 0, 0, 0, 0, 0])


def shifted(position):
    """Return poses without rotation at positions (N, 3)."""
    return np.hstack([np.tile(ONE[:5], (len(position), 1)), np.asarray(position) / 2])


def turned(angle):
    """Return poses at the origin turned about z."""
    poses = np.zeros((len(angle), 8))
    poses[:, 0], poses[:, 3] = np.cos(angle / 2), np.sin(angle / 2)
    return poses


def record(time, pose, desired=None, q=None, command=None):
    count = len(time)
    desired = np.tile(ONE, (count, 1)) if desired is None else desired
    q = np.zeros((count, 2)) if q is None else q
    command = np.zeros((count, 2)) if command is None else command
    samples = np.hstack([desired, np.zeros((count, 13))])
    return Record(time, q, q, command, pose, samples, ("shoulder", "elbow"))


def along_x(x):
    return shifted(np.column_stack([x, 0 * x, 0 * x]))


def test_exponential_decay_of_the_position_error():
    time, k, start = np.linspace(0, 4, 4001), 2.0, 0.1
    decay = np.exp(-k * time)
    found = evaluate(record(time, along_x(start * decay)), skip_initial=1.0)
    assert found.error.integral == pytest.approx(start / 2 / k * (1 - np.exp(-8)), rel=1e-5)
    assert found.error.rms == pytest.approx(start / 2 * np.sqrt((1 - np.exp(-16)) / (2 * k) / 4), rel=1e-5)
    assert found.error.peak == pytest.approx(0.05)
    assert found.settled_error.integral == pytest.approx(start / 2 / k * (np.exp(-2) - np.exp(-8)), rel=1e-5)
    assert found.settled_error.mean == pytest.approx(found.settled_error.integral / 3)
    assert found.settled_error.peak == pytest.approx(0.05 * np.exp(-2))
    assert found.final_error == pytest.approx(0.05 * np.exp(-8))
    assert found.position.mean == pytest.approx(100 / k / 4 * (1 - np.exp(-8)), rel=1e-5)
    assert found.position.peak == pytest.approx(100)
    assert found.position.final == pytest.approx(100 * np.exp(-8))
    assert found.position.settled_peak == pytest.approx(100 * np.exp(-2))
    assert found.position.settled_mean == pytest.approx(100 * (np.exp(-2) - np.exp(-8)) / k / 3, rel=1e-5)
    assert found.orientation.peak == 0
    assert found.settling_time == pytest.approx(np.log(50) / k, abs=1.001e-3)
    assert found.settling_band == pytest.approx(0.001)
    assert found.position_overshoot == 0
    assert np.isnan(found.orientation_overshoot)


def test_a_turn_is_measured_in_degrees():
    time = np.linspace(0, 1, 11)
    found = evaluate(record(time, turned(0.2 * np.ones(11))))
    assert found.orientation.mean == pytest.approx(np.degrees(0.2))
    assert found.orientation.rms == pytest.approx(np.degrees(0.2))
    assert found.error.mean == pytest.approx(2 * np.sin(0.05))


def test_speed_and_acceleration_of_a_hand_on_a_circle():
    radius, rate = 0.3, 2.0
    time = np.linspace(0, np.pi, 2001)
    points = radius * np.column_stack([np.cos(rate * time), 0 * time, np.sin(rate * time)])
    found = evaluate(record(time, shifted(points)))
    assert found.hand_speed.mean == pytest.approx(radius * rate, rel=1e-5)
    assert found.hand_speed.peak == pytest.approx(radius * rate, rel=1e-5)
    assert found.hand_speed.integral == pytest.approx(2 * np.pi * radius, rel=1e-5)
    assert found.hand_acceleration.rms == pytest.approx(radius * rate**2, rel=1e-5)
    assert found.hand_acceleration.peak == pytest.approx(radius * rate**2, rel=1e-4)


def test_speed_and_acceleration_of_an_arm_with_uneven_samples():
    arm = SerialArm.from_dh([0, 0], [0, 0], [0.5, 0.25], [0, 0])
    seed = np.random.default_rng(3)
    time = np.concatenate([[0], np.cumsum(seed.uniform(0.5e-3, 1.5e-3, 4000))])
    q = np.column_stack([np.sin(time), 0 * time])
    found = evaluate(record(time, arm.fkm(q), q=q))
    assert found.hand_speed.peak == pytest.approx(0.75, rel=1e-5)
    assert found.joint_path_length == pytest.approx(np.abs(np.diff(np.sin(time))).sum())
    # The joint turns by q = sin t: |p̈| = 0.75 √(q̇⁴ + q̈²)
    expected = 0.75 * np.sqrt(np.cos(time) ** 4 + np.sin(time) ** 2).max()
    assert found.hand_acceleration.peak == pytest.approx(expected, rel=1e-3)


def test_joint_step_depends_on_the_sample_time_and_path_length_does_not():
    found = []
    for count in (101, 201):
        time = np.linspace(0, 2, count)
        q = np.column_stack([3 * time, 4 * time])
        found.append(evaluate(record(time, along_x(0 * time), q=q)))
    coarse, fine = found
    assert coarse.joint_path_length == pytest.approx(10)
    assert fine.joint_path_length == pytest.approx(10)
    assert coarse.joint_step.integral == pytest.approx(0.02 * 10)  # T times the path length
    assert fine.joint_step.integral == pytest.approx(0.01 * 10)
    assert coarse.joint_step.peak == pytest.approx(0.1)


def test_commands_are_held_and_the_last_one_moved_nothing():
    command = np.array([[3.0, 4.0], [0.0, 1.0], [100.0, 100.0]])
    found = evaluate(record(np.array([0.0, 2.0, 3.0]), along_x(np.zeros(3)), command=command))
    assert found.control.integral == pytest.approx(5 * 2 + 1)
    assert found.control.mean == pytest.approx(11 / 3)
    assert found.control.rms == pytest.approx(np.sqrt((25 * 2 + 1) / 3))
    assert found.control.peak == pytest.approx(5)
    assert found.effort == pytest.approx(np.sqrt(51))


def test_settling_and_overshoot_of_a_damped_oscillation():
    time, decay, rate = np.linspace(0, 10, 10001), 0.5, 4.0
    x = np.exp(-decay * time) * np.cos(rate * time)
    found = evaluate(record(time, along_x(0.1 * x)), tolerance=0.05 * 0.1)
    first_minimum = (np.pi - np.arctan(decay / rate)) / rate
    overshoot = np.exp(-decay * first_minimum) * np.cos(np.arctan(decay / rate))
    assert found.position_overshoot == pytest.approx(overshoot, rel=1e-5)
    outside = np.abs(x) / 2 > 0.05
    assert found.settling_time == pytest.approx(time[np.flatnonzero(outside)[-1] + 1])
    assert 4 < found.settling_time < 6


def test_overshoot_of_a_turn():
    time = np.linspace(0, 1, 101)
    found = evaluate(record(time, turned(0.4 * np.cos(2 * np.pi * time) * np.exp(-time))))
    assert found.orientation_overshoot == pytest.approx(np.exp(-0.475), rel=2e-2)


def test_a_run_that_ends_outside_its_band_has_not_settled():
    time = np.linspace(0, 1, 101)
    assert np.isnan(evaluate(record(time, along_x(1 - 0.5 * time))).settling_time)
    assert evaluate(record(time, along_x(1 - 0.5 * time)), tolerance=0.6).settling_time == 0


def test_limit_margin_names_the_joint():
    time = np.linspace(0, 1, 11)
    q = np.column_stack([0.4 * time, 1 - 3 * time])
    limits = Limits(*(np.array(v) for v in ([-0.5, -1.75], [0.5, np.inf], [1.0, 1.0], [1.0, 1.0])))
    found = evaluate(record(time, along_x(time), q=q), limits)
    assert (found.limit_joint, found.limit_margin) == ("elbow", pytest.approx(-0.25))
    free = evaluate(record(time, along_x(time), q=q), Limits.none(2))
    assert np.isnan(free.limit_margin)
    assert free.limit_joint == ""


@pytest.mark.filterwarnings("error")
def test_json_has_no_nan_for_one_sample_or_a_diverged_run():
    single = evaluate(record(np.zeros(1), along_x(np.ones(1))))
    pose = along_x(np.ones(5))
    pose[3:] = np.inf
    q = np.full((5, 2), np.nan)
    diverged = evaluate(
        record(np.linspace(0, 1, 5), pose, q=q), Limits(*np.array([[-1, -1], [1, 1], [1, 1], [1, 1]]))
    )
    for found in (single, diverged):
        text = json.dumps(found.to_dict(), allow_nan=False)
        assert json.loads(text)["settling_time"] is None
    assert single.error.peak == pytest.approx(0.5)
    assert single.error.integral == 0
    assert single.flat()["hand_speed.mean"] is None
    assert diverged.flat()["error.integral"] is None
    assert diverged.flat()["position_overshoot"] is None
    assert diverged.flat()["limit_margin"] is None


def test_flat_names_every_number_once():
    found = evaluate(record(np.linspace(0, 1, 3), along_x(np.ones(3))))
    flat = found.flat()
    assert flat["position.settled_rms"] == pytest.approx(1000)
    assert len(flat) == 6 * 4 + 2 * 7 + 18
    assert {type(value) for value in flat.values()} <= {float, int, str, type(None)}


@pytest.mark.parametrize(
    ("options", "kind", "message"),
    [
        ({"skip_initial": 2.0}, ValueRangeError, "skip_initial: must be ≤ the run's 1 s, got 2"),
        ({"skip_initial": -1.0}, ValueRangeError, "skip_initial: must be ≥ 0, got -1"),
        ({"tolerance": 0.0}, ValueRangeError, "tolerance: must be > 0"),
        ({"limits": Limits.none(3)}, ShapeError, "limits: expected 2 as in the record's q, got 3"),
    ],
)
def test_bad_options(options, kind, message):
    with pytest.raises(kind, match=message):
        evaluate(record(np.linspace(0, 1, 3), along_x(np.ones(3))), **options)


@pytest.mark.parametrize(("share", "starts_off"), [(0.101, True), (0.099, False)])
def test_a_run_starts_on_its_target_if_its_first_error_is_less_than_a_tenth_of_the_largest(share, starts_off):
    time = np.linspace(0, 1, 101)
    x = np.where(time < 0.5, share + (1 - share) * 2 * time, 2 * (1 - time))  # to 1, and back to 0
    found = evaluate(record(time, along_x(0.1 * x)))
    assert np.isfinite(found.settling_band) == starts_off
    assert np.isfinite(found.position_overshoot) == starts_off


@pytest.mark.parametrize("count", [1, 2, 3, 251])
def test_one_pass_finds_what_numpy_finds_signal_by_signal(count):
    arm, start = dqc.load_robot("iiwa7"), np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])
    circle = dqc.references.Circle(arm.fkm(start + 0.1), radius=0.05, duration=2.0)
    plant = dqc.plants.Servo(encoder_noise=1e-3)
    record = part_of(
        dqc.simulate(arm, circle, dqc.laws.Proportional(gain=5.0), plant, start, 0.01, 2.5), 0, count
    )
    found = evaluate(record, arm.limits)
    intervals = np.diff(record.time)
    away = np.linalg.norm(record.desired_position - record.position, axis=1) * 1e3
    speed = np.linalg.norm(np.diff(record.position, axis=0), axis=1) / intervals
    commands = np.linalg.norm(record.command[:-1], axis=1)
    assert found.position.peak == pytest.approx(away.max())
    assert found.orientation.final == pytest.approx(np.degrees(record.orientation_error[-1]))
    assert found.error.peak == pytest.approx(record.error.max())
    if count == 1:
        assert np.isnan([found.position.mean, found.hand_speed.peak, found.saturation]).all()
        return
    duration = intervals.sum()
    assert found.position.mean == pytest.approx(np.trapezoid(away, record.time) / duration)
    exact = np.sum(intervals * (away[1:] ** 2 + away[1:] * away[:-1] + away[:-1] ** 2) / 3)
    assert found.position.rms == pytest.approx(np.sqrt(exact / duration))
    assert found.hand_speed.integral == pytest.approx(np.sum(speed * intervals))
    assert found.control.rms == pytest.approx(np.sqrt(np.sum(commands**2 * intervals) / duration))
    assert found.effort == pytest.approx(np.sqrt(np.sum(commands**2 * intervals)))
    shares = np.abs(record.command[:-1]) / arm.limits.velocity
    assert found.peak_velocity_share == pytest.approx(shares.max())
    assert found.saturation == np.mean(shares.max(axis=1) >= 1 - 1e-9)


def test_speeds_that_fit_no_inputs_are_named():
    arm, car = dqc.load_robot("iiwa7"), dqc.load_robot("youbot")
    record = dqc.simulate(
        arm,
        dqc.references.SetPoint(arm.fkm(np.full(7, 0.3))),
        dqc.laws.Proportional(gain=1.0),
        dqc.plants.Integrator(),
        np.full(7, 0.3),
        0.01,
        0.1,
    )
    with pytest.raises(ShapeError, match="limits: expected 7"):
        evaluate(record, car.limits)


@pytest.mark.parametrize(("first", "is_known"), [(0.9e-6, False), (1.1e-6, True)])
def test_an_error_of_less_than_a_micrometre_has_no_direction_to_overshoot_in(first, is_known):
    found = evaluate(record(np.linspace(0, 1, 3), along_x(first * np.array([1.0, -0.5, 0.0]))))
    assert np.isfinite(found.position_overshoot) == is_known


def test_the_effort_of_a_run_with_actuators_is_theirs():
    time = np.array([0.0, 2.0, 3.0])
    torques = Signal("actuators", ("a", "b"), ("N·m", "N·m"), np.array([[3.0, 4.0], [0.0, 1.0], [9.0, 9.0]]))
    run = replace(record(time, along_x(np.zeros(3))), readings={ACTUATORS: torques})
    assert evaluate(run).effort == pytest.approx(np.sqrt(25 * 2 + 1))

"""Bases that stand under their arms, and those that fall: against MuJoCo's centre of mass and brute force."""

import math
from typing import Any

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.errors import FallenError, ValueRangeError
from dqcontrol.figures.paths import recorded_frames
from dqcontrol.loop.record import has_failed
from dqcontrol.plants import MobilePlant, WheeledBase
from dqcontrol.plants.mobile.mobile_plant import TOPPLED
from dqcontrol.plants.mobile.standing import stance
from dqcontrol.plants.mobile.wheeled_base import running_gear

mujoco: Any = pytest.importorskip("mujoco")

SEED = 20261122
START = np.array([0, 0, 0, 0, -0.8, 0, -2, 0, 1.6, 0.8])
CREATE = dqc.load_robot("little-john").parts[0].chassis
LARGE = dqc.Chassis(mass=60, radius=0.27, height=0.3, wheel_mass=2, wheel_torque=10, caster_distance=0.22)


def on_wheels(chassis, arm="panda", mount=(0.1, 0, 0.4), name="panda on wheels", **limits):
    drive = dqc.DifferentialDrive(0.0985, 0.2022, rim_speed=1.0, chassis=chassis, **limits)
    carried = dqc.load_robot(arm) if isinstance(arm, str) else arm
    return dqc.WholeBody([drive, dqc.DualQuaternion.from_translation(mount), carried], name=name)


def tiago():
    pytest.importorskip("yourdfpy")
    return dqc.load_robot(
        "example-robot-data:tiago_description/robots/tiago_no_hand.urdf",
        "torso_lift_link",
        "wrist_ft_tool_link",
    )


def drive(live, speeds):
    for speed in speeds:
        live.step(np.r_[speed, np.zeros(len(live.q) - 2)])


def test_a_robot_without_a_body_or_with_a_vacuum_cleaners_is_refused():
    for chassis, text in (
        (
            None,
            "body of panda on wheels is unknown.*missing: mass, radius, .*chassis of the differential drive",
        ),
        (
            CREATE,
            "panda on wheels would fall over.*mm outside the line from the .* wheel to the .* caster.*more than",
        ),
    ):
        with pytest.raises(ValueRangeError, match=text):
            MobilePlant().start(on_wheels(chassis), START, 0.02, 1, 0)
    with pytest.raises(
        ValueRangeError, match=r"missing: radius, height, wheel_mass, wheel_torque, caster_distance"
    ):
        MobilePlant(base=WheeledBase(mass=3)).start(on_wheels(None), START, 0.02, 1, 0)


def test_tiagos_arm_needs_tiagos_base():
    arm = tiago()
    start = np.concatenate(
        [np.zeros(3), (np.maximum(arm.limits.lower, -3) + np.minimum(arm.limits.upper, 3)) / 2]
    )
    with pytest.raises(ValueRangeError, match=r"tiago would fall over.*chassis 3 kg"):
        MobilePlant().start(on_wheels(CREATE, arm, (-0.05, 0, 0.8), "tiago"), start, 0.02, 1, 0)
    MobilePlant().start(on_wheels(LARGE, arm, (-0.05, 0, 0.8), "tiago"), start, 0.02, 1, 0)


@pytest.mark.slow
def test_with_a_chassis_it_drives_to_where_it_fell_before():
    robot = on_wheels(LARGE)
    goal = dqc.references.SetPoint(dqc.algebra.pose(robot.fkm(START)[:4], [1.5, 0.8, 0.8]))
    law = dqc.laws.FeedbackLinearization(stiffness=1.0, damping=1.0)
    record = dqc.simulate(robot, goal, law, MobilePlant(), START, period=0.02, duration=9.0)
    assert record.stopped == "duration"
    assert record.readings["tilt"].values.max() < math.radians(2)
    assert record.position_error[-1] < 0.1


def test_the_stance_is_that_of_mujocos_centre_of_mass_and_the_worst_of_many():
    robot = on_wheels(LARGE)
    drive = robot.parts[0]
    arm = dqc.SerialArm.join(robot.parts[1:])
    base = WheeledBase().under(drive, robot.name)
    feet = running_gear(base, drive).feet
    found = stance(base, feet, arm)
    b, c = drive.half_track, LARGE.caster_distance

    def margin(x, y):
        return (1 - np.abs(x) / c - np.abs(y) / b) * b * c / math.hypot(b, c)

    live = MobilePlant().start(robot, START, 0.02, 1, 0)
    body = live.model.body("base").id

    def margin_at(posture):
        live.place(np.concatenate([np.zeros(3), posture]))
        mujoco.mj_kinematics(live.model, live.data)
        mujoco.mj_comPos(live.model, live.data)
        return margin(*live.data.subtree_com[body][:2])

    assert margin_at(found.posture) == pytest.approx(found.margin, abs=1e-9)
    rng = np.random.default_rng(SEED)
    others = rng.uniform(arm.limits.lower, arm.limits.upper, (3000, 7))
    assert found.margin < min(map(margin_at, others)) < found.margin + 0.02
    for factor, stands in ((0.999, False), (1.001, True)):
        lighter = WheeledBase(mass=factor * found.least_mass).under(drive, robot.name)
        assert (stance(lighter, feet, arm).margin > 0) == stands


def tall():
    """Return a plant whose base stands, and falls when it brakes hard."""
    return MobilePlant(base=WheeledBase(centre_height=2.5, wheel_torque=60, friction=3.0))


def test_a_hard_stop_topples_a_tall_robot_and_the_run_says_so():
    robot = on_wheels(LARGE)
    live = tall().start(robot, START, 0.02, 200, 0)
    with pytest.raises(FallenError, match=r"toppled at \d.* s: the base tilts by 2.°, more than 20°"):
        drive(live, [1.0 if k < 50 else -1.0 for k in range(200)])
    hand = dqc.algebra.translation(robot.fkm(START))
    there = dqc.references.Points(
        [0, 1, 2, 3],
        [dqc.algebra.pose(robot.fkm(START)[:4], hand + np.array([x, 0, 0])) for x in (0, 1.0, 0, 0)],
    )
    law = dqc.laws.ProportionalFeedforward(gain=0.5)
    record = dqc.simulate(robot, there, law, tall(), START, period=0.02)
    assert record.stopped.startswith("toppled at")
    assert has_failed(record.stopped)
    assert len(record) < 151
    tilt = record.readings["tilt"].values
    assert 0.5 * TOPPLED < tilt[-1] <= TOPPLED
    frames = recorded_frames(robot, record, slice(None))
    up = dqc.algebra.matrix_from_rotation(frames[-1, 2, :4])[:, 2]
    assert math.acos(up[2]) == pytest.approx(float(tilt[-1, 0]), abs=1e-9), "pictures show it as it tilts"


def test_wheels_that_spin_for_long_end_the_run():
    robot = dqc.load_robot("little-john")
    start = np.array([0, 0, 0, 0, -0.504, 1.397, 0, 0])
    live = MobilePlant(base=WheeledBase(friction=0.0)).start(robot, start, 0.02, 200, 0)
    with pytest.raises(FallenError, match=r"slipped at .* s: a wheel has slid .* 0.3 m/s for 1 s"):
        drive(live, [0.6] * 150)


@pytest.mark.parametrize("plant", [dqc.plants.Servo(), MobilePlant()])
def test_bases_accelerate_as_their_motors_may(plant):
    robot = on_wheels(LARGE, acceleration=0.4, turn_acceleration=0.8)
    live = plant.start(robot, START, 0.02, 150, 0)
    rows = [live.q[:3].copy()]
    for _ in range(100):
        live.step(np.r_[0.6, 12.9, np.zeros(7)] if len(rows) < 25 else np.r_[0.6, 0.0, np.zeros(7)])
        rows.append(live.q[:3].copy())
    turn = np.diff(np.array(rows)[:, 2]) / 0.02
    assert np.abs(np.diff(turn)[:20] / 0.02).max() < 0.8 * 1.5
    assert turn[20] == pytest.approx(0.8 * 0.02 * 20, rel=0.1)

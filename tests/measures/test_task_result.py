"""Whether runs did what was asked: what counts as reached and followed, and what is said where they did not."""

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.errors import LimitWarning, TaskWarning
from dqcontrol.experiments import check
from dqcontrol.experiments.run_comparison import summary
from dqcontrol.loop.record import Record
from dqcontrol.measures.task_result import task_result
from dqcontrol.reports.run_report import run_verdicts

IIWA = {"name": "task", "robot": "iiwa7", "start": [0, 0.6, 0, 1.6, 0, 0.6, 0], "period": 0.01}
AX18 = {"name": "task", "robot": "ax18", "start": [0.2, -0.3, 1.3, -1.0, 0.3], "period": 0.01}
SERVO = {"kind": "servo"}


def record_of(desired_x, hand_x, period=0.01, stopped="duration"):
    """Return a record whose hand and target move along x."""
    n = len(desired_x)
    one = np.tile([1.0, 0, 0, 0], (n, 1))
    pose, desired = (
        dqc.algebra.pose(one, np.column_stack([x, np.zeros((n, 2))])) for x in (hand_x, desired_x)
    )
    samples = np.zeros((n, 21))
    samples[:, :8], samples[:, -1] = desired, period * np.arange(n)
    q = np.zeros((n, 1))
    return Record(samples[:, -1], q, q, q, pose, samples, ("a",), stopped=stopped)


@pytest.mark.parametrize(("left", "outcome"), [(0.0099, "reached"), (0.0101, "not reached")])
def test_within_two_percent_of_the_way_is_reached(left, outcome):
    time = np.linspace(0, 1, 101)
    hand = np.where(time < 0.5, time, 0.5 - left)
    assert task_result(record_of(np.full(101, 0.5), hand)).outcome == outcome


@pytest.mark.parametrize(("left", "outcome"), [(0.0199, "reached"), (0.0201, "not reached")])
def test_the_way_is_that_from_the_start_where_the_reference_began_nearer(left, outcome):
    time = np.linspace(0, 1, 101)
    desired = np.minimum(0.5 + time, 1.0)
    hand = np.minimum(2 * time, 1.0 - left)
    assert task_result(record_of(desired, hand)).outcome == outcome
    turns = [
        np.hstack([np.cos(x / 2), np.sin(x / 2), np.zeros((101, 6))])
        for x in (hand[:, None], desired[:, None])
    ]
    turned = record_of(desired, hand)
    samples = np.hstack([turns[1], turned.desired[:, 8:]])
    assert task_result(replace(turned, pose=turns[0], desired=samples)).outcome == outcome


def test_a_millimetre_is_always_reached_and_two_are_said():
    time = np.linspace(0, 1, 101)
    goal = np.full(101, 0.01)
    assert task_result(record_of(goal, goal - 0.0009 * (time > 0))).words == "reached"
    assert task_result(record_of(goal, goal - 0.002 * (time > 0))).words == "not reached: rests 2 mm off"


def test_an_error_that_comes_and_goes_is_not_reached():
    time = np.linspace(0, 1, 101)
    swinging = 0.5 + 0.1 * np.cos(40 * np.pi * time + np.pi / 2)
    assert abs(swinging[-1] - 0.5) < 1e-6
    assert task_result(record_of(np.full(101, 0.5), swinging)).words.startswith("not reached: still moves")


def test_a_tenth_of_the_motion_is_followed():
    motion = 0.1 * np.sin(np.linspace(0, 6 * np.pi, 3001))
    rms = 0.1 / np.sqrt(2)
    assert task_result(record_of(motion, motion + 0.099 * rms)).outcome == "followed"
    found = task_result(record_of(motion, motion + 0.102 * rms))
    assert found.words == f"not followed: errs by {102 * rms:.3g} mm RMS"
    assert task_result(record_of(motion, motion, stopped="diverged at 1 s: x")).outcome == "failed"


def test_a_path_that_ends_at_speed_is_followed_though_a_supervisor_brakes_at_its_end():
    spec = IIWA | {"law": {"kind": "proportional-feedforward", "gain": 5}, "plant": SERVO}
    spec["reference"] = {"kind": "circle", "radius": 0.05, "duration": 2, "plane": "yz", "ramp": 0.5}
    spec["supervisor"] = {"velocity": 0.8, "acceleration": 5}
    run = dqc.run(spec)
    assert run.record.time[-1] > 2.26, "it brakes after the path's end"
    assert run.verdict.words == "followed"


def test_only_the_part_that_a_law_controls_is_judged():
    base = AX18 | {
        "reference": {"kind": "circle", "radius": 0.03, "duration": 6, "plane": "xy"},
        "plant": SERVO,
    }
    part = dqc.run(base | {"law": {"kind": "partial-proportional", "part": "position", "gain": 15}})
    assert part.task.words == "followed"
    assert part.metrics.orientation.rms > 5
    assert dqc.run(base | {"law": part.law}).task.words == "followed"
    spec = IIWA | {"reference": {"kind": "set-point", "duration": 4, "offset": {"rotation": [0.5, 0, 0]}}}
    spec["law"] = {"kind": "partial-proportional", "part": "axis", "gain": 4, "axis": [1, 0, 0]}
    turned = dqc.run(spec | {"plant": SERVO})
    assert turned.task.words == "reached", "about the axis itself nothing is asked for"


def test_a_run_that_falls_short_says_by_how_much_and_what_helps():
    spec = IIWA | {"law": {"kind": "proportional", "gain": 1}, "plant": SERVO}
    spec["reference"] = {"kind": "set-point", "duration": 1, "offset": {"translation": [0, 0.2, 0]}}
    with pytest.warns(
        TaskWarning,
        match=r"^proportional · servo: too late: .*; not reached: still moves, .* mm, .*° off: .*\(duration: 5\)",
    ):
        run = dqc.run(spec)
    assert dqc.run(spec | {"duration": 5}).task.words == "reached"
    rows: dict[Any, Any] = {row[0]: row for row in run_verdicts(run, None).rows}
    assert rows["End"][1:2] == ["fell short"]
    assert rows["Task"][1].good is False
    assert "counts as reached up to 4 mm, 0.57°" in rows["Task"][2]
    table = summary({"K": run})
    assert table.texts()[0][[column.title for column in table.columns].index("verdict")] == run.verdict.words


@pytest.mark.parametrize(
    ("given", "why"),
    [
        ({"constraints": {"clear_of": "all", "acceleration": 10}}, "held by wall since"),
        ({"plant": {"kind": "mujoco"}}, "saturated: .*"),
    ],
    ids=["constraints", "physics"],
)
@pytest.mark.filterwarnings("ignore::dqcontrol.errors.CollisionWarning")
def test_where_something_is_in_the_way_neither_time_nor_another_start_is_advised(given, why):
    """Joints that press against a wall come to their limits, of positions or of velocities, but not because of them."""
    if "plant" in given:
        pytest.importorskip("mujoco")
    panda = {"robot": "panda", "start": [0, -0.3, 0, -2.0, 0, 1.8, 0.7], "plant": {"kind": "integrator"}}
    spec = IIWA | (given if "plant" in given else panda | given)
    spec["law"] = {"kind": "proportional", "gain": 3}
    spec["world"] = {"wall": {"box": [1, 0.02, 1], "position": [0.5, 0.25, 0.5]}}
    spec["reference"] = {"kind": "set-point", "duration": 6, "offset": {"translation": [0, 0.5, 0]}}
    help_ = "off: reference plan-to goes around what is in the way$"
    with pytest.warns(TaskWarning, match=f"not reached: rests .* {help_}"):
        run = dqc.run(spec)
    assert re.search(why, run.verdict.words)


def test_an_arm_with_five_joints_is_told_before_and_after():
    """A pose takes six; the nearest that ideal joints come to the circle is told before anything moves."""
    spec = AX18 | {
        "reference": {"kind": "circle", "radius": 0.03, "duration": 6, "plane": "xy"},
        "plant": SERVO,
    }
    spec["law"] = {"kind": "proportional", "gain": 8}
    (remark,) = check(spec).remarks()
    assert "cannot be followed by ax18" in remark
    assert "5 joints" in remark
    assert "partial-proportional" in remark
    with pytest.warns(TaskWarning, match="not followed: .*partial-proportional"):
        run = dqc.run(spec)
    told = float(remark.partition("errs by ")[2].split()[0])
    assert run.metrics.position.rms == pytest.approx(told, rel=0.1)
    assert not list(
        check(spec | {"law": {"kind": "partial-proportional", "part": "position", "gain": 8}}).remarks()
    )


def test_a_path_to_the_side_of_a_base_is_told_before(tmp_path):
    """The arm moves in the plane of the wheels' motion only: sideways the hand cannot keep its heading."""
    links = "".join(
        f"  - {{name: j{i}, dh: {{theta: 0, d: 0, a: {a}, alpha: 0}}, limits: {{velocity: 100}}}}\n"
        for i, a in enumerate([0.3, 0.3, 0.2, 0.1])
    )
    (tmp_path / "arm.yaml").write_text(
        f"name: planar\nangles: degrees\nconvention: standard\njoints:\n{links}"
    )
    (tmp_path / "cart.yaml").write_text(
        "name: cart\nangles: radians\nparts:\n"
        "  - {kind: differential-drive, wheel_radius: 0.1, half_track: 0.2, rim_speed: 0.5}\n"
        "  - {kind: pose, position: [0, 0, 0.3], rpy: [1.5707963267948966, 0, 0]}\n"
        "  - {kind: arm, robot: arm.yaml}\n"
    )
    path = {"kind": "spiral", "radius": 1e-4, "length": 0.2, "axis": "y", "duration": 5}
    spec = {"name": "side", "robot": str(tmp_path / "cart.yaml"), "start": [0, 0, 0, 0.9, -0.9, -0.9, 0.3]}
    spec |= {"period": 0.02, "reference": path, "plant": {"kind": "integrator"}}
    spec["law"] = {"kind": "proportional-feedforward", "gain": 1}
    assert any("a base with wheels cannot go sideways" in text for text in check(spec).tasks)
    assert not check(spec | {"reference": path | {"axis": "x"}}).tasks


def test_velocities_that_a_path_needs_are_told_before_and_after():
    circle = {"kind": "circle", "radius": 0.05, "duration": 0.3, "plane": "xz"}
    spec = IIWA | {"reference": circle, "law": {"kind": "proportional-feedforward", "gain": 10}}
    spec["plant"] = {"kind": "integrator"}
    (remark,) = [text for text in check(spec).remarks() if "velocity limit, at t" in text]
    told = float(remark.partition(" at ")[2].split()[0]) / 100
    with pytest.warns(
        LimitWarning, match=r"commands up to .* % of the velocity limits, in .* limits: \{velocity: true\}"
    ):
        run = dqc.run(spec)
    assert run.metrics.peak_velocity_share == pytest.approx(told, rel=0.05)
    assert told > 1
    slower = circle | {"duration": 0.3 * told * 1.05}
    assert not list(check(spec | {"reference": slower}).remarks())
    times = float(remark.partition("make it ")[2].split()[0])
    assert told <= times < told + 0.011, "rounded up: a little more than 1 is never 1"


PANDA = {
    "name": "far",
    "robot": "panda",
    "start": [0, -0.4, 0, -2, 0, 1.6, 0.8],
    "period": 0.008,
    "duration": 6,
    "reference": {"kind": "set-point", "start": {"position": [0.35, 0.45, 0.55]}},
    "law": {"kind": "proportional", "gain": 14},
    "plant": {"kind": "mujoco"},
}


def test_physics_reaches_at_the_recommended_gain_far_from_the_target():
    """Without velocity limits the joints thrash at 480 rad/s and the run ends 0.4 m off, which is said."""
    pytest.importorskip("mujoco")
    checks = check(PANDA)
    assert checks[0].verdict == "oscillatory" or checks[0].worst.limits.recommended / 0.008 >= 14
    run = dqc.run(PANDA)
    assert run.task.words == "reached"
    assert run.metrics.peak_velocity_share == pytest.approx(1)
    assert 0 < run.metrics.saturation < 0.2
    assert "velocity: true" in run.spec
    with pytest.warns(TaskWarning, match="not reached"):
        dqc.run(PANDA | {"limits": {"velocity": False}, "duration": 2})


def test_where_velocity_limits_are_on_unless_told_otherwise():
    arm = dqc.load_robot("iiwa7")
    plants = dqc.plants
    found = {
        str(plant): plants.limits_before(plant, None, arm).velocity
        for plant in (
            plants.Integrator(),
            plants.Servo(),
            plants.Servo(command_mode="measured"),
            plants.MujocoPlant(),
            plants.CompliantPlant(),
        )
    }
    assert list(found.values()) == [False, True, False, True, True]
    off = dqc.limits.CommandLimits(velocity=False)
    assert plants.limits_before(plants.Servo(), off, arm).velocity is False


def test_simulate_and_a_study_of_several_plants_decide_for_each_plant():
    far = {"kind": "set-point", "duration": 1, "offset": {"translation": [0, 0.4, 0]}}
    spec = IIWA | {"reference": far, "law": {"kind": "proportional", "gain": 15}}
    spec["plants"] = {"ideal": {"kind": "integrator"}, "servo": SERVO}
    study = dqc.run_study(spec, jobs=1)
    peaks = [row["peak_velocity_share"] for row in study.rows]
    assert peaks[0] > 1.5
    assert peaks[1] == pytest.approx(1)
    arm, q = dqc.load_robot("iiwa7"), IIWA["start"]
    goal = dqc.references.SetPoint(
        dqc.algebra.pose(arm.fkm(q)[:4], dqc.algebra.translation(arm.fkm(q)) + np.array([0, 0.4, 0]))
    )
    law = dqc.laws.Proportional(gain=15.0)
    by_hand = dqc.simulate(arm, goal, law, dqc.plants.Servo(), q, period=0.01, duration=1.0)
    (servo,) = [run for label, run in study.runs.items() if "servo" in label]
    assert np.array_equal(by_hand.q, servo.q)


UPRIGHT = IIWA | {
    "start": [0.0] * 7,
    "duration": 6.0,
    "reference": {"kind": "set-point", "offset": {"translation": [0, 0, -0.1]}},
    "plant": {"kind": "integrator"},
}


@pytest.mark.parametrize("kind", ["proportional", "linear-quadratic-dq"])
def test_a_law_that_rests_in_a_singularity_says_so(kind):
    """Upright and wanted straight down: every command is zero, and the hand rests 100 mm off."""
    law: dict[str, Any] = {"kind": kind}
    law |= {"gain": 5.0} if kind == "proportional" else {"error_weight": 25.0, "control_weight": 1.0}
    spec = UPRIGHT | {"law": law}
    (told,) = (remark for remark in check(spec).remarks() if "singularity" in remark)
    assert "every command is zero; start elsewhere, or leave it with null_space" in told
    with pytest.warns(
        TaskWarning, match="rests 100 mm off in a singularity: no joint can move .* start elsewhere"
    ):
        run = dqc.experiments.run(spec)
    assert run.task.is_singular
    assert run.task.words == "not reached: rests 100 mm off in a singularity"


def test_what_is_offered_leads_out_of_a_singularity():
    out = {"kind": "proportional", "gain": 5.0, "null_space": {"kind": "manipulability", "gain": 1.0}}
    spec = UPRIGHT | {"law": out}
    assert not any("singularity" in remark for remark in check(spec).remarks())
    assert dqc.experiments.run(spec).task.words == "reached"


def test_a_goal_beside_the_lost_direction_is_no_singular_start():
    spec = UPRIGHT | {
        "law": {"kind": "proportional", "gain": 5.0},
        "start": [0, 0.5, 0, 0, 0, 0, 0],
    }
    assert not any("singularity" in remark for remark in check(spec).remarks())
    assert dqc.experiments.run(spec).task.words == "reached"


@pytest.mark.parametrize(("last", "outcome"), [(0.09, "reached"), (0.11, "followed")])
def test_a_motion_ends_at_rest_if_its_last_step_is_a_tenth_of_the_largest(last, outcome):
    way = 0.1 * np.cumsum(np.r_[0.0, np.linspace(1.0, last, 100)]) / 100
    assert task_result(record_of(way, way)).outcome == outcome


@pytest.mark.parametrize(("sideways", "is_singular"), [(1.70, True), (1.76, False)])
def test_a_singularity_is_in_the_way_from_half_of_the_error_on(sideways, is_singular):
    """Upright, no joint moves the hand down: 1/√(1 + s²) of an error of 1 down and s to the side, ½ at √3."""
    arm, upright = dqc.load_robot("iiwa7"), np.zeros(7)
    pose = arm.fkm(upright)
    goal = dqc.algebra.multiply(dqc.algebra.pose([1, 0, 0, 0], [0.1 * sideways, 0, -0.1]), pose)
    samples = np.zeros((50, 21))
    samples[:, :8], samples[:, -1] = goal, 0.01 * np.arange(50)
    q, poses = np.zeros((50, 7)), np.tile(pose, (50, 1))
    resting = Record(samples[:, -1], q, q, q, poses, samples, arm.joint_names)
    assert task_result(resting, robot=arm).is_singular == is_singular


@pytest.mark.parametrize(("at", "outcome"), [(890, "reached"), (910, "not reached")])
def test_the_last_tenth_of_the_rest_decides(at, outcome):
    goal = np.full(1001, 0.5)
    hand = goal - 0.1 * (np.arange(1001) == at)
    hand[0] = 0.0
    assert task_result(record_of(goal, hand)).outcome == outcome


def test_of_an_axis_turns_about_it_do_not_count():
    still = record_of(np.full(101, 0.5), np.full(101, 0.5))
    turned = replace(
        still, pose=np.tile(dqc.algebra.pose([np.cos(0.5), 0, 0, np.sin(0.5)], [0.5, 0, 0]), (101, 1))
    )
    for part, axis, outcome in (
        ("axis", (0, 0, 2), "reached"),
        ("axis", (0, 1, 0), "not reached"),
        ("rotation", (0, 0, 1), "not reached"),
    ):
        law = dqc.laws.PartialProportional(part=part, axis=axis, gain=1.0)
        assert task_result(turned, law=law).outcome == outcome


def test_a_run_that_its_stop_ended_did_what_it_asked():
    time = np.linspace(0, 1, 101)
    off = record_of(np.full(101, 0.5), np.minimum(time, 0.45), stopped="settled")
    assert task_result(off).outcome == "reached"
    assert task_result(record_of(time, time - 0.2 * time, stopped="settled")).outcome == "followed"

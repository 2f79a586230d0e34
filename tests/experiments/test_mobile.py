"""Mobile manipulators from a spec to the files of a run: names, units, references, reach, a lost camera, bad input."""

import csv
import re
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest
import yaml

import dqcontrol as dqc
from dqcontrol.cli import main
from dqcontrol.errors import Error, NoteWarning, ReachError
from dqcontrol.experiments import check, load_run, run_study
from dqcontrol.experiments.feasibility import path_demand
from dqcontrol.experiments.prepared_experiment import prepare

MODELS = Path(dqc.__file__).parent / "robots" / "models"
EXAMPLES = Path(__file__).parents[2] / "examples"
START = [0, 0, 0, 0, -0.9, 0.9, 0.9, 0]
SPEC = {
    "name": "mobile",
    "robot": "little-john",
    "start": START,
    "period": 0.05,
    "duration": 1.0,
    "reference": {"kind": "set-point", "start": {"position": [0.6, 0.1, 0.35]}},
    "law": {"kind": "feedback-linearization", "stiffness": 1.0, "damping": 1.0},
    "plant": {"kind": "integrator"},
}


@pytest.fixture(scope="module")
def mobile():
    with warnings.catch_warnings():
        warnings.simplefilter("error", NoteWarning)  # an example has nothing to be completed
        return dqc.run(EXAMPLES / "mobile.yaml")


def test_the_example_drives_metres_away_and_reaches(mobile):
    body, record = mobile.robot, mobile.record
    assert np.linalg.norm(record.desired_position[0] - record.position[0]) > 1.9
    assert np.linalg.norm(record.q[-1, :2] - record.q[0, :2]) > 1.5
    assert record.position_error[-100:].max() < 0.01
    assert np.degrees(record.orientation_error[-100:].max()) < 1.0
    assert mobile.metrics.limit_margin >= 0
    rims = np.abs(record.readings["actuator_command"].values[:, :2]) * 0.065
    assert rims.max() <= 0.5 * (1 + 1e-9)
    assert body.input_names[:2] == ("v", "omega")


def test_wheel_speeds_are_recorded_and_make_the_effort(mobile, tmp_path):
    """[S17 4.25, Table 5.1] by hand: ω = (v ± b ω)/r with r = 0.065, b = 0.13."""
    u = mobile.record.command
    wheels = np.column_stack([u[:, 0] + 0.13 * u[:, 1], u[:, 0] - 0.13 * u[:, 1]]) / 0.065
    expected = np.hstack([wheels, u[:, 2:]])
    signal = mobile.record.readings["actuator_command"]
    assert signal.parts == ("right_wheel", "left_wheel", *(f"joint_{i}" for i in range(1, 6)))
    assert set(signal.units) == {"rad/s"}
    np.testing.assert_allclose(signal.values, expected, rtol=1e-12, atol=1e-15)
    assert mobile.metrics.effort == pytest.approx(np.sqrt((expected[:-1] ** 2).sum() * 0.05))
    mobile.save(tmp_path / "run", figures=False)
    saved = load_run(tmp_path / "run")
    np.testing.assert_array_equal(saved.record.readings["actuator_command"].values, signal.values)
    assert saved.metrics == mobile.metrics


@pytest.mark.slow
def test_a_saved_run_has_pictures_of_the_base(mobile, tmp_path):
    mobile.save(tmp_path / "run")
    page = (tmp_path / "run/report.html").read_text(encoding="utf-8")
    assert {"base", "motion"} <= {*re.findall('<figure id="(.*?)">', page)}


def test_exports_name_coordinates_and_inputs_with_their_units(mobile, tmp_path):
    with mobile.export(tmp_path / "log.csv").open(encoding="utf-8") as file:
        heading = next(csv.reader(file))
    for name in ("x [m]", "y [m]", "phi [rad]", "joint_1 [rad]", "measured.x [m]", "command.v [m/s]"):
        assert name in heading
    for name in ("command.omega [rad/s]", "command.joint_1 [rad/s]", "actuator_command.left_wheel [rad/s]"):
        assert name in heading


def test_unconstrained_bodies_record_what_their_wheels_are_told():
    body = dqc.load_robot("little-john").in_form("unconstrained")
    goal = dqc.references.SetPoint(body.fkm(np.add(START, [0.2, 0.1, 0.2, 0, 0.1, 0, 0, 0])))
    law = dqc.laws.Proportional(gain=1.0)
    record = dqc.simulate(body, goal, law, dqc.plants.Integrator(), START, 0.05, 1.0)
    expected = np.einsum("kij,kj->ki", body.input_map(record.q), record.command)
    np.testing.assert_allclose(record.readings["actuator_command"].values, expected, atol=1e-12)


def test_arms_have_no_wheels():
    arm = dqc.load_robot("iiwa7")
    q = np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])
    goal, law = dqc.references.SetPoint(arm.fkm(q + 0.1)), dqc.laws.Proportional(gain=1.0)
    record = dqc.simulate(arm, goal, law, dqc.plants.Integrator(), q, 0.05, 1.0)
    assert not record.readings
    effort = dqc.measures.metrics.evaluate(record).effort
    assert effort == pytest.approx(np.sqrt((record.command[:-1] ** 2).sum() * 0.05))


FAR = {
    "set-point 20 m away": {"kind": "set-point", "start": {"position": [20.0, -5.0, 0.4]}},
    "drawing": {"kind": "drawing", "file": str(EXAMPLES / "drawings/flower.txt")},
    "circle of 3 m": {"kind": "circle", "radius": 1.5, "plane": "xy", "duration": 60},
    "via points": {
        "kind": "via-points",
        "file": str(EXAMPLES / "points/arch.csv"),
        "transform": {"position": [3, 2, -0.05]},
    },
}


@pytest.mark.parametrize("label", FAR)
def test_bases_reach_what_arms_cannot(label):
    setting = prepare(
        {**SPEC, "duration": None if label != "set-point 20 m away" else 1.0, "reference": FAR[label]}
    )
    assert len(setting.scene.samples) > 1


def test_no_base_reaches_the_ceiling():
    with pytest.raises(
        ReachError, match=r"^reference: at t = 0 s .* out of reach of little-john: .* 1\.71 m beyond"
    ):
        prepare({**SPEC, "reference": {"kind": "set-point", "start": {"position": [1.0, 0.0, 2.5]}}})


def test_a_pose_trajectory_with_twist_is_followed_while_driving(tmp_path):
    """An S of 5 m through poses of a file, with twist and twist rate: the law follows without lag."""
    body, q, rows = dqc.load_robot("little-john"), np.array(START), []
    for k in range(26):
        pose = body.fkm(q)
        rows.append([k, *dqc.algebra.translation(pose), *pose[:4]])
        q = body.integrate(q, [0.2, 0.3 * np.sin(0.25 * k), 0, 0, 0, 0, 0], 1.0)
    path = tmp_path / "s.csv"
    heading = "time,x,y,z,qw,qx,qy,qz\n"
    path.write_text(heading + "".join(",".join(map(str, row)) + "\n" for row in rows))
    reference = {"kind": "via-points", "file": str(path), "ramp": 2.0}
    law = {"kind": "feedback-linearization", "stiffness": 6.0, "damping": 3.0}
    run = dqc.run({**SPEC, "duration": None, "skip_initial": 10.0, "reference": reference, "law": law})
    assert np.abs(run.record.desired[:, 14:20]).max() > 0.01
    assert np.ptp(run.record.q[:, :2], axis=0).max() > 3.0
    assert run.metrics.position.settled_peak < 10.0  # mm


def test_a_lost_camera_stops_the_robot_in_time_and_is_got_over():
    """0.5 s of patience, 0.5 s to stop, and the lags of base and servos."""
    runs = run_study(EXAMPLES / "lost-camera.yaml").runs
    seen, lost = (run.record for run in runs.values())
    speed = np.hypot(*np.diff(lost.q[:, :2], axis=0).T) / 0.05
    time = lost.time[:-1]
    before = speed[(time > 3.5) & (time < 4.0)].min()
    assert before > 0.05
    last_frame = 4.0 + 0.05  # its arrival
    stopped = (time > last_frame + 1.0 + 5 * 0.1) & (time < 10.0)
    assert speed[stopped].max() < 0.02 * before
    slowing = (time > last_frame + 0.5) & (time < last_frame + 1.0)
    assert (np.diff(speed[slowing]) < 0).all()
    arm = np.abs(np.diff(lost.q[:, 3:], axis=0)).max(axis=1) / 0.05
    assert arm[(time > 3.5) & (time < 4.0)].min() > 0.3
    assert arm[stopped].max() < 0.01
    assert lost.orientation_error.max() < 2 * seen.orientation_error.max(), "the hand is not turned blindly"
    assert lost.readings["command_share"].values[:, 0].min() == 0.0
    assert seen.readings["command_share"].values.min() == 1.0
    for record in (seen, lost):
        assert record.position_error[-100:].max() < 0.01


DRIVE = {"kind": "differential-drive", "wheel_radius": 0.065, "half_track": 0.13}
ARM = {"kind": "arm", "robot": "ax18"}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"displacement": 0}, "displacement: must not be 0"),
        ({"wheel_radius": 0}, "wheel_radius: must be > 0, got 0"),
        ({"wheel_radius": -0.1}, r"wheel_radius: must be > 0, got -0\.1"),
        ({"half_track": 0}, "half_track: must be > 0, got 0"),
        ({"half_track": -1}, "half_track: must be > 0, got -1"),
        ({"rim_speed": 0}, "rim_speed: must be > 0, got 0"),
    ],
)
def test_drives_that_cannot_be(changes, message, tmp_path, capsys, monkeypatch):
    numbers = {key: value for key, value in (DRIVE | changes).items() if key != "kind"}
    with pytest.raises(Error, match=message):
        dqc.DifferentialDrive(**numbers)
    robot = tmp_path / "robot.yaml"
    robot.write_text(yaml.safe_dump({"name": "r", "angles": "radians", "parts": [DRIVE | changes, ARM]}))
    if "displacement" not in changes:  # the file's reader sees the others first
        field, value = next(iter(changes.items()))
        message = rf"robot\.yaml: parts\[0\]\.{field}: expected a number > 0\.0, got {value}"
    _refused({**SPEC, "robot": str(robot)}, message, tmp_path, capsys, monkeypatch)


def test_limits_the_wrong_way_round(tmp_path, capsys, monkeypatch):
    joint = {
        "name": "a",
        "type": "revolute",
        "pose": {},
        "axis": [0, 0, 1],
        "limits": {"lower": 1, "upper": -1},
    }
    arm, robot = tmp_path / "arm.yaml", tmp_path / "robot.yaml"
    arm.write_text(yaml.safe_dump({"name": "arm", "angles": "radians", "joints": [joint]}))
    robot.write_text(
        yaml.safe_dump(
            {"name": "r", "angles": "radians", "parts": [DRIVE, {"kind": "arm", "robot": "arm.yaml"}]}
        )
    )
    message = "lower 1 ≥ upper -1; lower must be below upper"
    _refused({**SPEC, "robot": str(robot), "start": [0, 0, 0, 0]}, message, tmp_path, capsys, monkeypatch)


@pytest.mark.parametrize(
    ("start", "message"),
    [
        ([0, 0, 0, 0, -0.9, 2.7, 0.9, 0], r"start: joint_3 is 2\.7, outside its limits -2\.618 … 2\.618"),
        ([0, 0, 0], r"start: expected shape \(…, 8\), got shape \(3,\)"),
    ],
)
def test_starts_that_do_not_fit(start, message, tmp_path, capsys, monkeypatch):
    _refused({**SPEC, "start": start}, message, tmp_path, capsys, monkeypatch)


def test_three_numbers_where_two_inputs_belong():
    base = dqc.WholeBody([dqc.DifferentialDrive(wheel_radius=0.065, half_track=0.13)])
    message = r"expected shape \(…, 2\), got shape \(3,\); the inputs of .* are v, omega"
    for call in (
        lambda: base.integrate([0, 0, 0], [0.1, 0, 0.2], 0.1),
        lambda: base.wheel_speeds([0.1, 0, 0.2]),
    ):
        with pytest.raises(Error, match=message):
            call()


def _refused(spec, message, tmp_path, capsys, monkeypatch):
    """Refuse a spec in one line, from Python and from the command line."""
    with pytest.raises(Error, match=message):
        dqc.run(spec)
    path = tmp_path / "spec.yaml"
    path.write_text(yaml.safe_dump(spec))
    monkeypatch.setattr(sys, "argv", ["dqcontrol", "run", str(path), "--out", str(tmp_path / "out")])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    printed = capsys.readouterr()
    assert len(printed.err.strip().splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_every_number_of_a_base_counts_for_an_unfinished_study(tmp_path):
    """Wheels, limits and chassis: what was done with others is not taken over."""
    model = Path(dqc.robots.__file__).parent / "models/little-john.yaml"
    text, found = model.read_text(), []
    changes = {
        "mass: 3,": "mass: 4,",
        "wheel_torque: 0.3": "wheel_torque: 0.2",
        "centre_ahead: 0.03": "centre_ahead: 0.02",
    }
    for old, new in {
        "": "",
        **changes,
        "radius: 0.065": "radius: 0.07",
        "rim_speed: 0.5": "rim_speed: 0.4",
    }.items():
        (tmp_path / "robot.yaml").write_text(text.replace(old, new) if old else text)
        found.append(prepare(SPEC | {"robot": str(tmp_path / "robot.yaml")}).fingerprint())
    assert len(set(found)) == len(found) == 6


WAY = {
    "name": "way",
    "robot": "little-john",
    "start": [0, 0, 0, 0, -0.9, 0.9, 0.9, 0],
    "period": 0.02,
    "reference": {
        "kind": "drive-to",
        "offset": {"translation": [-1.2, 0.8, 0], "rotation": [0, 0, 2.5]},
        "speed_fraction": 0.9,
    },
    "law": {"kind": "guided-proportional", "gain": 1},
    "plant": {"kind": "integrator"},
}


def test_a_plan_is_judged_in_its_own_configurations():
    """Followed by its hand alone, in other configurations, it would need joints beyond their limits."""
    demand = path_demand(prepare(WAY).scenes[""])
    assert demand is not None
    assert demand.left.succeeded
    assert demand.peak_share == pytest.approx(0.9, abs=0.02)
    assert not any("velocity limit" in remark for remark in check(WAY).remarks())


def test_a_base_that_nothing_limits_is_said(tmp_path):
    part = yaml.safe_load((MODELS / "little-john.yaml").read_text(encoding="utf-8"))
    del part["parts"][0]["rim_speed"]
    (tmp_path / "free.yaml").write_text(yaml.safe_dump(part))
    body = dqc.load_robot(tmp_path / "free.yaml")
    free = {"robot": str(tmp_path / "free.yaml"), "start": [0] * body.configuration_size, "period": 0.02}
    spec = {**SPEC, **free, "law": {"kind": "proportional", "gain": 1}}
    spec["reference"] = {"kind": "set-point", "offset": {"translation": [-0.1, 0, 0]}}
    said = [remark for remark in check(spec).remarks() if "no velocity limit" in remark]
    assert len(said) == 1
    assert f": no velocity limit of {body.input_names[0]}" in said[0]
    with pytest.warns(NoteWarning, match="no velocity limit of"):
        dqc.run(spec)
    assert not any(
        "no velocity limit" in remark for remark in check({**spec, "robot": "little-john"}).remarks()
    )


def test_laws_whose_error_depends_on_the_origin_say_how_far_it_is():
    far = {**WAY, "start": [10, 0, 0, 0, -0.9, 0.9, 0.9, 0], "duration": 1}
    far |= {"reference": {"kind": "set-point", "offset": {"translation": [-0.1, 0, 0]}}}
    law = {"kind": "h-infinity", "orientation_gain": 2, "translation_gain": 1}
    weights = {"error_weight": 1, "control_weight": 1}
    del far["law"]
    far["laws"] = {
        "HIR": law,
        "HIRT": law | {"kind": "h-infinity-tracking"},
        "left": law | {"form": "left"},
        "DQ": weights | {"kind": "linear-quadratic-dq"},
        "R8": weights | {"kind": "linear-quadratic-r8"},
    }
    said = [remark for remark in check(far).remarks() if "where the origin is" in remark]
    assert [line.partition(" ")[0] for line in said] == ["HIR", "HIRT", "DQ"]
    assert "10.3 m from it an orientation error of 1° counts as 180 mm" in said[0]
    assert "take form: left" in said[0]
    assert "take error: left" in said[2]
    near = {**far, "start": WAY["start"]}
    assert not any("where the origin is" in remark for remark in check(near).remarks())
    single = {key: value for key, value in far.items() if key != "laws"} | {"law": law}
    with pytest.warns(NoteWarning, match="h-infinity · integrator: its error depends on where the origin is"):
        dqc.run(single)

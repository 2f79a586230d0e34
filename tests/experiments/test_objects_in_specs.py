"""Specs whose robot, reference, laws and plants are Python objects, and records and runs as texts."""

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.errors import Error, ShapeError
from dqcontrol.experiments import check, load_run, summary
from dqcontrol.experiments.spec import read_spec
from dqcontrol.files.yaml_file import parse_yaml
from dqcontrol.recording import load_record, save_record
from dqcontrol.tables import Column, Table

Q = [0, 0.6, 0, 1.6, 0, 0.6, 0]


@pytest.fixture(scope="module")
def arm():
    return dqc.load_robot("iiwa7")


def spec(robot, reference):
    return {
        "name": "objects",
        "robot": robot,
        "start": np.array(Q),
        "period": 0.01,
        "reference": reference,
        "laws": {"K": dqc.laws.Proportional(gain=4.0), "K+FF": dqc.laws.ProportionalFeedforward(gain=4.0)},
        "plant": dqc.plants.Servo(time_constant=0.02),
    }


def test_a_study_of_objects_is_that_of_their_names(arm):
    circle = dqc.references.Circle(arm.fkm(Q), radius=0.05, duration=0.5)
    ours = dqc.run_study(spec(arm, circle))
    named = spec("iiwa7", {"kind": "circle", "radius": 0.05, "duration": 0.5})
    laws = {"K": {"kind": "proportional", "gain": 4}, "K+FF": {"kind": "proportional-feedforward", "gain": 4}}
    theirs = dqc.run_study({**named, "laws": laws, "plant": {"kind": "servo", "time_constant": 0.02}})
    for label, run in ours.runs.items():
        assert np.abs(run.q - theirs.runs[label].q).max() < 1e-12
        again = dqc.run(read_spec_text(run.spec))
        assert np.array_equal(again.q, run.q)  # what is saved repeats it


def read_spec_text(text):
    return parse_yaml("spec", text)


def test_an_arm_made_in_python_is_saved_with_its_run(arm, tmp_path):
    own = dqc.SerialArm.from_dh(
        theta=[0, 0, 0], d=[0.2, 0, 0.1], a=[0.4, 0.3, 0], alpha=[0, np.pi, 0],
        joint_types=["revolute", "revolute", "prismatic"],
        name="scara", limits=dqc.Limits([-2, -2, 0], [2, 2, 0.2], [1, 1, 1], [np.inf] * 3),
    )  # fmt: skip
    data = spec(own, {"kind": "set-point", "duration": 0.2})
    law = {"kind": "partial-proportional", "part": "position", "gain": 4.0}
    done = dqc.run(one(data, law))
    done.save(tmp_path / "run", figures=False)
    back = load_run(tmp_path / "run")
    assert np.allclose(back.robot.fkm([0.1, 0.2, 0.05]), own.fkm([0.1, 0.2, 0.05]), atol=1e-15)
    assert back.robot.limits.upper.tolist() == [2, 2, 0.2]
    assert np.array_equal(dqc.run(tmp_path / "run/spec.yaml").q, done.q)
    assert arm.origin == ("iiwa7", None, None)


def one(data, law):
    return {key: value for key, value in data.items() if key != "laws"} | {
        "start": [0.3, 0.4, 0.1],
        "law": law,
    }


@pytest.mark.slow
def test_a_curve_runs_and_says_that_a_file_cannot_hold_it(arm, tmp_path):
    x, y, z = dqc.algebra.translation(arm.fkm(Q))
    curve = dqc.references.Curve(lambda t: [x, y + 0.02 * np.sin(t) ** 3, z], duration=0.5, start=arm.fkm(Q))
    study = dqc.run_study(spec(arm, curve), jobs=2)
    assert study.runs["K+FF · servo"].metrics.position.peak < 2
    study.save(tmp_path / "study", figures=False)
    assert (
        load_run(tmp_path / "study/K-servo").metrics.position.peak
        == study.runs["K · servo"].metrics.position.peak
    )
    text = study.spec.replace(read_spec(read_spec_text(study.spec))[0].reference.token, "gone")
    with pytest.raises(
        Error, match=r"reference: Curve\(function=<lambda>, .* was an object of the program that ran"
    ):
        dqc.run_study(read_spec_text(text))


def test_whole_bodies_made_in_python_are_refused():
    base = dqc.WholeBody([dqc.DifferentialDrive(wheel_radius=0.04, half_track=0.13)])
    with pytest.raises(
        Error, match=r"robot: WholeBody.* was made in Python; write it as a file with 'parts'"
    ):
        read_spec(spec(base, {"kind": "set-point", "duration": 1}))


@pytest.fixture(scope="module")
def record(arm):
    reference = dqc.references.SetPoint(arm.fkm(Q), duration=0.1)
    law, plant = dqc.laws.Proportional(gain=4.0), dqc.plants.Integrator()
    return dqc.simulate(arm, reference, law, plant, Q, period=0.01)


def test_records_without_a_spec_are_measured_and_saved(record, tmp_path):
    assert dqc.measures.evaluate(record).duration == pytest.approx(0.1)
    assert np.array_equal(load_record(save_record(record, tmp_path / "record.mcap")).q, record.q)
    assert summary({"mine": record}).rows[0][0] == "mine"


@pytest.mark.parametrize("text", ["", " \n", "law: {}"])
def test_a_run_without_a_spec_is_refused(arm, record, text):
    with pytest.raises(ShapeError, match=r"spec: must be the YAML text .* summary\({\"mine\": record}\)"):
        dqc.Run(text, arm, record, 0.0, "mine")


def test_printed_tables_are_tables():
    table = Table([Column("Law"), Column("Length", "m", ".2f")], [["K", 1.2345], ["LQR", None]], "Ways")
    assert str(table).splitlines()[-2:][0].split() == ["│", "LQR", "│", "–", "│"]
    assert repr(table) == "Table('Ways', 2 × 2)"


def test_representations_are_short(arm, record):
    circle = dqc.references.Circle(arm.fkm(Q), radius=0.05, duration=4.0)
    single = {**one(spec(arm, circle), dqc.laws.Proportional(gain=4.0)), "start": Q, "duration": 0.1}
    run, checks = dqc.run(single), check(single)
    found = arm.solve(arm.fkm(Q), Q)
    objects = [
        arm, arm.limits, arm.inertia, found, arm.solve(np.tile(arm.fkm(Q), (3, 1)), Q), circle,
        dqc.references.Sequence([circle, circle]), dqc.references.Curve(lambda t: [t, 0, 0], duration=1.0),
        dqc.laws.Proportional(gain=4.0), dqc.plants.Servo(), record, run.metrics, run, dqc.run_study(single),
        checks, checks[0], summary({"mine": record}), dqc.DualQuaternion.identity(),
        dqc.WholeBody([dqc.DifferentialDrive(wheel_radius=0.04, half_track=0.13)]),
    ]  # fmt: skip
    for each in objects:
        assert "\n" not in repr(each)
        assert len(repr(each)) <= 160, repr(each)
    assert (
        repr(circle)
        == f"Circle(start={place(arm)}, radius=0.05, duration=4, plane='xz', turns=1, clockwise=True)"
    )
    assert repr(dqc.plants.Servo(delay=0.02)) == "Servo(delay=0.02)"
    assert repr(found) == "Solution([0, 0.6, 0, 1.6, 0, 0.6, 0], reached)"
    assert repr(run).startswith("Run('proportional · servo', 11 samples over 0.1 s")
    assert "│" in str(run)
    for rich in (found, checks, run.metrics):
        assert "|--" in rich._repr_markdown_() or "|:--" in rich._repr_markdown_()


def place(arm):
    x, y, z = dqc.algebra.translation(arm.fkm(Q))
    return f"pose at ({x:.4g}, {y:.4g}, {z:.4g})"

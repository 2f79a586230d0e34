"""Runs: whole, repeatable, saved."""

import json

import msgspec
import numpy as np
import pytest
import yaml

import dqcontrol as dqc
from dqcontrol.errors import Error, ExistsError, ShapeError
from dqcontrol.experiments.prepared_experiment import prepare
from dqcontrol.experiments.run import as_run, execute, run

FEEDFORWARD = {"kind": "proportional-feedforward", "gain": 10}
BASE = {
    "name": "circle",
    "robot": "iiwa7",
    "start": [0, 0.6, 0, 1.6, 0, 0.6, 0],
    "period": 0.01,
    "reference": {"kind": "circle", "radius": 0.07, "duration": 2},
    "law": FEEDFORWARD,
    "plant": {"kind": "integrator"},
}
SERVO = {"kind": "servo", "delay": 0.02, "encoder_noise": 1e-4, "sag": 0.1, "stiffness": 900}


def same(one, other):
    return all(
        np.array_equal(getattr(one.record, name), getattr(other.record, name))
        for name in ("time", "q", "measured", "command", "pose", "desired")
    )


def test_a_run_is_what_its_spec_says():
    result = run({**BASE, "duration": 1.5})
    assert result.time == pytest.approx(0.01 * np.arange(151))
    assert result.q[0] == pytest.approx(BASE["start"], abs=0)
    assert result.pose == pytest.approx(dqc.load_robot("iiwa7").fkm(result.q), abs=1e-14)
    assert result.q[1:] == pytest.approx(result.q[:-1] + 0.01 * result.command[:-1], abs=1e-14)
    assert result.record.joint_names == result.robot.joint_names
    assert result.record.stopped == "duration"
    assert result.label == "proportional-feedforward · integrator"
    assert result.metrics.position.peak < 0.5  # mm
    assert result.error.shape == (151,)
    assert result.desired.shape == (151, 8)


@pytest.mark.parametrize(
    "changes",
    [
        {"law": {"kind": "proportional", "gain": {"times": [0, 1], "values": [2, 8]}}},
        {"plant": SERVO, "seed": 7},
        {"plant": {**SERVO, "command_mode": "measured"}, "reference": {"kind": "set-point"}, "duration": 1},
        {"stop": {"error": 0.03, "samples": 3}, "duration": 3,
         "reference": {"kind": "set-point", "offset": {"translation": [0.1, 0, 0]}}},
        {"reference": {"kind": "spiral", "radius": 0.03, "length": 0.05, "duration": 1, "axis": [0, 1, 0]}},
        {"reference": {"kind": "square", "side": 0.05, "duration": 1, "plane": [[0, 1, 0], [0, 0, 1]],
                       "offset": {"rotation": [0.1, 0, 0]}}},
    ],
    ids=["schedule", "servo", "measured", "stop", "spiral", "square"],
)  # fmt: skip
def test_resolved_text_runs_again_to_the_last_bit(tmp_path, changes):
    first = run({**BASE, **changes})
    path = tmp_path / "spec.yaml"
    path.write_text(first.spec, encoding="utf-8")
    again = run(path)
    assert same(first, again)
    assert same(first, run(path, interpreted=True))
    assert again.record.stopped == first.record.stopped == ("settled" if "stop" in changes else "duration")
    assert again.spec == first.spec


def test_relative_files_and_a_spec_elsewhere(tmp_path):
    (tmp_path / "line.txt").write_text("speed 0.1\nline 0.05 0\n")
    path = tmp_path / "spec.yaml"
    path.write_text(yaml.safe_dump({**BASE, "reference": {"kind": "drawing", "file": "line.txt"}}))
    first = run(path)
    (tmp_path / "elsewhere").mkdir()
    other = tmp_path / "elsewhere" / "spec.yaml"
    other.write_text(first.spec, encoding="utf-8")
    assert same(first, run(other))
    travelled = np.linalg.norm(np.diff(first.record.desired_position, axis=0), axis=1).sum()
    assert travelled == pytest.approx(0.05, abs=1e-4)


def test_the_seed_draws_the_noise():
    one, two, other = (run({**BASE, "plant": SERVO, "seed": seed}) for seed in (1, 1, 2))
    assert same(one, two)
    assert not np.array_equal(one.q, other.q)


def test_start_and_offset_place_the_reference():
    hand = dqc.load_robot("iiwa7").fkm(BASE["start"])
    offset = {"translation": [0.01, -0.02, 0.03], "rotation": [0, 0, 0.2]}
    setting = prepare({**BASE, "reference": {"kind": "set-point", "offset": offset}, "duration": 1})
    turned = dqc.algebra.multiply([np.cos(0.1), 0, 0, np.sin(0.1), 0, 0, 0, 0], [*hand[:4], 0, 0, 0, 0])[:4]
    wanted = dqc.algebra.pose(turned, dqc.algebra.translation(hand) + np.array(offset["translation"]))
    assert setting.scene.samples[:, :8] == pytest.approx(np.tile(wanted, (101, 1)), abs=1e-14)
    start = {"position": [0.4, 0.1, 0.5], "quaternion": [0, 1, 0, 0]}
    setting = prepare({**BASE, "reference": {"kind": "set-point", "start": start}, "duration": 1})
    wanted = dqc.algebra.pose([0, 1, 0, 0], [0.4, 0.1, 0.5])
    assert setting.scene.samples[0, :8] == pytest.approx(wanted, abs=1e-14)


def test_several_laws_are_a_study():
    data = {key: value for key, value in BASE.items() if key != "law"}
    data["laws"] = {"slow": {**FEEDFORWARD, "gain": 1}, "fast": FEEDFORWARD}
    with pytest.raises(ShapeError, match=r"^spec: describes several runs; use dqcontrol.run_study for it$"):
        run(data)
    setting = prepare(data)
    case = setting.cases[1]
    fast = as_run(setting, case, 0, execute(setting, case))
    assert fast.label == "fast · integrator"
    assert same(fast, run(BASE))
    assert yaml.safe_load(fast.spec)["law"]["gain"] == 10


def test_a_run_that_diverges_keeps_what_was_finite():
    result = run({**BASE, "law": {"kind": "proportional", "gain": 3e5},
                  "plant": {"kind": "servo", "command_mode": "measured", "rate_limit": False}})  # fmt: skip
    assert np.isfinite(result.q).all()
    gain = {"times": [0, 0.5, 0.51], "values": [1, 1, 1.7e308]}
    far = {"kind": "set-point", "offset": {"rotation": [0, 0, 3.0]}}
    result = run({**BASE, "law": {"kind": "proportional", "gain": gain}, "reference": far, "duration": 1})
    assert result.record.stopped.startswith("diverged at 0.5")
    assert len(result.time) in (51, 52, 53)
    at_once = {**BASE, "law": {"kind": "proportional", "gain": 1.7e308}, "reference": far, "duration": 1}
    with pytest.raises(Error, match=r"diverged at 0 s: the command is not finite$"):
        run(at_once)


def test_progress():
    told = []
    run(BASE, interpreted=True, progress=lambda *steps: told.append(steps))
    assert told == [(50, 201), (100, 201), (150, 201), (200, 201)]


@pytest.mark.usefixtures("few_figures")
def test_saved_folder_holds_all(tmp_path):
    result = run(BASE)
    folder = tmp_path / "results" / "circle"
    assert result.save(folder) == folder
    names = {path.name for path in folder.iterdir()}
    assert {"spec.yaml", "record.mcap", "metrics.json", "report.html"} <= names
    assert same(run(folder / "spec.yaml"), result)
    assert np.array_equal(dqc.recording.load_record(folder / "record.mcap").q, result.q)
    metrics = json.loads((folder / "metrics.json").read_text(encoding="utf-8"))
    assert metrics == json.loads(json.dumps(result.metrics.to_dict()))
    with pytest.raises(ExistsError, match=r"circle: exists; choose another folder"):
        result.save(folder)
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    assert before["spec.yaml"].decode() == result.spec


@pytest.mark.slow
@pytest.mark.usefixtures("few_figures")
def test_a_failure_while_saving_leaves_nothing_behind(tmp_path, monkeypatch):
    def full(*arguments, **options):
        raise OSError("No space left on device")

    monkeypatch.setattr("dqcontrol.reports.run_report.write_report", full)
    result = run(BASE)
    with pytest.raises(dqc.Error, match=r"run: cannot be written: No space left on device$"):
        result.save(tmp_path / "run")
    assert not list(tmp_path.iterdir())


def test_a_spec_is_data():
    spec = prepare(BASE).spec
    assert msgspec.convert(msgspec.to_builtins(spec), type(spec)) == spec


def test_metrics_may_judge_what_the_encoders_gave(tmp_path):
    noisy = {**BASE, "plant": {"kind": "servo", "encoder_resolution": 1e-3}}
    true, measured = run(noisy), run({**noisy, "metrics_from": "measured"})
    assert same(true, measured)
    assert measured.metrics.joint_path_length == pytest.approx(
        np.linalg.norm(np.diff(measured.record.measured, axis=0), axis=1).sum()
    )
    assert measured.metrics.hand_acceleration.integral > 3 * true.metrics.hand_acceleration.integral
    loaded = dqc.experiments.load_run(measured.save(tmp_path / "run", figures=False))
    assert loaded.metrics.joint_path_length == measured.metrics.joint_path_length
    with pytest.raises(Error, match="metrics_from"):
        run({**noisy, "metrics_from": "seen"})


def test_a_null_space_of_the_spec_is_that_of_every_law_without_one():
    posture = {"kind": "posture", "gain": 2.0, "rest": BASE["start"]}
    other = {"kind": "manipulability", "gain": 1.0}
    laws = {"plain": FEEDFORWARD, "own": {**FEEDFORWARD, "null_space": other}}
    data = {key: value for key, value in BASE.items() if key != "law"}
    setting = prepare({**data, "laws": laws, "null_space": posture})
    plain, own = (msgspec.to_builtins(case.variant.law.null_space) for case in setting.cases)
    assert plain == posture
    assert own == other
    alone = run({**BASE, "law": {**FEEDFORWARD, "null_space": posture}})
    assert same(run({**BASE, "null_space": posture}), alone)


@pytest.mark.parametrize("text", ["", "- a\n- b\n", "just text", "'a\n\nevaluation:\nb'\n"])
def test_a_saved_run_whose_spec_is_no_mapping_is_refused_in_a_line(tmp_path, text):
    folder = run(BASE | {"duration": 0.1}).save(tmp_path / "run", figures=False)
    (folder / "spec.yaml").write_text(text)
    with pytest.raises(Error, match=r"spec\.yaml: .*mapping") as raised:
        dqc.experiments.load_run(folder)
    assert "\n" not in str(raised.value)

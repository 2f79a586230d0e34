import re
from typing import Any

import numpy as np
import pytest
import yaml
from log_files import EPOCH, joint_state, numbers, pose_stamped, write_bag, write_mcap

import dqcontrol as dqc
from dqcontrol import algebra
from dqcontrol.errors import FileFormatError, ShapeError, UnknownNameError, ValueRangeError
from dqcontrol.experiments import load_run
from dqcontrol.logs import evaluate_log

SPEC = {
    "name": "circle",
    "robot": "iiwa7",
    "start": [0, 0.6, 0, 1.6, 0, 0.6, 0],
    "period": 0.02,
    "reference": {"kind": "circle", "radius": 0.05, "duration": 2, "offset": {"translation": [0, 0, 0.02]}},
    "law": {"kind": "proportional-feedforward", "gain": 5},
    "plant": {"kind": "servo", "time_constant": 0.05, "encoder_noise": 1e-5},
    "skip_initial": 0.5,
}


@pytest.fixture(scope="module")
def run():
    return dqc.run(SPEC)


@pytest.fixture(scope="module")
def folder(run, tmp_path_factory):
    """Return the folder of a saved run, with its table and its reference beside it."""
    folder = tmp_path_factory.mktemp("own")
    run.save(folder / "run", figures=False)
    run.export(folder / "log.csv")
    (folder / "circle.yaml").write_text(yaml.safe_dump({key: SPEC[key] for key in ("reference", "start")}))
    return folder


def same(found, truth, tolerance=1e-9, without=()):
    found, truth = found.metrics.flat(), truth.metrics.flat()
    for key, value in truth.items():
        if key not in without:
            wanted = pytest.approx(value, rel=tolerance, abs=1e-12) if isinstance(value, float) else value
            assert found[key] == wanted, key


def test_the_own_table_of_a_run_gives_the_metrics_of_the_run(run, folder):
    found = evaluate_log(folder / "log.csv", "iiwa7", folder / "run" / "spec.yaml", low_pass=0)
    same(found, run)
    same(evaluate_log(folder / "log.csv", "iiwa7", folder / "circle.yaml", skip_initial=0.5, low_pass=0), run)
    assert found.record.stopped == "end of the log"


def test_the_recording_of_a_run_gives_the_metrics_of_the_run(run, folder):
    same(evaluate_log(folder / "run" / "record.mcap"), run, 0)
    same(evaluate_log(folder / "run"), run, 0)
    same(evaluate_log(folder / "run" / "record.mcap", "iiwa7", folder / "circle.yaml"), run)
    same(evaluate_log(folder / "run" / "record.mcap", reference_topic="/hand/desired"), run)


def test_a_recording_of_ours_read_as_anybody_elses(run, folder):
    found = evaluate_log(
        folder / "run",
        "iiwa7",
        folder / "circle.yaml",
        joint_topic="/measured_joint_states",
        command_topic="/joint_command",
        skip_initial=0.5,
    )
    assert found.record.q.tobytes() == run.record.measured.tobytes()
    assert found.record.command.tobytes() == run.record.command.tobytes()
    assert found.record.time == pytest.approx(run.record.time, abs=1e-9)


def test_tables_in_degrees_at_an_epoch(run, folder):
    table = np.column_stack([run.time + 1.7e9, np.degrees(run.q)])
    header = "time," + ",".join(f"q{i + 1} [deg]" for i in range(7))
    np.savetxt(folder / "degrees.csv", table, delimiter=",", header=header, fmt="%.17g", comments="")
    found = evaluate_log(
        folder / "degrees.csv", "iiwa7", folder / "circle.yaml", skip_initial=0.5, low_pass=0
    )
    control = (
        "control.integral",
        "control.mean",
        "control.rms",
        "control.peak",
        "effort",
        "peak_velocity_share",
        "saturation",
    )
    same(found, run, 1e-4, without=control)  # 1.7e9 s leave 0.2 µs to a float
    assert np.isnan(found.metrics.control.peak)
    assert np.isnan(found.metrics.effort)


@pytest.mark.parametrize("ros", [1, 2])
def test_bags_with_poses_and_commands(run, folder, tmp_path, ros):
    messages, positions = [], run.record.desired_position
    names = list(run.record.joint_names)
    for k, time in enumerate(run.time):
        stamp = EPOCH + round(time * 1e9)
        messages.append(("/joint_states", stamp, joint_state(stamp, names, run.q[k])))
        messages.append(("/command", stamp, numbers(run.command[k])))
        messages.append(("/target", stamp, pose_stamped(stamp, positions[k], run.desired[k, :4])))
    path = write_bag(tmp_path / ("log.bag" if ros == 1 else "log"), messages, ros=ros)
    found = evaluate_log(
        path, "iiwa7", reference_topic="/target", command_topic="/command", skip_initial=0.5, low_pass=0
    )
    same(found, run, 1e-8)
    table = evaluate_log(
        folder / "log.csv", "iiwa7", path, reference_topic="/target", skip_initial=0.5, low_pass=0
    )
    same(table, run, 1e-8)


def test_poses_of_the_log_keep_its_clock(tmp_path):
    arm = dqc.load_robot("iiwa7")
    q0, names = np.array(SPEC["start"], dtype=float), list(arm.joint_names)
    hand = arm.fkm(q0)
    messages: list[Any] = [
        ("/joint_states", EPOCH + k * 10**8, joint_state(EPOCH + k * 10**8, names, q0)) for k in range(11)
    ]
    for k, lift in ((4, 0.0), (8, 0.08)):  # the target begins 0.4 s after the joints and moves by 0.2 m/s
        position = algebra.translation(hand) + np.array([0, 0, lift])
        messages.append(("/target", EPOCH, pose_stamped(EPOCH + k * 10**8, position, -hand[:4])))
    run = evaluate_log(write_mcap(tmp_path / "log.mcap", messages), "iiwa7", reference_topic="/target")
    np.testing.assert_allclose(run.time, np.arange(7) / 10, atol=1e-12)
    distance = np.minimum(0.2 * np.arange(7) / 10, 0.08)
    np.testing.assert_allclose(run.record.position_error, distance, atol=1e-12)
    one = [*messages[:11], messages[-1]]  # a single pose is a set-point, from its stamp on
    run = evaluate_log(write_mcap(tmp_path / "one.mcap", one), "iiwa7", reference_topic="/target")
    np.testing.assert_allclose(run.record.position_error, [0.08] * 3, atol=1e-12)
    late = ("/target", EPOCH, pose_stamped(EPOCH + 10**10, [0, 0, 0], [1, 0, 0, 0]))
    with pytest.raises(
        ValueRangeError, match=r"late\.mcap: fewer than two samples between 10 and inf s; the log has"
    ):
        evaluate_log(
            write_mcap(tmp_path / "late.mcap", [*messages[:11], late]), "iiwa7", reference_topic="/target"
        )
    bent = ("/target", EPOCH, pose_stamped(EPOCH, [0, 0, 0], [1, 1, 0, 0]))
    with pytest.raises(FileFormatError, match=r"/target: message 1: quaternion must have norm 1, got 1\.414"):
        evaluate_log(
            write_mcap(tmp_path / "bent.mcap", [*messages[:11], bent]), "iiwa7", reference_topic="/target"
        )


def test_the_reference_begins_at_the_start(run, folder, tmp_path):
    """A log with half a second of rest before the motion: --start-time finds the run again."""
    rest = np.arange(25) * 0.02
    time = np.concatenate([rest, 0.5 + run.time, 2.52 + rest])
    q = np.vstack([np.tile(run.q[0], (25, 1)), run.q, np.tile(run.q[-1], (25, 1))])
    np.savetxt(tmp_path / "log.csv", np.column_stack([time, q]), delimiter=",", fmt="%.17g",
               header="time," + ",".join(run.record.joint_names), comments="")  # fmt: skip
    found = evaluate_log(tmp_path / "log.csv", "iiwa7", folder / "circle.yaml", start=0.5, duration=2.0)
    np.testing.assert_allclose(found.time, run.time, atol=1e-12)
    np.testing.assert_allclose(found.error, run.error, atol=1e-9)
    whole = evaluate_log(tmp_path / "log.csv", "iiwa7", folder / "circle.yaml", start=0.5)
    assert len(whole.time) == len(run.time) + 25
    np.testing.assert_allclose(whole.desired[-1], run.desired[-1], atol=1e-12)  # it rests where it ended


def test_points_files_and_taught_motions_as_references(run, folder):
    names = ["time", "pw", "px", "py", "pz", "dw", "dx", "dy", "dz"]
    rows = np.column_stack([run.time, run.desired])
    np.savetxt(folder / "points.csv", rows, delimiter=",", header=",".join(names), fmt="%.17g", comments="")
    same(evaluate_log(folder / "log.csv", "iiwa7", folder / "points.csv", skip_initial=0.5, low_pass=0), run)
    taught = evaluate_log(folder / "log.csv", "iiwa7", folder / "log.csv")
    assert taught.metrics.error.peak < 1e-12
    taught = evaluate_log(folder / "log.csv", "iiwa7", folder / "run" / "record.mcap")
    assert taught.metrics.error.peak < 1e-12


def test_a_reference_starts_at_the_first_configuration_of_the_log(run, folder, tmp_path):
    (tmp_path / "rest.yaml").write_text(
        "reference: {kind: set-point, offset: {translation: [0, 0.3, 0.4]}}\n"
    )
    found = evaluate_log(folder / "log.csv", "iiwa7", tmp_path / "rest.yaml", duration=0.5)
    assert found.record.position_error[0] == pytest.approx(0.5)


@pytest.mark.slow
@pytest.mark.usefixtures("few_figures")
def test_results_are_saved_and_compared_like_runs(run, folder, tmp_path):
    found = evaluate_log(folder / "log.csv", "iiwa7", folder / "circle.yaml", skip_initial=0.5, low_pass=0)
    found.save(tmp_path / "results")
    files = {path.name for path in (tmp_path / "results").iterdir()}
    assert {"spec.yaml", "record.mcap", "metrics.json", "report.html"} <= files
    page = (tmp_path / "results/report.html").read_text(encoding="utf-8")
    assert re.findall('<figure id="(.*?)">', page) == ["errors", "inputs"]
    again = load_run(tmp_path / "results")
    same(again, run)
    assert again.label == "log"
    saved = yaml.safe_load((tmp_path / "results" / "spec.yaml").read_text())["evaluation"]
    assert saved["log"] == str(folder / "log.csv")
    same(evaluate_log(tmp_path / "results"), run)


@pytest.mark.slow
def test_results_without_commands_are_saved_too(run, folder, tmp_path):
    columns = ["time", *run.record.joint_names]
    np.savetxt(
        tmp_path / "log.csv", np.column_stack([run.time, run.q]), delimiter=";", header=";".join(columns)
    )
    evaluate_log(tmp_path / "log.csv", "iiwa7", folder / "circle.yaml").save(tmp_path / "results")
    figures = re.findall(
        '<figure id="(.*?)">', (tmp_path / "results/report.html").read_text(encoding="utf-8")
    )
    assert "joints" in figures
    assert "inputs" not in figures
    assert np.isnan(load_run(tmp_path / "results").command).all()


@pytest.mark.parametrize(
    ("arguments", "kind", "message"),
    [
        ({}, ValueRangeError, r"robot: .*log\.csv does not name its robot; give one \(--robot\)"),
        ({"robot": "iiwa"}, UnknownNameError, r"robot: unknown name 'iiwa'; did you mean 'iiwa7'"),
        (
            {"robot": "iiwa7"},
            ValueRangeError,
            r"reference: .*log\.csv holds none; give a file \(--reference\), a topic",
        ),
        ({"robot": "meka-a2", "reference": "circle.yaml"}, FileFormatError, r"log\.csv:1: joints missing"),
        (
            {"robot": "iiwa7", "reference": "none.yaml"},
            FileFormatError,
            r"none\.yaml: no such file",
        ),
        ({"robot": "iiwa7", "reference": "none.csv"}, FileFormatError, r"none\.csv: no such file"),
        (
            {"robot": "iiwa7", "reference_topic": "/a"},
            ShapeError,
            r"reference_topic: .*log\.csv is no recording .*'/a'",
        ),
        (
            {"robot": "iiwa7", "reference": "wrong.yaml"},
            FileFormatError,
            r"wrong\.yaml: reference\.kind: unknown name 'cirkle'; did you mean 'circle'",
        ),
        (
            {"robot": "iiwa7", "reference": "empty.yaml"},
            FileFormatError,
            r"empty\.yaml: .*got null|empty\.yaml: expected",
        ),
        (
            {"robot": "iiwa7", "reference": "short.yaml"},
            ShapeError,
            r"short\.yaml: start: expected shape \(…, 7\)",
        ),
        (
            {"robot": "iiwa7", "reference": "circle.yaml", "start": 5},
            ValueRangeError,
            r"log\.csv: fewer than two samples between 5 and inf s; the log has 0 … 2 s",
        ),
        (
            {"robot": "iiwa7", "reference": "circle.yaml", "start": -1},
            ValueRangeError,
            r"start: must be ≥ 0, got -1",
        ),
        (
            {"robot": "iiwa7", "reference": "circle.yaml", "duration": 0},
            ValueRangeError,
            r"duration: must be > 0, got 0",
        ),
        (
            {"robot": "iiwa7", "reference": "circle.yaml", "skip_initial": -1},
            ValueRangeError,
            r"skip_initial: must be ≥ 0, got -1",
        ),
    ],
)
def test_what_does_not_fit_is_named(folder, monkeypatch, arguments, kind, message):
    monkeypatch.chdir(folder)
    (folder / "wrong.yaml").write_text("reference: {kind: cirkle}\n")
    (folder / "empty.yaml").write_text("")
    (folder / "short.yaml").write_text("reference: {kind: set-point}\nstart: [0, 1]\n")
    with pytest.raises(kind, match=message):
        evaluate_log("log.csv", **arguments)


def test_joints_of_other_names_and_a_taught_motion(run, folder, tmp_path):
    names = [f"lbr_A{i + 1}" for i in range(7)]
    np.savetxt(tmp_path / "log.txt", np.column_stack([run.time, run.q]), header=" ".join(["time", *names]))
    found = evaluate_log(
        tmp_path / "log.txt", "iiwa7", folder / "circle.yaml", joints=names, skip_initial=0.5
    )
    np.testing.assert_allclose(found.error, run.error, atol=1e-12)
    for taught in (tmp_path / "log.txt", folder / "log.csv", folder / "run"):
        known = names if taught.suffix == ".txt" or taught.is_dir() else None
        log = folder / "log.csv" if known is None else tmp_path / "log.txt"
        found = evaluate_log(log, "iiwa7", taught, joints=known)
        assert found.metrics.error.peak < 1e-12
    with pytest.raises(ValueRangeError, match=r"skip_initial: must be ≤ the 2 s that are judged, got 3"):
        evaluate_log(folder / "log.csv", "iiwa7", folder / "circle.yaml", skip_initial=3)


def test_a_recording_of_another_robot_is_refused(folder):
    with pytest.raises(FileFormatError, match=r"record\.mcap: holds the joints joint_1, .*; expected "):
        evaluate_log(folder / "run" / "record.mcap", "meka-a2")

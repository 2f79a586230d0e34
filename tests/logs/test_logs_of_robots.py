"""Logs as robots write them: stamps, units, holes, spikes, commanded positions, late motions, noise."""

import numpy as np
import pytest
import yaml
from log_files import EPOCH, joint_state, write_mcap

import dqcontrol as dqc
from dqcontrol.errors import FileFormatError, NoteWarning, ShapeError, ValueRangeError
from dqcontrol.logs import evaluate_log, read_joint_log
from dqcontrol.measures import evaluate
from dqcontrol.robots import SerialArm

ARM = SerialArm.from_dh([0, 0], [0, 0], [1, 1], [0, 0], joint_names=["hip", "knee"], name="leg")
Q0 = np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])


def table(folder, text, name="log.csv"):
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def arm():
    return dqc.load_robot("iiwa7")


@pytest.fixture(scope="module")
def motion():
    """Return a log of 3 s at 125 Hz: half a second of rest, then joints on sines; time, positions."""
    time = np.arange(375) * 0.008
    return time, joints_at(time - 0.5)


def joints_at(time):
    """Return a motion that begins at 0 and ends at 2 s."""
    return Q0 + 0.1 * np.sin(np.pi / 2 * np.clip(time, 0, 2))[:, None] ** 2 * np.arange(1, 8) / 7


def write(path, time, columns, names, fmt="%.9g"):
    np.savetxt(
        path,
        np.column_stack([time, columns]),
        delimiter=",",
        header=",".join(names),
        comments="",
        fmt=fmt,
    )
    return path


@pytest.mark.parametrize(
    ("name", "cells", "period", "said"),
    [
        ("timestamp", ["5", "5.01", "5.02"], 0.01, None),
        ("Time", ["0", "0.01", "0.02"], 0.01, None),
        ("t", ["0", "0.01", "0.02"], 0.01, None),
        ("time [ms]", ["0", "8", "16"], 0.008, None),
        ("time_ms", ["0", "8", "16"], 0.008, None),
        ("timestamp_ns", ["0", "8000000", "16000000"], 0.008, None),
        ("time", ["0", "8", "16"], 0.008, "steps of 8 without a unit are taken for milliseconds"),
        ("time", ["0", "1", "2"], 0.001, "milliseconds"),
        ("time", ["0", "4000", "8000"], 0.004, "microseconds"),
        (
            "%time",
            ["1700000000000000000", "1700000000008000001", "1700000000016000000"],
            0.008,
            "nanoseconds",
        ),
        ("timestamp", ["1700000000.5", "1700000000.508", "1700000000.516"], 0.008, None),
        ("timestamp", ["1700000000500", "1700000000508", "1700000000516"], 0.008, "milliseconds"),
        ("time [s]", ["0", "8", "16"], 8.0, None),
        ("stamp", ["2026-11-22 15:30:38.5", "2026-11-22 15:30:38.51", "2026-11-22T15:30:38.52"], 0.01, None),
    ],
)
def test_time_is_read_as_robots_write_it(tmp_path, name, cells, period, said):
    rows = "".join(f"{cell},0,1\n" for cell in cells)
    log = read_joint_log(table(tmp_path, f"{name},q1,q2\n{rows}"), ARM)
    assert np.diff(log.time) == pytest.approx(period, rel=1e-5)
    assert (said is None and not log.notes) or any(said in note for note in log.notes)


def test_degrees_are_recognised_by_the_limits_of_the_robot(tmp_path, arm, motion):
    time, q = motion
    names = ["time", *(f"q{i + 1}" for i in range(7))]
    log = read_joint_log(write(tmp_path / "log.csv", time, np.degrees(q), names), arm)
    np.testing.assert_allclose(log.q, q, atol=1e-6)
    assert any("taken for degrees" in note for note in log.notes)
    suffixed = ["time", *(f"q{i + 1}_deg" for i in range(7))]
    log = read_joint_log(write(tmp_path / "log.csv", time, np.degrees(q), suffixed), arm)
    np.testing.assert_allclose(log.q, q, atol=1e-6)
    assert log.notes == ()
    log = read_joint_log(write(tmp_path / "log.csv", time, q + 4 * np.eye(7)[1], names), arm)
    assert any("leave the limits of iiwa7 (joint_2 by 2.5" in note for note in log.notes), log.notes


HOLES = "time,q1,q2,u1,u2\n0,,0,,\n0.1,1,0,5,6\n0.2,,0,,\n0.3,3,0,7,\n0.4,4,nan,8,9\n"


def test_empty_cells_are_joined_or_skipped_and_counted(tmp_path):
    path = table(tmp_path, HOLES)
    log = read_joint_log(path, ARM)
    assert log.q[:, 0].tolist() == pytest.approx([1, 2, 3])
    assert log.time.tolist() == pytest.approx([0, 0.1, 0.2])
    assert log.command is not None
    assert log.command.tolist() == [[5, 6], [5, 6], [7, 6]]
    assert log.notes[0].startswith(
        "empty cells, of 5: q1 2, q2 1, u1 2, u2 3; positions are joined linearly over"
    )
    skipped = read_joint_log(path, ARM, missing="skip")
    assert skipped.q[:, 0].tolist() == [1, 3]
    assert "3 of 5 samples are left out" in skipped.notes[0]
    plain = HOLES.replace(",,\n", ",nan,nan\n").replace("0,,0", "0,nan,0").replace("2,,0", "2,nan,0")
    again = read_joint_log(table(tmp_path, plain.replace("7,\n", "7,nan\n")), ARM)
    assert again.q.tolist() == log.q.tolist()
    with pytest.raises(FileFormatError, match=r"log\.csv: q2: all 2 cells are empty"):
        read_joint_log(table(tmp_path, "time,q1,q2\n0,1,\n1,1,\n"), ARM)
    with pytest.raises(
        FileFormatError, match=r"no sample has the positions of all joints \(q1 1, q2 1 cells"
    ):
        read_joint_log(table(tmp_path, "time,q1,q2\n0,1,\n0.1,,2\n"), ARM, missing="skip")


def test_lines_without_time_and_a_last_line_cut_off_are_left_out(tmp_path):
    log = read_joint_log(table(tmp_path, "time,q1,q2\n0,1,2\n,1,2\n0.1,1,2\n0.2,1"), ARM)
    assert len(log.time) == 2
    assert log.notes == (
        "line 5, the last one, is cut off and left out",
        "1 of 3 lines have no time and are left out",
    )


def test_gaps_and_outliers_are_reported(tmp_path, arm, motion):
    time, q = motion
    noisy = q + np.random.default_rng(4).normal(0, 2e-4, q.shape)
    names = ["time", *(f"q{i + 1}" for i in range(7))]
    assert read_joint_log(write(tmp_path / "clean.csv", time, noisy, names), arm).notes == ()
    kept = np.delete(np.arange(len(time)), slice(100, 150))
    noisy[200, 3] += 0.3
    log = read_joint_log(write(tmp_path / "log.csv", time[kept], noisy[kept], names), arm)
    assert log.notes == (
        "time: 1 gap of more than 3 periods of 0.008 s, the longest 0.408 s at 0.792 s",
        "joint_4: 1 sample far from both neighbours, the largest by 0.3 rad at 1.6 s; they count in all peaks",
    )
    coarse = 6e-3 * np.round(q / 6e-3)
    assert read_joint_log(write(tmp_path / "coarse.csv", time, coarse, names), arm).notes == ()


def test_commanded_positions_are_the_reference(tmp_path, arm, motion):
    time, q = motion
    late = np.vstack([np.tile(q[0], (5, 1)), q[:-5]])
    names = [f"q{i + 1}" for i in range(7)]
    columns = np.hstack([late, np.degrees(q)])
    for targets in ("target_", "target_*", "target_…", ",".join(f"target_{name}" for name in names)):
        header = ["time", *names, *(f"target_{name} [deg]" for name in names)]
        path = write(tmp_path / "log.csv", time, columns, header)
        found = evaluate_log(path, "iiwa7", reference_joints=targets)
        np.testing.assert_allclose(found.desired, arm.fkm(q), atol=1e-6)
    distance = np.linalg.norm(np.diff(found.record.desired_position, axis=0), axis=1).max()
    assert 4 * distance < 1e-3 * found.metrics.position.peak < 5.1 * distance
    again = yaml.safe_load(found.spec)["evaluation"]
    assert again["reference_joints"] == targets
    with pytest.raises(
        ShapeError, match=r"reference_joints: .*: columns missing: goal_joint_1, .*\(columns: time"
    ):
        evaluate_log(path, "iiwa7", reference_joints="goal_")
    with pytest.raises(
        ShapeError, match=r"reference_joints: expected 7 different names, .* got target_q1, target_q2"
    ):
        evaluate_log(path, "iiwa7", reference_joints="target_q1,target_q2")
    with pytest.raises(ValueRangeError, match=r"reference_joints: a reference is given, too"):
        evaluate_log(path, "iiwa7", path, reference_joints="target_")


def test_a_topic_of_commanded_positions_is_a_reference(tmp_path, arm, motion):
    time, q = motion
    names, messages = list(arm.joint_names), []
    for k in range(0, len(time), 5):
        stamp = EPOCH + round(time[k] * 1e9)
        messages.append(("/joint_states", stamp, joint_state(stamp, names, q[max(k - 5, 0)])))
        messages.append(("/commanded", stamp, joint_state(stamp, names, q[k])))
    path = write_mcap(tmp_path / "log.mcap", messages)
    found = evaluate_log(path, "iiwa7", reference_topic="/commanded")
    np.testing.assert_allclose(found.desired, arm.fkm(q[::5]), atol=1e-9)
    with pytest.raises(ShapeError, match=r"reference_joints: .* is a recording and has no columns"):
        evaluate_log(path, "iiwa7", reference_joints="target_")
    with pytest.raises(ShapeError, match=r"targets or .* has no columns; .* \(--target-topic"):
        dqc.identify(path, "iiwa7", targets="target_")


def test_align_finds_when_the_motion_begins(tmp_path, arm):
    names, time = ["time", *arm.joint_names], np.arange(400) * 0.01
    taught = write(tmp_path / "taught.csv", time[:201], joints_at(time[:201]), names, "%.12f")
    path = write(tmp_path / "log.csv", time + 1.7e9, joints_at(time - 0.837), ["t", *names[1:]], "%.12f")
    with pytest.warns(NoteWarning, match=r"log\.csv: aligned: the reference begins at 0\.837 s of the log"):
        found = evaluate_log(path, "iiwa7", taught, align=True)
    assert found.metrics.position.rms < 0.05  # mm
    assert evaluate_log(path, "iiwa7", taught).metrics.position.rms > 5
    cut = write(tmp_path / "cut.csv", time[:150], joints_at(time[:150] + 0.463), names, "%.12f")
    with pytest.warns(NoteWarning, match=r"aligned: the reference begins at -0\.463 s"):
        found = evaluate_log(cut, "iiwa7", taught, align=True)
    assert found.metrics.position.rms < 0.05
    for arguments, message in [
        ({"reference": taught, "start": 0.1}, "align: the start is given, too"),
        ({"reference_joints": "joint_"}, "align: the reference is in the log itself"),
    ]:
        with pytest.raises(ValueRangeError, match=message):
            evaluate_log(path, "iiwa7", align=True, **arguments)
    still = write(tmp_path / "still.csv", time, np.tile(Q0, (len(time), 1)), names)
    with pytest.raises(ValueRangeError, match="align: the logged hand hardly moves; give --start-time"):
        evaluate_log(still, "iiwa7", taught, align=True)
    (tmp_path / "rest.yaml").write_text("reference: {kind: set-point}\n")
    with pytest.raises(ValueRangeError, match="align: the reference has no end"):
        evaluate_log(path, "iiwa7", tmp_path / "rest.yaml", align=True)


def test_accelerations_of_a_noisy_log_are_those_of_the_motion(tmp_path, arm, motion):
    time, q = motion
    names = ["time", *(f"q{i + 1}" for i in range(7))]
    noisy = q + np.random.default_rng(5).normal(0, 3e-5, q.shape)
    path = write(tmp_path / "log.csv", time, noisy, names)
    taught = write(tmp_path / "taught.csv", time, q, names)
    truth = evaluate_log(taught, "iiwa7", taught, low_pass=0).metrics
    raw = evaluate_log(path, "iiwa7", taught, low_pass=0)
    filtered = evaluate_log(path, "iiwa7", taught)
    assert raw.low_pass is None
    assert filtered.low_pass == 10
    assert raw.metrics.hand_acceleration.rms > 5 * truth.hand_acceleration.rms
    assert filtered.metrics.hand_acceleration.rms == pytest.approx(truth.hand_acceleration.rms, rel=0.25)
    assert filtered.metrics.joint_path_length == pytest.approx(truth.joint_path_length, rel=0.1)
    filtered.save(tmp_path / "results", figures=False)
    again = dqc.experiments.load_run(tmp_path / "results")
    assert again.metrics.to_dict() == filtered.metrics.to_dict()
    with pytest.raises(ValueRangeError, match=r"low_pass: must be ≥ 0, got -1"):
        evaluate_log(path, "iiwa7", taught, low_pass=-1)


def test_no_overshoot_of_a_run_that_starts_on_its_target(tmp_path, arm, motion):
    """Overshoot and settling count in shares of the first error: without one they are absurd."""
    time, q = motion
    names = ["time", *(f"q{i + 1}" for i in range(7))]
    start = q + 1e-5 * (np.arange(len(time)) == 0)[:, None]
    tracked = q + 0.01 * np.sin(3 * time)[:, None]
    taught = write(tmp_path / "taught.csv", time, tracked, names)
    found = evaluate_log(write(tmp_path / "log.csv", time, start, names), "iiwa7", taught).metrics
    for name in ("position_overshoot", "orientation_overshoot", "settling_time", "settling_band"):
        assert np.isnan(getattr(found, name)), name
    away = write(tmp_path / "away.csv", time, q + 0.2 * np.exp(-9 * time)[:, None], names)
    record = evaluate_log(away, "iiwa7", write(tmp_path / "still.csv", time, q, names)).record
    assert evaluate(record).settling_time == pytest.approx(np.log(50) / 9, abs=0.05)


def test_names_of_universal_robots_are_known(tmp_path):
    """Its interface numbers joints from 0: actual_q_0 is what was measured, target_q_0 what was commanded."""
    arm = dqc.load_robot("ur5")
    rng = np.random.default_rng(6)
    q, target, time = rng.normal(0, 0.5, (3, 6)), rng.normal(0, 0.5, (3, 6)), [[0.0], [0.008], [0.016]]
    names = [f"{kind}_{i}" for kind in ("target_q", "actual_q", "actual_qd") for i in range(6)]
    path = tmp_path / "rtde.csv"
    np.savetxt(
        path,
        np.hstack([time, target, q, 0 * q]),
        delimiter=" ",
        comments="",
        header=" ".join(["timestamp", *names]),
    )
    log = read_joint_log(path, arm)
    np.testing.assert_allclose(log.q, q, atol=1e-12)
    assert log.target is not None
    np.testing.assert_allclose(log.target, target, atol=1e-12)
    named = read_joint_log(path, arm, targets="target_q_")
    assert named.target is not None
    np.testing.assert_allclose(named.target, target, atol=1e-12)

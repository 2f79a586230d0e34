"""The geometry of arms from measured poses, against arms that are wrong in ways of their own."""

import json
import sys

import numpy as np
import pytest
from log_files import EPOCH, joint_state, pose_stamped, write_mcap
from tracker_simulator import hand_error, measured, spoiled, spoiled_dh, write_poses

import dqcontrol as dqc
from dqcontrol.errors import Error
from dqcontrol.logs.calibration.correctable_chain import CorrectableChain
from dqcontrol.robots.poses import shift

SEED = 20261122
FAR = dqc.DualQuaternion.from_pose([0.6, 0.0, 0.0, 0.8], [2.0, -1.0, 0.5])
MARKER = dqc.DualQuaternion.from_pose([0.5, 0.5, -0.5, 0.5], [0.02, 0.05, 0.12])


def test_slopes_by_the_corrections_are_those_of_differences():
    rng = np.random.default_rng(SEED)
    chain = CorrectableChain(dqc.load_robot("ur5"), shift(), shift(0.01, 0.02, 0.1))
    q, values = rng.uniform(-2, 2, (5, 6)), 1e-3 * rng.normal(size=len(chain.parameters))
    slopes = chain.jacobian(q, values)
    for k in range(len(values)):
        step = np.zeros(len(values))
        step[k] = 1e-6
        before, after = (dqc.algebra.translation(chain.poses(q, values + sign * step)) for sign in (-1, 1))
        np.testing.assert_allclose(slopes[:, 3:, k], (after - before) / 2e-6, atol=1e-8)
    arm = chain.corrected(values, base=True, tool=True)
    np.testing.assert_allclose(arm.fkm(q), chain.poses(q, values), atol=1e-12)


@pytest.fixture(scope="module")
def iiwa(tmp_path_factory):
    """Return a calibration of an iiwa whose DH parameters are wrong, the true arm, and the table it is from."""
    rng = np.random.default_rng(SEED)
    arm = dqc.load_robot("iiwa7")
    d, alpha = [0.34, 0, 0.4, 0, 0.4, 0, 0.126], np.radians([-90, 90, 90, -90, -90, 90, 0])
    nominal, true = spoiled_dh(rng, [0] * 7, d, [0] * 7, alpha, limits=arm.limits, name="iiwa7")
    np.testing.assert_allclose(nominal.chain, arm.chain, atol=1e-12)
    path = write_poses(tmp_path_factory.mktemp("poses") / "poses.csv", *measured(rng, true, 60))
    return dqc.calibrate(path, "iiwa7"), nominal, true, path


@pytest.mark.slow
def test_errors_of_dh_parameters_are_found_and_nine_tenths_of_what_they_do_removed(iiwa):
    found, nominal, true, _ = iiwa
    rng = np.random.default_rng(1)
    before, after = (hand_error(rng, true, arm) for arm in (nominal, found.arm))
    assert before > 2e-3
    assert after < 0.1 * before
    assert found.after.position_rms < 2.5e-4  # with the noise of the tracker, 0.17 mm
    assert found.before.position_rms > 1e-3
    assert found.noise[0] == pytest.approx(1e-4, rel=0.2)
    assert found.improves
    by_name = {str(each): each for each in found.corrections}
    assert by_name["joint_1.theta"].status == "tied"
    assert by_name["joint_1.theta"].tied_with == ("base.rz",)
    assert by_name["joint_7.d"].tied_with == ("tool.z",)
    assert by_name["joint_3.d"].status == "fitted"
    assert by_name["joint_3.beta"].tied_with == ("joint_3.theta",)
    assert len(found.fitted) == 4 * 7 + 6  # what poses tell of an arm with revolute joints, none parallel
    low, high = by_name["joint_3.d"].interval
    wrong = np.linalg.norm(true.chain[3, 4:7] - nominal.chain[3, 4:7])
    assert low - 1e-3 < wrong < high + 1e-3


def test_the_files_are_a_robot_and_what_was_found(iiwa, tmp_path):
    found, _, true, path = iiwa
    out = found.save(tmp_path / "out")
    again = dqc.load_robot(out / "robot.yaml")
    np.testing.assert_allclose(again.chain, found.arm.chain, atol=1e-12)
    assert again.inertia is not None
    np.testing.assert_array_equal(again.limits.velocity, true.limits.velocity)
    data = json.loads((out / "calibration.json").read_text(encoding="utf-8"))
    assert data["log"] == str(path.resolve())
    assert data["after"]["position_rms"] < 0.2 * data["before"]["position_rms"]
    assert {"part", "name", "status", "value", "interval", "tied_with"} == set(data["corrections"][0])
    with pytest.raises(FileExistsError, match="out: exists"):
        found.save(out)


@pytest.mark.slow
def test_camera_and_marker_may_be_anywhere(tmp_path):
    rng = np.random.default_rng(SEED)
    arm = dqc.load_robot("ur5")
    true = spoiled(rng, arm)
    path = write_poses(tmp_path / "poses.csv", *measured(rng, true, 60, base=FAR, tool=MARKER))
    found = dqc.calibrate(path, arm)
    assert not found.base_is_known
    assert not found.tool_is_known
    np.testing.assert_allclose(dqc.algebra.translation(found.base), [2.0, -1.0, 0.5], atol=0.01)
    np.testing.assert_allclose(dqc.algebra.translation(found.tool), [0.02, 0.05, 0.12], atol=0.01)
    assert found.after.position_rms < 2.5e-4
    by_name = {str(each): each for each in found.corrections}
    assert by_name["elbow_joint.d"].tied_with == ("shoulder_lift_joint.d",)  # their axes are parallel
    assert by_name["elbow_joint.beta"].status == "fitted"
    assert "that is not in the robot file" in str(found)


def test_positions_alone_in_mm_do_too_and_single_wrong_ones_are_left_out(tmp_path):
    rng = np.random.default_rng(SEED)
    true = spoiled(rng, dqc.load_robot("iiwa7"))
    q, position, _ = measured(rng, true, 80)
    position[17] += 0.05
    found = dqc.calibrate(write_poses(tmp_path / "poses.csv", np.degrees(q), 1000 * position), "iiwa7")
    assert found.poses == 79
    assert any("1 poses more than 6 times as far off" in note for note in found.notes)
    assert any("taken for mm" in note for note in found.notes)
    assert any("taken for degrees" in note for note in found.notes)
    assert hand_error(rng, true, found.arm) < 0.1 * hand_error(rng, true, dqc.load_robot("iiwa7"))
    assert {str(each) for each in found.corrections if not each.tied_with and each.status == "tied"} >= {
        "tool.rz"
    }
    assert np.isnan(found.after.rotation_rms)


def test_an_arm_that_is_right_stays_what_it_is(tmp_path):
    rng = np.random.default_rng(SEED)
    arm = dqc.load_robot("ur5")
    found = dqc.calibrate(write_poses(tmp_path / "poses.csv", *measured(rng, arm, 40, noise=1e-3)), arm)
    assert not found.improves
    assert "do not help on poses that were not fitted" in str(found)
    assert hand_error(rng, arm, found.arm) < 1e-3


def test_recordings_hold_poses_beside_joint_states(tmp_path):
    rng = np.random.default_rng(SEED)
    true = spoiled(rng, dqc.load_robot("ur5"))
    q, position, rotation = measured(rng, true, 40)
    names, messages = list(true.joint_names), []
    for k in range(40):
        for late in (0, 20_000_000):
            stamp = EPOCH + k * 10**9 + late
            messages.append(("/joint_states", stamp, joint_state(stamp, names, q[k])))
        stamp = EPOCH + k * 10**9 + 10_000_000
        messages.append(("/tracker", stamp, pose_stamped(stamp, position[k], rotation[k])))
    found = dqc.calibrate(write_mcap(tmp_path / "log.mcap", messages), "ur5")
    assert found.poses == 40
    assert found.after.position_rms < 3e-4


def _lines(q, position, **changed):
    names = [f"q{i + 1}" for i in range(q.shape[1])] + list("xyz")
    rows = [[f"{value:.6g}" for value in (*a, *b)] for a, b in zip(q, position, strict=True)]
    for place, text in changed.items():
        rows[int(place[1:])][0] = text
    return "\n".join(",".join(row) for row in [names, *rows])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda text: text.replace("x,", "a,", 1), r"p\.csv:1: measured positions missing: x"),
        (lambda text: text.replace("q3", "w3", 1), r"p\.csv:1: joints missing: q3"),
        (lambda text: text.split("\n", 1)[1], r"p\.csv:1: expected a line of column names"),
        (lambda text: text.replace(",0.5,", ",half,", 1), r"p\.csv:5: q2: expected a number, got 'half'"),
        (lambda text: text.replace("x,y", "x [mi],y", 1), r"p\.csv:1: x: unknown unit 'mi'"),
        (lambda text: "\n".join(text.split("\n")[:8]), r"too few poses: iiwa7 needs at least 22"),
        (lambda text: text + ",1", r"p\.csv:31: expected 10 values, got 11"),
        (lambda text: text.split("\n")[0], r"p\.csv: has no poses below the column names"),
    ],
)
def test_what_is_wrong_with_a_table_is_said_in_one_line(tmp_path, change, message):
    rng = np.random.default_rng(SEED)
    q, position, _ = measured(rng, dqc.load_robot("iiwa7"), 30)
    q[3, 1] = 0.5
    (tmp_path / "p.csv").write_text(change(_lines(q, position)), encoding="utf-8")
    with pytest.raises(Error, match=message):
        dqc.calibrate(tmp_path / "p.csv", "iiwa7")


def test_mobile_bases_are_refused():
    with pytest.raises(Error, match="has a mobile base; calibrate its arm alone"):
        dqc.calibrate("poses.csv", "youbot")


def test_the_command_prints_both_tables_and_writes_the_files(iiwa, tmp_path, capsys):
    from dqcontrol.cli.log_commands import calibrate

    calibrate(iiwa[3], robot="iiwa7", out=tmp_path / "out")
    printed = capsys.readouterr().out
    assert "iiwa7: corrections from 60 poses" in printed
    assert "frames fitted alone" in printed
    assert "joint_1.theta (base.rz)" in printed
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"robot.yaml", "calibration.json"}


@pytest.mark.slow
def test_forty_arms():
    """Of random errors of five kinds of arms, with and without orientations, nine tenths of the effect go."""
    from pathlib import Path

    from dqcontrol.logs.calibration import MeasuredPoses
    from dqcontrol.logs.calibration.kinematic_calibration import calibration_of

    rng, left = np.random.default_rng(SEED), []
    for case in range(40):
        arm = dqc.load_robot(("iiwa7", "ur5", "panda", "kuka-lwr4", "barrett-wam")[case % 5])
        true = spoiled(rng, arm)
        q, position, rotation = measured(rng, true, 60)
        found = calibration_of(arm, MeasuredPoses(Path("poses"), q, position, rotation if case % 2 else None))
        left.append(hand_error(rng, true, found.arm) / hand_error(rng, true, arm))
    print(
        f"seed {SEED}: left of the error at most {max(left):.3f}, usually {np.median(left):.3f}",
        file=sys.stderr,
    )
    assert max(left) < 0.1

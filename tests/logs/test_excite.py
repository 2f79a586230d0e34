"""Motions that tell lags from delays: within all limits, as precise as said, and run by the spec beside them."""

import numpy as np
import pytest
from servo_simulator import answer

import dqcontrol as dqc
from dqcontrol.algebra import translation
from dqcontrol.errors import Error
from dqcontrol.logs.servos.excitation import SIGNALS

START = [0, 0.6, 0, 1.6, 0, 0.6, 0]


@pytest.mark.parametrize("together", [False, True])
@pytest.mark.parametrize("signal", SIGNALS)
def test_motions_stay_within_limits_and_tell_enough(signal, together):
    limits = {"amplitude": 0.25, "speed": 0.8, "acceleration": 5.0}
    motion = dqc.excite("iiwa7", START, signal=signal, together=together, duration=35, period=0.01, **limits)
    away = motion.q - START
    assert np.abs(away).max() <= 0.25
    rates = np.diff(motion.q, axis=0) / 0.01
    assert np.abs(rates).max() <= 0.8 * (1 + 1e-9)
    assert np.abs(np.diff(rates, axis=0)).max() / 0.01 <= 5.0 * (1 + 1e-9)
    np.testing.assert_allclose(motion.q[[0, -1]], [START] * 2, atol=1e-9)
    assert motion.time[-1] == pytest.approx(35, abs=0.011)
    assert all(each.is_enough for each in motion.expected), str(motion)
    moving = (np.abs(rates) > 1e-6).sum(axis=1)
    assert (moving > 1).mean() == pytest.approx(1.0 if together else 0.35, abs=0.2)


def test_the_hand_stays_in_its_workspace_and_joints_before_their_limits():
    arm = dqc.load_robot("iiwa7")
    hand = translation(arm.fkm(START))
    box = np.column_stack([hand - 0.05, hand + 0.05]).ravel()
    motion = dqc.excite(arm, START, duration=20, workspace=box)
    assert 0 < motion.share < 1
    points = translation(arm.fkm(motion.q))
    assert (points >= hand - 0.05).all()
    assert (points <= hand + 0.05).all()
    assert "the workspace leaves" in str(motion)
    near = arm.limits.upper - 0.15
    q = dqc.excite(arm, near, duration=20, amplitude=1.0).q
    assert (q <= arm.limits.upper).all()


def test_what_is_expected_is_what_is_found(tmp_path):
    """Of 40 logs of the motion by another simulator, lag and delay scatter as said."""
    from pathlib import Path

    from dqcontrol.logs.servos.joint_gates import identify_joint
    from dqcontrol.logs.servos.replay import CommandedLog

    rng = np.random.default_rng(20261122)
    arm = dqc.SerialArm.from_dh([0], [0.1], [0.2], [0])
    motion = dqc.excite(arm, [0.0], duration=10, noise=3e-4)
    clean = answer(motion.time, motion.q[:, 0], 0.05, 0.02, motion.time)
    errors = []
    for _ in range(12):
        seen = clean + 3e-4 * rng.normal(size=len(clean))
        log = CommandedLog(Path("log"), motion.time, seen[:, None], motion.time, motion.q, True)
        found = identify_joint("joint", "rad", log.segments(0, "positions", None), 0.008)
        assert found.status == "fitted", found.reason
        errors.append([found.lag - 0.05, found.delay - 0.02])
    said = motion.expected[0]
    scatter = np.sqrt(np.mean(np.square(errors), axis=0)) * 1.96
    assert scatter[0] == pytest.approx(said.lag, rel=0.6)
    assert scatter[1] == pytest.approx(said.delay, rel=0.6)


@pytest.mark.slow
def test_the_files_run_and_identify_finds_the_servos_that_ran(tmp_path):
    motion = dqc.excite("iiwa7", START, duration=20, lag=0.06, delay=0.018, noise=1e-4)
    motion.save(tmp_path / "excite")
    run = dqc.run(tmp_path / "excite" / "excite.yaml")
    np.testing.assert_allclose(run.record.time[-1], motion.time[-1], atol=0.02)
    run.save(tmp_path / "run", figures=False)
    found = dqc.identify(tmp_path / "run", "iiwa7")
    assert [each.status for each in found.joints] == ["fitted"] * 7, str(found)
    for each, said in zip(found.joints, motion.expected, strict=True):
        assert each.lag == pytest.approx(0.06, abs=2 * said.lag)
        assert each.delay == pytest.approx(0.018, abs=2 * said.delay)
    with pytest.raises(FileExistsError, match="excite: exists"):
        motion.save(tmp_path / "excite")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"duration": 3}, r"^duration: must be ≥ 14 s for 7 joints, got 3"),
        ({"start": [0, 3, 0, 0, 0, 0, 0]}, r"^start: joint_2 = 3 is beyond its limits"),
        ({"workspace": [0, 1]}, r"^workspace: expected x0, x1, y0"),
        ({"workspace": [5, 6, 5, 6, 5, 6]}, r"^workspace: the end effector starts outside of it"),
        ({"signal": "noise"}, r"^signal: unknown name 'noise'"),
        ({"speed": 0.0}, r"^speed: joint_1 is left 0; start it elsewhere"),
    ],
)
def test_what_leaves_no_room_is_said(options, message):
    with pytest.raises(Error, match=message):
        dqc.excite("iiwa7", options.pop("start", START), **options)


def test_the_command_prints_what_to_expect_and_writes_the_files(tmp_path, capsys):
    from dqcontrol.cli.log_commands import excite

    excite("iiwa7", start="0,0.6,0,1.6,0,0.6,0", duration=20, out=tmp_path / "out")
    printed = capsys.readouterr().out
    assert "to expect at lag 50 ms" in printed
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"motion.csv", "hand.csv", "excite.yaml"}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("time,q1\n0,0\n1,1\n", r"m\.csv:1: column missing: joint_1"),
        ("time,q1,q2,q3,q4,q5,q6,q7\n0,0,0,0,0,0,0,0\n", r"m\.csv: expected a line of column names and"),
        ("time,q1,q2,q3,q4,q5,q6,q7\n0,0,0,0,0,0,0,0\n0,0,0,0,0,0,0,0\n", r"m\.csv:3: time: must increase"),
        ("time,q1,q2,q3,q4,q5,q6,q7\n0,0,0,0,0,0,0,0\n1,0,0,x,0,0,0,0\n", r"m\.csv:3: q3: expected a number"),
    ],
)
def test_joint_motions_that_cannot_be_read_are_said(tmp_path, text, message):
    (tmp_path / "m.csv").write_text(text, encoding="utf-8")
    arm = dqc.load_robot("iiwa7")
    with pytest.raises(Error, match=message):
        dqc.laws.JointMotion(file=str(tmp_path / "m.csv")).prepare(arm, None, 0.01)


@pytest.mark.slow
def test_the_motion_runs_on_the_clock_and_tells_as_much(tmp_path):
    from dqcontrol.experiments import run_in_real_time

    motion = dqc.excite("iiwa7", START, duration=20, period=0.01, lag=0.06, delay=0.018, noise=1e-4)
    motion.save(tmp_path / "excite")
    run_in_real_time(tmp_path / "excite" / "excite.yaml", tmp_path / "run", figures=False)
    found = dqc.identify(tmp_path / "run" / "record.mcap", "iiwa7")
    assert [each.status for each in found.joints] == ["fitted"] * 7, str(found)
    for each, said in zip(found.joints, motion.expected, strict=True):
        assert each.lag == pytest.approx(0.06, abs=max(2 * said.lag, 0.006))
        assert each.delay == pytest.approx(0.018, abs=max(2 * said.delay, 0.005))

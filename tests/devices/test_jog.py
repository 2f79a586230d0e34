"""Driving by keys: the hand goes where they say and only while they last; poses are kept; stops hold."""

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol import algebra
from dqcontrol.devices.jog import HELP, MOVES, Jog
from dqcontrol.errors import Error, ExistsError, FallenError, ShapeError
from dqcontrol.experiments.driven import prepare_live
from dqcontrol.loop import Live
from dqcontrol.loop.targets import Speeds
from dqcontrol.recording import RecordStream, load_record
from dqcontrol.references import load_points
from dqcontrol.references.points import PointsWriter
from dqcontrol.robots import most_dexterous
from dqcontrol.supervisor import list_interventions

T, Q0 = 0.01, np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])


@pytest.fixture
def jog(tmp_path):
    live = Live(
        dqc.load_robot("iiwa7"),
        dqc.laws.ProportionalFeedforward(gain=10.0),
        dqc.plants.Servo(time_constant=0.02),
        T,
        start=Q0,
        supervisor=dqc.supervisor.Supervisor(acceleration=5.0),
        speeds=Speeds(0.1, 0.5),
    )
    return Jog(live, PointsWriter(tmp_path / "poses.csv"))


def hand(jog):
    return jog.live.state.pose


def hold(jog, key, seconds):
    """Press a key as a terminal repeats it, then let go and wait until all rests; return how the hand moved."""
    before = hand(jog)
    for k in range(round(seconds / T)):
        if k % 4 == 0:
            assert jog.press(key) == ""
        jog.live.step()
    for _ in range(120):
        jog.live.step()
    after = hand(jog)
    turn = algebra.multiply(after, algebra.conjugate(before))[:4]
    return algebra.translation(after) - algebra.translation(before), 2 * turn[1:] * np.sign(turn[0])


@pytest.mark.parametrize("key", MOVES)
def test_each_key_moves_along_its_own_axis_only(jog, key):
    axis, sign = MOVES[key]
    moved = np.concatenate(hold(jog, key, 0.6))
    half = 0.5 * (0.1, 0.5)[axis // 3]
    assert 0.4 * half < sign * moved[axis] < 0.8 * half  # 0.6 s and what a key press lasts, at half speed
    assert np.delete(moved, axis) == pytest.approx(0, abs=0.02 * half)


def test_each_key_is_in_the_help():
    assert {key for line in HELP for key in line.split()} >= {*MOVES, "+", "-", "h", "p", "g", "c", "q"}
    assert max(map(len, HELP)) < 80


def test_one_press_is_a_small_step_and_keys_without_a_meaning_are_none(jog):
    moved, _ = hold(jog, "w", T)
    assert 0.05 * 0.1 < moved[0] < 0.05 * 0.2
    for key in ("y", "7", "é", "\x00"):
        assert np.concatenate(hold(jog, key, 0.1)) == pytest.approx(0, abs=1e-5)


def test_faster_slower_and_the_axes_of_the_hand(jog):
    jog.press("-")
    slow, _ = hold(jog, "w", 0.6)
    jog.press("+")
    jog.press("+")
    fast, _ = hold(jog, "w", 0.6)
    assert fast[0] / slow[0] == pytest.approx(4, rel=0.05)
    for _ in range(20):
        jog.press("+")
    assert jog.share == 1
    jog.press("h")
    assert "hand axes" in jog.status
    axis = algebra.matrix_from_rotation(algebra.rotation(hand(jog)))[:, 2]
    moved, _ = hold(jog, "f", 0.4)
    assert moved / np.linalg.norm(moved) == pytest.approx(-axis, abs=0.01)


def test_kept_poses_are_a_reference(jog, tmp_path):
    poses = [hand(jog)]
    assert jog.press("p").startswith("pose 1 kept in ")
    assert "move the hand first" in jog.press("p")
    for key in ("r", "u"):
        hold(jog, key, 0.5)
        poses.append(hand(jog))
        jog.press("p")
    reference = load_points(tmp_path / "poses.csv")

    for pose, time in zip(poses, reference.times, strict=True):
        short = reference.at(float(time)).pose
        assert min(np.abs(short - pose).max(), np.abs(short + pose).max()) < 1e-8
    twists = reference.samples(np.array([0.01, reference.duration - 0.01]))[:, 8:14]
    rise = np.linalg.norm(algebra.translation(poses[1]) - algebra.translation(poses[0]))
    assert reference.times[1] == pytest.approx(rise / 0.1, rel=1e-3)  # as fast as the keys may go
    assert np.linalg.norm(twists[1, :3]) == pytest.approx(0.5, rel=0.01)
    line = (tmp_path / "poses.csv").read_text().splitlines()[1]
    start = [float(word) for word in line.split("[")[1].rstrip("]").split(",")]
    assert start == pytest.approx(Q0, abs=1e-4)
    with pytest.raises(ExistsError, match=r"poses\.csv: exists already"):
        PointsWriter(tmp_path / "poses.csv")


def test_an_emergency_stop_holds_until_it_is_told_to_go_on(jog):
    for _ in range(40):
        jog.press("w")
        jog.live.step()
    jog.press(" ")
    for _ in range(60):
        jog.press("w")
        jog.live.step()
    assert jog.live.condition == "stopped: emergency stop"
    assert np.concatenate(hold(jog, "w", 0.3)) == pytest.approx(0, abs=1e-6)
    assert not jog.live.ended
    assert jog.press("g") == "resumed"
    assert "is active, not stopped" in jog.press("g")
    moved, _ = hold(jog, "a", 0.4)
    assert moved[1] > 0.01


def test_a_recording_has_all_that_happened_also_after_a_stop(jog, tmp_path):
    with RecordStream(tmp_path / "record.mcap", dqc.load_robot("iiwa7")) as jog.live.recording:
        hold(jog, "w", 0.3)
        jog.press(" ")
        hold(jog, "w", 0.3)
        jog.press("g")
        hold(jog, "w", 0.3)
    record = load_record(tmp_path / "record.mcap")
    assert record.time == pytest.approx(T * np.arange(3 * 150))
    reasons = [
        told.reason for told in list_interventions(record.time, record.readings["interventions"].values)
    ]
    assert "emergency stop" in reasons
    assert record.position[-1, 0] - record.position[0, 0] > 0.02


def test_a_recording_that_cannot_be_written_stops_the_robot(jog, tmp_path):
    recording = RecordStream(tmp_path / "record.mcap", dqc.load_robot("iiwa7"))
    jog.live.recording = recording
    hold(jog, "w", 0.1)
    recording.failure = "the recording cannot be written: No space left on device"
    hold(jog, "w", 0.3)
    assert jog.live.condition == (
        "stopped: emergency stop: the recording cannot be written: No space left on device"
    )
    with pytest.raises(Error, match="No space left"):
        recording.close()


def test_a_robot_that_falls_over_is_stopped_and_says_so(jog):
    def fall(command):
        raise FallenError("toppled at 1 s")

    hold(jog, "w", 0.1)
    jog.live.plant.step = fall
    for _ in range(50):
        jog.live.step()
    assert jog.live.is_stopped
    assert jog.live.condition == "stopped: emergency stop: toppled at 1 s"


@pytest.mark.parametrize("first", ["c", " "])
def test_the_end_is_soft_and_comes_after_stops_too(jog, first):
    for _ in range(40):
        jog.press("w")
        jog.live.step()
    jog.press(first)
    jog.press("c")
    commands, count = [], 0
    while not jog.live.ended:
        jog.live.step()
        count += 1
        commands.append(jog.live.control.command.copy())
        assert count < 200
    assert np.abs(np.diff(commands, axis=0)).max() <= 5.0 * T * (1 + 1e-9)
    assert not commands[-1].any()


def test_from_a_robot_from_a_spec_and_from_neither(tmp_path):
    arm = dqc.load_robot("panda")
    q = most_dexterous(arm)
    assert (arm.limits.lower < q).all()
    assert (q < arm.limits.upper).all()
    assert arm.manipulability(q) > 0.05
    for name in ("panda", "little-john"):
        jog = Jog(prepare_live(name))
        moved, _ = hold(jog, "w", 0.4)
        assert moved[0] == pytest.approx(0.05 * 0.5, rel=0.3)
    with pytest.raises(dqc.errors.UnknownNameError, match="did you mean 'panda'"):
        prepare_live("pandah")
    spec = tmp_path / "spec.yaml"
    spec.write_text(
        "{name: a, robot: iiwa7, start: [0, 0.6, 0, 1.6, 0, 0.6, 0], period: 0.005, duration: 1.0, supervisor: false,"
        " reference: {kind: set-point}, law: {kind: proportional, gain: 5}, plant: {kind: integrator}}"
    )
    jog = Jog(prepare_live(str(spec)))
    assert jog.live.period == 0.005
    assert hand(jog) == pytest.approx(dqc.load_robot("iiwa7").fkm(Q0))
    spec.write_text(spec.read_text().replace("}}", "}, repeats: 2}"))
    with pytest.raises(ShapeError, match=r"spec.yaml: describes several runs \(2 repeats\); one is driven"):
        Jog(prepare_live(str(spec)))

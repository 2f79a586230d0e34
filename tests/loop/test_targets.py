"""Desired poses that move to a goal or by a twist: straight, within speeds, and never far ahead of the hand."""

import numpy as np
import pytest

from dqcontrol import algebra
from dqcontrol.loop.targets import Clutch, LeaderTarget, PoseTarget, SampledTarget, Speeds, TwistTarget
from dqcontrol.references.sample import POSE, TWIST

START = algebra.pose([1, 0, 0, 0], [0.1, 0.2, 0.3])
DT = 0.01


def follow(target, steps, hand=None):
    """Return the samples of a target whose hand is always where it should be, or stays at a pose."""
    rows = [target.sample(0.0, START).copy()]
    for k in range(1, steps):
        rows.append(target.sample(k * DT, rows[-1][POSE] if hand is None else hand).copy())
    return np.array(rows)


def test_the_way_to_a_pose_is_straight_and_keeps_both_speeds():
    target = PoseTarget(Speeds(linear=0.1, angular=0.5))
    target.start(START)
    target.goal = algebra.pose(algebra.rotation_from_axis_angle([0, 0, 1], 1.5), [0.3, 0.2, 0.3])
    rows = follow(target, 320)
    p, r = algebra.translation(rows[:, POSE]), algebra.rotation(rows[:, POSE])
    np.testing.assert_allclose(rows[-1, POSE], target.goal, atol=1e-12)  # after 3 s, which the turn takes
    assert np.linalg.norm(np.diff(p, axis=0), axis=1).max() <= 0.1 * DT * (1 + 1e-9)
    turns = 2 * np.arccos(np.clip((r[1:] * r[:-1]).sum(axis=1), -1, 1))
    assert turns.max() <= 0.5 * DT * 1.001
    np.testing.assert_allclose(p[:, 1:], [[0.2, 0.3]] * len(p), atol=1e-12)


@pytest.mark.parametrize("of_hand", [False, True])
def test_a_twist_moves_the_pose_as_its_own_derivative(of_hand):
    target = TwistTarget(Speeds(linear=1.0, angular=1.0, acceleration=1e6), timeout=9.0)
    turned = algebra.pose(algebra.rotation_from_axis_angle([0, 1, 0], 0.5), [0.1, 0.2, 0.3])
    target.start(turned)
    target.ask(0.0, np.array([0.1, -0.05, 0.02]), np.array([0.3, 0.1, -0.2]), of_hand=of_hand)
    rows = [target.sample(0.0, turned).copy()]
    for k in range(1, 200):
        rows.append(target.sample(k * DT, rows[-1][POSE]).copy())
    rows = np.array(rows)
    x, rate = rows[1:-1, POSE], (rows[2:, POSE] - rows[:-2, POSE]) / (2 * DT)
    twist = 2 * algebra.multiply(rate, algebra.conjugate(x))  # ξ = 2 ẋ x*
    np.testing.assert_allclose(twist[:, [1, 2, 3, 5, 6, 7]], rows[1:-1, TWIST], atol=1e-3)


def test_a_twist_counts_only_for_its_time_and_within_the_speeds():
    target = TwistTarget(Speeds(linear=0.1, angular=0.5), timeout=0.1)
    target.start(START)
    target.ask(0.0, np.array([5.0, 0, 0]), np.zeros(3), of_hand=False)
    p = algebra.translation(follow(target, 40)[:, POSE])[:, 0]
    assert p[-1] - p[0] == pytest.approx(0.1 * 0.1, rel=0.11)
    assert np.ptp(p[22:]) < 1e-9  # it has stopped within its acceleration


def test_the_desired_pose_waits_for_a_hand_that_is_held():
    target = TwistTarget(Speeds(linear=0.5), timeout=9.0)
    target.start(START)
    target.ask(0.0, np.array([0.5, 0, 0]), np.zeros(3), of_hand=False)
    p = algebra.translation(follow(target, 300, hand=START)[:, POSE])[:, 0]
    assert 0.05 <= p[-1] - p[0] <= 0.056


@pytest.mark.parametrize("side", [[-1, 0, 0], [0, 1, 0], [-0.2, 0, -1], [0.3, 1, 0]])
def test_a_target_ahead_of_a_hand_that_is_held_comes_back_to_where_the_hand_is_led_next(side):
    """Else no goal would free a hand that stands before a singularity, a limit or a wall."""
    target, step = PoseTarget(Speeds(linear=0.5)), 0
    target.start(START)
    for goal in ([2.0, 0, 0], side):
        target.goal = algebra.multiply(algebra.pose([1, 0, 0, 0], goal), START)
        for _ in range(1000):
            step += 1
            row = target.sample(step * DT, START)
        ahead = algebra.translation(row[POSE]) - algebra.translation(START)
        assert np.linalg.norm(ahead) < 0.06
        assert ahead @ goal > 0.98 * np.linalg.norm(ahead) * np.linalg.norm(goal)


def test_a_turn_ahead_of_a_hand_that_is_held_comes_back():
    target = PoseTarget(Speeds(linear=0.5))
    target.start(START)
    for k, angle in ((0, 2.5), (300, -2.5)):
        target.goal = algebra.multiply(
            START, algebra.pose(algebra.rotation_from_axis_angle([0, 0, 1], angle), [0, 0, 0])
        )
        for i in range(300):
            row = target.sample((k + i) * DT, START)
        turned = algebra.multiply(algebra.conjugate(START), row[POSE])
        assert 2 * np.arctan2(turned[3], turned[0]) == pytest.approx(0.31 * np.sign(angle), abs=0.015)


def test_a_sampled_reference_gives_the_nearest_sample_and_ends():
    rows = np.zeros((3, 21))
    rows[:, 20] = [0.0, 0.01, 0.02]
    target = SampledTarget(rows, DT)
    assert [target.sample(t, START)[20] for t in (0.0, 0.0049, 0.0051, 9.0)] == [0.0, 0.0, 0.01, 0.02]
    assert (target.is_over(0.02), target.is_over(0.03)) == (False, True)


def speeds_of(rows):
    return np.diff(algebra.translation(rows[:, POSE]), axis=0, prepend=START_POSITION) / DT


START_POSITION = algebra.translation(START)[None]


@pytest.mark.parametrize("kind", ["pose", "twist"])
def test_targets_start_turn_and_stop_within_their_acceleration(kind):
    """A goal that jumps to the other side, a twist that turns round, then nothing more."""
    speeds = Speeds(linear=0.4, angular=1.0, acceleration=0.5)
    target = PoseTarget(speeds, timeout=0.3) if kind == "pose" else TwistTarget(speeds, timeout=0.3)
    target.start(START)
    hand, rows = START, []
    for k in range(400):
        if k in (1, 60, 100, 140):
            side = -1.0 if k == 100 else 1.0
            if isinstance(target, PoseTarget):
                target.ask(k * DT, algebra.pose([1, 0, 0, 0], [0.1 + side, 0.2, 0.3]))
            else:
                target.ask(k * DT, np.array([side, 0, 0]), np.zeros(3), of_hand=False)
        hand = target.sample(k * DT, hand)[POSE].copy()
        rows.append(np.concatenate([hand, np.zeros(13)]))
    speed = speeds_of(np.array(rows))
    change = np.linalg.norm(np.diff(speed, axis=0, prepend=np.zeros((1, 3))), axis=1)
    assert 0.1 < speed.max() <= 0.4 * (1 + 1e-9)
    assert change.max() <= 0.5 * DT * (1 + 1e-6)
    assert np.abs(speed[-20:]).max() < 1e-9


@pytest.mark.parametrize("lost", ["late", "nan"])
def test_a_pose_that_is_too_old_or_none_lets_the_hand_stay_where_it_is(lost):
    """The hand rests 3 cm behind the target that it was led to: that it is not led there any more."""
    target = PoseTarget(Speeds(), timeout=0.2 if lost == "late" else np.inf)
    target.start(START)
    goal = algebra.pose([1, 0, 0, 0], [0.13, 0.2, 0.3])
    for k in range(100):
        target.ask(k * DT, goal)
        target.sample(k * DT, START)
    assert target.sample(1.0, START)[POSE] == pytest.approx(goal)
    if lost == "nan":
        target.ask(1.0, np.full(8, np.nan))
    rows = [target.sample(1.0 + k * DT, START)[POSE].copy() for k in range(200)]
    assert rows[-1] == pytest.approx(START)
    target.ask(3.0, goal)
    rows = [target.sample(3.0 + k * DT, START)[POSE].copy() for k in range(20)]
    assert algebra.translation(rows[-1])[0] > 0.1 + 1e-3


def test_twists_that_are_none_stop_the_target():
    target = TwistTarget(Speeds())
    target.start(START)
    target.ask(0.0, np.array([np.nan, 0, 0]), np.zeros(3), of_hand=False)
    rows = follow(target, 20)
    assert np.ptp(rows[:, POSE], axis=0).max() == 0.0


def test_engaging_a_clutch_moves_nothing_and_then_the_hand_moves_as_the_device():
    rng = np.random.default_rng(38)
    hand, device, step = (algebra.exp_screw(rng.uniform(-1, 1, 6)) for _ in range(3))
    clutch = Clutch(hand, device)
    np.testing.assert_allclose(clutch.goal(device), hand, atol=1e-12)
    moved = clutch.goal(algebra.multiply(device, step))
    np.testing.assert_allclose(moved, algebra.multiply(hand, step), atol=1e-12)


def test_a_leader_is_followed_at_once_with_its_twist_and_from_where_both_are():
    target = LeaderTarget(Speeds(linear=1.0, angular=2.0), timeout=0.1)
    target.start(START)
    there = algebra.pose(algebra.rotation_from_axis_angle([0, 0, 1], 1.0), [5.0, 0, 0])
    spin, rows = np.array([0.2, 0.0, 1.0]), [START]
    for k in range(1, 50):
        t = k * DT
        turn = algebra.pose(
            algebra.rotation_from_axis_angle(spin / np.linalg.norm(spin), t * 1.02), [0, 0, 0]
        )
        moved = algebra.multiply(algebra.pose([1, 0, 0, 0], [5.0 + 0.3 * t, -0.1 * t, 0]), turn)
        target.ask(t, algebra.multiply(moved, algebra.rotation(there).tolist() + [0.0] * 4))
        rows.append(target.sample(t, rows[-1][POSE]).copy())
    way = algebra.translation(rows[-1][POSE]) - algebra.translation(rows[1][POSE])
    np.testing.assert_allclose(way, [0.3 * 48 * DT, -0.1 * 48 * DT, 0], atol=1e-12)
    before, now = rows[-2][POSE], rows[-1][POSE]
    moved = algebra.multiply(now, algebra.conjugate(before))
    turned = 2 * algebra.log_screw(moved)[:3] / DT
    np.testing.assert_allclose(rows[-1][TWIST][:3], turned, atol=1e-9)
    place = algebra.translation(now)
    np.testing.assert_allclose(
        rows[-1][TWIST][3:], np.array([0.3, -0.1, 0]) + np.cross(place, turned), atol=1e-9
    )  # v + p × ω


def test_a_leader_that_was_lost_leads_on_from_where_both_are_then():
    target, away = LeaderTarget(Speeds(linear=1.0), timeout=0.1), algebra.pose([1, 0, 0, 0], [9.0, 0, 0])
    for lost in ("NaN", "silence"):
        target.start(START)
        target.ask(0.0, START)
        target.sample(0.0, START)
        assert target.is_led(0.05)
        if lost == "NaN":
            target.ask(0.05, np.full(8, np.nan))
        stays = target.sample(0.15, START).copy()
        assert not target.is_led(0.15), lost
        target.ask(0.2, away)
        np.testing.assert_allclose(target.sample(0.21, START)[POSE], stays[POSE], atol=1e-12, err_msg=lost)


def test_a_leader_that_is_too_fast_is_followed_at_the_speeds():
    target = LeaderTarget(Speeds(linear=0.1, angular=0.5))
    target.start(START)
    target.ask(0.0, START)
    target.sample(0.0, START)
    target.ask(0.0, algebra.multiply(algebra.pose([1, 0, 0, 0], [0.02, 0, 0]), START))
    p = algebra.translation(follow(target, 40)[:, POSE])[:, 0]
    assert np.diff(p).max() == pytest.approx(0.1 * DT)
    assert p[-1] - p[0] == pytest.approx(0.02)

import math

import numpy as np
import pytest
import ruckig
from reference_samples import NAMES, QUARTER, START, STROKES, TILTED, references

from dqcontrol import algebra, references as r
from dqcontrol.errors import ShapeError, ValueRangeError
from dqcontrol.references.jerk_limited import MotionLimits, progress_at, s_curve
from dqcontrol.references.sample import motion_samples, point_motion

SQUARE = r.Square(START, side=0.1, duration=8.0)
LIMITS = {"velocity": 0.1, "acceleration": 0.3, "jerk": 2.0}
TURNS = {"angular_velocity": 0.8, "angular_acceleration": 3.0, "angular_jerk": 20.0}
ALLOWED = 1 + 1e-9


def along(reference, count=40_001):
    """Return times, and speed, tangential acceleration and the same of turning, in the middle of intervals."""
    times = np.linspace(0.0, reference.duration, count)
    times = 0.5 * (times[1:] + times[:-1])
    rows = reference.samples(times)
    _, v, a = point_motion(rows)
    w, alpha = rows[:, 8:11], rows[:, 14:17]
    speed, turn = np.linalg.norm(v, axis=1), np.linalg.norm(w, axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        tangential = np.where(speed > 1e-15, np.sum(v * a, axis=1) / speed, 0.0)
        turning = np.where(turn > 1e-15, np.sum(w * alpha, axis=1) / turn, 0.0)
    return times, speed, tangential, turn, turning


def random_limits(count):
    random = np.random.default_rng(12)
    return 10.0 ** random.uniform(-2, 2, size=(count, 4))


def test_least_time_is_that_of_ruckig():
    for length, speed, acceleration, jerk in random_limits(500):
        inputs, trajectory = ruckig.InputParameter(1), ruckig.Trajectory(1)
        inputs.target_position, inputs.max_velocity = [length], [speed]
        inputs.max_acceleration, inputs.max_jerk = [acceleration], [jerk]
        assert ruckig.Ruckig(1).calculate(inputs, trajectory) == ruckig.Result.Working
        pieces, seconds = s_curve(length, MotionLimits(speed, acceleration, jerk))
        assert seconds == pytest.approx(trajectory.duration, rel=1e-9)
        times = np.linspace(0.0, seconds, 50)
        which = np.clip(np.searchsorted(pieces[:, 0], times, side="right") - 1, 0, None)
        ours = np.array(progress_at(pieces[which], times))
        theirs = np.array([[each[0] for each in trajectory.at_time(t)] for t in times]).T
        scale = np.array([length, min(speed, length / seconds * 4), acceleration])[:, None]
        np.testing.assert_allclose(ours[:2] / scale[:2], theirs[:2] / scale[:2], atol=1e-7)


def test_pieces_join_and_keep_the_limits():
    for length, *values in random_limits(500):
        limits = MotionLimits(*values)
        pieces, seconds = s_curve(length, limits)
        ends = np.append(pieces[1:, 0], seconds)
        assert (ends >= pieces[:, 0]).all()
        starts, after = (np.array(progress_at(pieces, t)) for t in (pieces[:, 0], ends))
        scale = np.array([length, after[1].max(), np.abs(after[2]).max()])[:, None]
        np.testing.assert_allclose(starts[:, 1:] / scale, after[:, :-1] / scale, atol=1e-9)
        np.testing.assert_array_equal(starts[:, 0], 0.0)
        np.testing.assert_array_equal(after[:, -1], [length, 0.0, 0.0])
        assert after[1].max() <= ALLOWED * limits.speed
        assert np.abs(after[2]).max() <= ALLOWED * limits.acceleration
        assert np.abs(pieces[:, 5]).max() <= limits.jerk


@pytest.mark.parametrize("name", [name for name in NAMES if name.startswith("jerk-limited")])
def test_limits_along_the_path_are_never_exceeded(name):
    reference = references()[name]
    times, speed, tangential, turn, turning = along(reference)
    step = times[1] - times[0]
    assert speed.max() <= ALLOWED * reference.velocity
    even = name != "jerk-limited turns"  # there acceleration and jerk are limited of turn and path together
    if even:
        assert np.abs(tangential).max() <= ALLOWED * reference.acceleration
        jerk = np.diff(tangential) / step
        assert np.abs(jerk).max() <= (1 + 1e-6) * reference.jerk  # differences lose digits
    if reference.angular_velocity is not None:
        assert turn.max() <= ALLOWED * reference.angular_velocity
        if even:
            assert np.abs(turning).max() <= ALLOWED * reference.angular_acceleration
            assert np.abs(np.diff(turning) / step).max() <= (1 + 1e-6) * reference.angular_jerk
    reached = max(speed.max() / reference.velocity, np.abs(tangential).max() / reference.acceleration)
    if reference.angular_velocity is not None:
        reached = max(reached, turn.max() / reference.angular_velocity)
    assert reached > 0.9  # as fast as it may be


def test_joint_limits_where_turn_per_metre_changes():
    reference = references()["jerk-limited turns"]
    radian = 2.0 * 0.1 / 1.6  # the largest of 0.1/0.8, 0.3/3 and 2/20
    times = np.linspace(0.0, reference.duration, 40_001)
    rows = reference.samples(0.5 * (times[1:] + times[:-1]))
    _, v, _ = point_motion(rows)
    speed = np.hypot(np.linalg.norm(v, axis=1), radian * np.linalg.norm(rows[:, 8:11], axis=1))
    step = times[1]
    acceleration = np.diff(speed) / step
    assert speed.max() <= 0.1 * ALLOWED
    assert np.abs(acceleration).max() <= 0.3 * (1 + 1e-6)
    assert np.abs(np.diff(acceleration) / step).max() <= 2.0 * (1 + 1e-4)


@pytest.mark.parametrize(
    "reference",
    [
        SQUARE,
        r.Drawing(START, STROKES, plane=TILTED),
        r.Circle(START, radius=0.07, duration=9.0, plane=TILTED, turns=2.0),
        r.Points([0, 1, 3], algebra.pose(START[:4], [[0, 0, 0], [0.1, 0, 0], [0.1, 0.2, 0]])),
    ],
    ids=["square", "drawing", "circle", "points"],
)
def test_the_path_is_the_same_whatever_the_speed_of_the_reference(reference):
    smooth = r.JerkLimited(reference, **LIMITS)
    path = algebra.translation(reference.samples(np.linspace(0.0, reference.duration, 4001))[:, :8])
    positions = algebra.translation(smooth.samples(np.linspace(0.0, smooth.duration, 300))[:, :8])
    nearest = np.linalg.norm(positions[:, None] - path[None], axis=2).min(axis=1)
    assert nearest.max() < 2e-4  # half of the path's own spacing
    np.testing.assert_allclose(positions[[0, -1]], path[[0, -1]], atol=1e-14)
    slower = r.StartRamp(reference, seconds=0.5)
    if not len(reference.corners[:-1]):
        with pytest.raises(ValueRangeError, match="comes to rest by itself at its 0 s"):
            r.JerkLimited(slower, **LIMITS)


def test_speed_of_the_reference_does_not_matter():
    fast, slow = (
        r.JerkLimited(r.Square(START, side=0.1, duration=seconds, shares=[1, 2, 3, 1]), **LIMITS)
        for seconds in (1.0, 100.0)
    )
    times = np.linspace(0.0, fast.duration, 500)
    np.testing.assert_allclose(slow.samples(times), fast.samples(times), rtol=1e-9, atol=1e-11)


def test_rests_at_each_corner_and_pauses_as_long_as_the_reference():
    drawing = r.Drawing(START, [r.StraightStroke(0.1, 0, 0.1), r.Rest(0.7), r.StraightStroke(0.1, 0.1, 0.05)])
    smooth = r.JerkLimited(drawing, **LIMITS)
    ramp = 0.1 / 0.3 + 0.3 / 2.0
    side = 0.1 / 0.1 + ramp
    assert smooth.duration == pytest.approx(2 * side + 0.7)
    rows = smooth.samples([0.0, side, side + 0.3, side + 0.7, smooth.duration])
    np.testing.assert_allclose(rows[:, 8:20], 0.0, atol=1e-12)
    positions = algebra.translation(rows[:, :8]) - algebra.translation(START)
    np.testing.assert_allclose(positions[:, [0, 2]], [[0, 0]] + 3 * [[0.1, 0]] + [[0.1, 0.1]], atol=1e-14)


def test_turning_on_the_spot_takes_the_limits_of_turning():
    turn = r.Points(
        [0.0, 1.0], [START, algebra.multiply(START, [math.cos(0.5), math.sin(0.5), 0, 0, 0, 0, 0, 0])]
    )
    smooth = r.JerkLimited(turn, **LIMITS, **TURNS)
    expected = 1.0 / 0.8 + 0.8 / 3.0 + 3.0 / 20.0
    assert smooth.duration == pytest.approx(expected)
    with pytest.raises(ValueRangeError, match=r"angular_velocity: needed, .* turns on the spot at its 0 s$"):
        r.JerkLimited(turn, **LIMITS)


def test_an_uneven_path_is_run_at_constant_speed_between_the_ramps():
    via = references()["via points"]
    smooth = r.JerkLimited(via, velocity=0.02, acceleration=1.0, jerk=20.0)
    ramp = 2 * math.sqrt(0.02 / 20.0)  # full acceleration is not reached
    _, v, _ = point_motion(smooth.samples(np.linspace(ramp, smooth.duration - ramp, 2000)[1:-1]))
    np.testing.assert_allclose(np.linalg.norm(v, axis=1), 0.02, rtol=1e-9)
    times = np.linspace(0.0, via.duration, 200_001)
    length = np.linalg.norm(np.diff(algebra.translation(via.samples(times)[:, :8]), axis=0), axis=1).sum()
    assert smooth.duration == pytest.approx(length / 0.02 + ramp, rel=1e-7)
    via_poses = via.samples(np.array([2.0, 3.0, 5.0, 5.5, 7.0]) - 2.0)[:, :8]
    path = smooth.samples(np.linspace(0.0, smooth.duration, 20_001))[:, :8]
    for pose in via_poses:
        assert np.abs(path - pose).max(axis=1).min() < 1e-3


def test_in_sequences_it_starts_and_ends_without_corners():
    part = r.JerkLimited(SQUARE, **LIMITS)
    assert r.Sequence([part, r.SetPoint(START, duration=1.0), part]).corners.tolist() == []


def test_samples_give_back_the_motion_they_were_made_of():
    p, v, a, w, alpha = np.random.default_rng(4).normal(size=(5, 20, 3))
    for got, given in zip(
        point_motion(motion_samples(p, v, a, QUARTER[:4], w, alpha)), (p, v, a), strict=True
    ):
        np.testing.assert_allclose(got, given, atol=1e-14)


def limited(reference: r.Reference = SQUARE, **changes):
    return r.JerkLimited(reference, **{**LIMITS, **changes})


@pytest.mark.parametrize(
    ("make", "error", "message"),
    [
        (lambda: limited(velocity=0), ValueRangeError, r"^velocity: must be > 0, got 0$"),
        (lambda: limited(acceleration=-1), ValueRangeError, r"^acceleration: must be > 0, got -1$"),
        (lambda: limited(jerk=math.inf), ValueRangeError, r"^jerk: must be finite"),
        (lambda: limited(jerk=[1, 2]), ShapeError, r"^jerk: expected a single number"),
        (lambda: limited(angular_velocity=1), ShapeError, r"^angular_acceleration: missing: give all of angular_v"),
        (lambda: limited(**{**TURNS, "angular_jerk": 0}), ValueRangeError, r"^angular_jerk: must be > 0, got 0$"),
        (lambda: limited(r.SetPoint(START)), ValueRangeError, r"^reference: never ends"),
        (lambda: limited(r.SetPoint(START, duration=1)), ValueRangeError, r"^reference: never moves"),
        (lambda: limited(limited()), ValueRangeError, r"^reference: comes to rest by itself at its 0 s, where"),
    ],
)  # fmt: skip
def test_bad_input(make, error, message):
    with pytest.raises(error, match=message):
        make()


def test_a_path_too_long_for_numbers_is_refused():
    circle = r.Circle([1, 0, 0, 0, 0, 0, 0, 0], radius=1e200, duration=2.0)
    with (
        np.errstate(all="ignore"),
        pytest.raises(ValueRangeError, match="reference: too far and fast for its pace"),
    ):
        r.JerkLimited(circle, velocity=0.15, acceleration=0.5, jerk=4.0)

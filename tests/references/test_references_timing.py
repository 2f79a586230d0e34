import math

import numpy as np
import pytest
from reference_samples import START, STROKES

from dqcontrol import algebra, references as r
from dqcontrol.errors import ValueRangeError

SQUARE = r.Square(START, side=0.1, duration=8.0)
CIRCLE = r.Circle(START, radius=0.1, duration=8.0)


def path(reference, times):
    return algebra.translation(reference.samples(times)[:, :8])


def test_start_ramp_starts_from_rest_and_then_only_lags():
    smooth = r.StartRamp(CIRCLE, seconds=2.0)
    assert smooth.duration == 9.0
    assert not smooth.samples([0.0])[0, 8:20].any()
    later = np.linspace(2.0, 8.99, 50)
    np.testing.assert_allclose(smooth.samples(later)[:, :20], CIRCLE.samples(later - 1.0)[:, :20], atol=1e-14)
    speed = np.linalg.norm(np.diff(path(smooth, np.linspace(0.0, 2.0, 500)), axis=0), axis=1)
    assert (np.diff(speed) > 0).all()


def test_start_ramp_moves_the_corners_along():
    smooth = r.StartRamp(SQUARE, seconds=6.0)  # the first corner, at 2 s, lies within the ramp
    assert smooth.corners[1:] == pytest.approx([4 + 3, 6 + 3, 8 + 3])
    np.testing.assert_allclose(path(smooth, smooth.corners), path(SQUARE, SQUARE.corners), atol=1e-13)


def test_start_ramp_as_long_as_it_may_be():
    smooth = r.StartRamp(CIRCLE, seconds=16.0)
    assert smooth.duration == 16.0
    np.testing.assert_allclose(path(smooth, [16.0]), path(CIRCLE, [8.0]), atol=1e-14)


def test_corner_stops_rest_at_each_corner():
    smooth = r.CornerStops(SQUARE, seconds=0.5)
    stops = [0.0, 2.5, 5.0, 7.5, 10.0]
    assert smooth.duration == 10.0
    rows = smooth.samples(stops)
    np.testing.assert_allclose(rows[:, 8:20], 0.0, atol=1e-12)
    np.testing.assert_allclose(
        algebra.translation(rows[:, :8]), path(SQUARE, [0.0, 2.0, 4.0, 6.0, 8.0]), atol=1e-14
    )


def test_corner_stops_keep_each_side_of_a_corner_apart():
    before, after = r.CornerStops(SQUARE, seconds=0.5).samples([2.5 - 1e-3, 2.5 + 1e-3])[:, 11:14]
    assert before[0] > 0
    assert before[2] == 0
    assert after[0] == pytest.approx(0, abs=1e-20)
    assert after[2] < 0


def test_corner_stops_reach_the_reference_speed_and_no_more():
    smooth = r.CornerStops(SQUARE, seconds=0.5)
    speeds = np.linalg.norm(smooth.samples(np.linspace(0.0, 10.0, 2001))[:, 8:14], axis=1)
    assert speeds.max() == pytest.approx(0.05)
    assert speeds[300] == pytest.approx(0.05)  # at 1.5 s, between two ramps


def test_corner_stops_too_near_for_full_speed_slow_down():
    smooth = r.CornerStops(SQUARE, seconds=4.0)
    speeds = np.linalg.norm(smooth.samples(np.linspace(0.0, smooth.duration, 2001))[:, 8:14], axis=1)
    assert smooth.duration == 32.0
    assert speeds.max() == pytest.approx(0.025)


def test_bounds_of_acceleration_and_jerk_are_as_documented():
    line = r.Drawing(START, [r.StraightStroke(1.0, 0.0, speed=0.5)])
    smooth = r.CornerStops(line, seconds=0.4)
    times = np.linspace(0.0, smooth.duration, 40_001)
    acceleration = smooth.samples(times)[:, 17:20] @ np.array([1.0, 0.0, 0.0])
    jerk = np.diff(acceleration) / np.diff(times)
    assert np.abs(acceleration).max() == pytest.approx(1.875 * 0.5 / 0.4, rel=1e-4)
    assert np.abs(jerk).max() == pytest.approx(10 / math.sqrt(3) * 0.5 / 0.4**2, rel=1e-3)


def test_sequence_runs_one_after_the_other():
    drawing = r.Drawing(START, STROKES)
    whole = r.Sequence([r.SetPoint(START, duration=2.0), drawing, r.SetPoint(START)])
    assert whole.duration == math.inf
    times = np.linspace(0.0, drawing.duration - 1e-3, 100)
    np.testing.assert_allclose(whole.samples(times + 2.0)[:, :20], drawing.samples(times)[:, :20], atol=1e-12)
    np.testing.assert_allclose(whole.corners, np.concatenate([[2.4], drawing.corners[1:] + 2.0]), atol=1e-12)
    assert not whole.samples([1.0, 1e5])[:, 8:20].any()


def test_repeat_keeps_the_pose_from_jumping_between_x_and_minus_x():
    full_turn = r.Drawing(START, [r.Arc(0, 0, 0, 0.1, clockwise=True, speed=0.2)], orientation="path")
    thrice = r.Repeat(full_turn, 3)
    assert thrice.duration == pytest.approx(3 * full_turn.duration)
    np.testing.assert_allclose(thrice.corners, [thrice.duration])
    ends = thrice.samples(full_turn.duration * np.arange(4))[:, :8]
    np.testing.assert_allclose(ends, [START, -START, START, -START], atol=1e-13)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: r.StartRamp(CIRCLE, seconds=0.0), r"seconds: must be > 0, got 0"),
        (lambda: r.StartRamp(CIRCLE, seconds=16.1), r"seconds: must be ≤ 16, twice the reference, got 16.1"),
        (lambda: r.StartRamp(r.SetPoint(START), seconds=1.0), r"reference: never ends"),
        (lambda: r.CornerStops(r.SetPoint(START), seconds=1.0), r"reference: never ends"),
        (lambda: r.CornerStops(CIRCLE, seconds=math.nan), r"seconds: must be finite"),
        (lambda: r.Sequence([]), r"references: expected at least one, got none"),
        (lambda: r.Sequence([r.SetPoint(START), CIRCLE]), r"references\[0\]: never ends"),
        (
            lambda: r.Sequence([r.Drawing(START, [r.StraightStroke(0.3, 0.4, speed=0.1)]), CIRCLE]),
            r"references\[1\]: must start where references\[0\] ends, but starts 0.5 m and 0 degrees from",
        ),
        (lambda: r.Repeat(CIRCLE, 0), r"count: expected a whole number ≥ 1, got 0"),
        (lambda: r.Repeat(CIRCLE, 1.5), r"count: expected a whole number ≥ 1, got 1.5"),
        (lambda: r.Repeat(r.SetPoint(START), 2), r"references\[0\]: never ends"),
    ],
)
def test_bad_input(make, message):
    with pytest.raises(ValueRangeError, match=message):
        make()

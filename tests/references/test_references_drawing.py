import math

import numpy as np
import pytest
from reference_samples import START, STROKES, TILTED

from dqcontrol import algebra, references as r
from dqcontrol.errors import ShapeError, UnknownNameError, ValueRangeError

IDENTITY = np.eye(8)[0]
HALF = [r.StraightStroke(0.1, 0.0, speed=0.1), r.Arc(0.1, 0.1, 0.1, 0.05, clockwise=False, speed=0.1)]


def on_paper(drawing, times):
    """Return paper coordinates of a drawing on xz that starts at the origin."""
    return algebra.translation(drawing.samples(times)[:, :8])[:, [0, 2]]


def test_strokes_end_where_they_say():
    drawing = r.Drawing(IDENTITY, STROKES)
    ends = [(0, 0), (0.1, 0), (0.1, 0.1), (0.1, 0.1), (0.1, 0.1), (0.02, 0.17), (0, 0)]
    np.testing.assert_allclose(on_paper(drawing, drawing.trace.times[1:]), ends, atol=1e-15)


def test_length_duration_and_box():
    drawing = r.Drawing(START, STROKES, plane=TILTED)
    lengths = [0.1, 0.05 * math.pi, 0.08 * math.pi, math.hypot(0.08, 0.07), math.hypot(0.02, 0.17)]
    assert drawing.length == pytest.approx(sum(lengths))
    seconds = [0.4, 0.3, *np.array(lengths) / [0.05, 0.05, 0.08, 0.1, 0.07]]
    assert drawing.duration == pytest.approx(sum(seconds))
    np.testing.assert_allclose(drawing.box, [[0, 0], [0.15, 0.17]], atol=1e-15)


def test_box_sees_the_bulges_of_arcs():
    circle = [r.StraightStroke(0.1, 0.0, speed=1), r.Arc(0.1, 0.0, 0.1, 0.2, clockwise=True, speed=1)]
    np.testing.assert_allclose(r.Drawing(START, circle).box, [[-0.1, 0], [0.3, 0.4]], atol=1e-15)


def test_arcs_stay_on_their_circle_and_go_their_way():
    for clockwise, y in ((True, 0.1), (False, -0.1)):
        arc = r.Drawing(IDENTITY, [r.Arc(0.2, 0.0, 0.1, 0.0, clockwise=clockwise, speed=0.1)])
        points = on_paper(arc, np.linspace(0.0, arc.duration, 41))
        np.testing.assert_allclose(np.linalg.norm(points - [0.1, 0.0], axis=1), 0.1, atol=1e-15)
        np.testing.assert_allclose(points[20], [0.1, y], atol=1e-15)


def test_an_arc_written_with_few_digits_ends_exactly_and_stays_round():
    drawing = r.Drawing(IDENTITY, [r.Arc(0.07, 0.03, 0.0, 0.0971, clockwise=False, speed=0.1)])
    points = on_paper(drawing, np.linspace(0.0, drawing.duration, 101))
    np.testing.assert_allclose(points[-1], [0.07, 0.03], atol=1e-15)
    centre = np.linalg.solve(2 * (points[[50, 100]] - points[0]), np.sum(points[[50, 100]] ** 2, axis=1))
    np.testing.assert_allclose(np.linalg.norm(points - centre, axis=1), np.linalg.norm(centre), atol=1e-13)
    np.testing.assert_allclose(centre, [0.0, 0.0971], atol=1e-3)


def test_corners_are_where_the_tangent_or_the_speed_jumps():
    strokes = [
        *HALF,  # smooth
        r.StraightStroke(0.05, 0.1, speed=0.1),  # smooth
        r.StraightStroke(0.0, 0.1, speed=0.2),  # another speed
        r.StraightStroke(0.0, 0.2, speed=0.2),  # another direction
        r.Rest(1.0),
        r.StraightStroke(0.0, 0.3, speed=0.2),
    ]
    times = np.cumsum([1.0, 0.5 * math.pi, 0.5, 0.25, 0.5, 1.0, 0.5])
    np.testing.assert_allclose(r.Drawing(START, strokes).corners, times[2:], atol=1e-14)


def test_speed_is_constant_along_each_stroke():
    drawing = r.Drawing(START, STROKES, plane=TILTED)
    middle = drawing.trace.times[:-1] + 0.4 * np.diff(drawing.trace.times)
    speeds = np.linalg.norm(drawing.samples(middle)[:, 11:14], axis=1)
    np.testing.assert_allclose(speeds, [0, 0.05, 0.05, 0.08, 0, 0.1, 0.07], atol=1e-15)


def test_fixed_orientation_stays():
    rows = r.Drawing(START, STROKES, plane=TILTED).samples(np.linspace(0, 10, 50))
    np.testing.assert_allclose(rows[:, :4], [START[:4]] * 50, atol=1e-15)
    assert not rows[:, 8:11].any()


def test_hand_that_follows_the_path_keeps_its_angle_to_the_tangent():
    drawing = r.Drawing(START, STROKES, plane=TILTED, orientation="path", turn_speed=2.0)
    times = np.linspace(0.0, drawing.duration, 400)
    rows = drawing.samples(times)
    position, spin = algebra.translation(rows[:, :8]), rows[:, 8:11]
    velocity = rows[:, 11:14] - np.cross(position, spin)
    moving = np.linalg.norm(velocity, axis=1) > 1e-3
    tangent = velocity[moving] / np.linalg.norm(velocity[moving], axis=1, keepdims=True)
    r_hand = rows[moving, :4] * [1, -1, -1, -1]
    pure = np.concatenate([np.zeros((len(tangent), 1)), tangent], axis=1)
    zero = np.zeros_like(pure)
    in_hand = algebra.adjoint(np.hstack([r_hand, zero]), np.hstack([pure, zero]))[:, 1:4]
    np.testing.assert_allclose(in_hand, [in_hand[0]] * len(in_hand), atol=1e-14)


def test_hand_that_follows_the_path_turns_on_the_spot_at_corners():
    corner = [r.StraightStroke(0.1, 0.0, speed=0.1), r.StraightStroke(0.1, -0.1, speed=0.1)]
    drawing = r.Drawing(IDENTITY, corner, plane="xy", orientation="path", turn_speed=0.5)
    turn = 0.5 * math.pi / 0.5
    np.testing.assert_allclose(drawing.corners, [1.0, 1.0 + turn, 2.0 + turn])
    rows = drawing.samples([1.0 + 0.5 * turn, 1.0 + turn])
    np.testing.assert_allclose(rows[0, 8:11], [0, 0, -0.5], atol=1e-15)  # clockwise: the short way
    np.testing.assert_allclose(algebra.translation(rows[:, :8]), [[0.1, 0, 0]] * 2, atol=1e-15)
    np.testing.assert_allclose(rows[1, :4], np.array([1, 0, 0, -1]) * math.sqrt(0.5), atol=1e-15)


def test_rounded_coordinates_make_no_corner_and_no_jump_of_the_hand():
    across = 0.03 / math.sqrt(2)
    strokes = [
        r.StraightStroke(0.1, 0.0, speed=0.05),
        r.Arc(round(0.1 + across, 4), round(0.03 - across, 4), 0.1, 0.03, clockwise=False, speed=0.05),
        r.StraightStroke(round(0.1 + across, 4) + 0.05, round(0.03 - across, 4) + 0.05, speed=0.05),
    ]
    assert len(r.Drawing(START, strokes).corners) == 1  # the end
    follower = r.Drawing(START, strokes, orientation="path")
    seams = follower.trace.times[1:-1]
    assert len(follower.trace.times) == 4  # no turn on the spot
    before, after = (follower.samples(seams + h)[:, :8] for h in (-1e-8, 1e-8))
    np.testing.assert_allclose(before, after, atol=1e-7)
    turned = 2 * math.acos(abs(follower.samples([follower.duration])[0, :4] @ START[:4]))
    assert turned == pytest.approx(math.pi / 4, abs=1e-9)


def test_a_pause_before_the_first_stroke_needs_no_turn():
    strokes = [r.Rest(1.0), r.StraightStroke(0.0, 0.1, speed=0.1)]
    drawing = r.Drawing(START, strokes, orientation="path")
    assert drawing.duration == pytest.approx(2.0)
    np.testing.assert_allclose(drawing.samples([0.0, 1.5])[:, :4], [START[:4]] * 2, atol=1e-15)


def test_repeat_draws_it_again():
    once, twice = (r.Drawing(START, STROKES, repeat=n) for n in (1, 2))
    assert twice.duration == pytest.approx(2 * once.duration)
    times = np.linspace(0.0, once.duration - 1e-6, 60)
    again = twice.samples(times + once.duration)[:, :20]
    np.testing.assert_allclose(again, once.samples(times)[:, :20], atol=1e-13)


LINE = r.StraightStroke(0.1, 0.0, speed=0.1)


@pytest.mark.parametrize(
    ("strokes", "message"),
    [
        ([], r"strokes: expected at least one line or arc, got none"),
        ([r.Rest(1.0)], r"strokes: expected at least one line or arc, got none"),
        ([LINE, LINE], r"strokes\[1\]: has no length: it ends where it starts, at \(0.1, 0\)"),
        ([r.StraightStroke(math.nan, 0, speed=1)], r"strokes\[0\]: x: must be finite"),
        ([r.StraightStroke(1, 0, speed=0)], r"strokes\[0\]: speed: must be > 0, got 0"),
        ([r.StraightStroke(1, 0, speed=5e-324)], r"strokes\[0\]: takes no finite time"),
        ([r.Rest(-1.0), LINE], r"strokes\[0\]: seconds: must be > 0, got -1"),
        (
            [r.Arc(0.2, 0, 0.05, 0, clockwise=True, speed=1)],
            r"strokes\[0\]: does not end on its circle: the start \(0, 0\) is 0.05 m from the centre "
            r"\(0.05, 0\), the end \(0.2, 0\) 0.15 m",
        ),
        ([r.Arc(0.2, 0, 0, 0, clockwise=True, speed=1)], r"strokes\[0\]: has no radius"),
        ([r.Arc(0, 0, 0, math.inf, clockwise=True, speed=1)], r"strokes\[0\]: centre: must be finite"),
    ],
)
def test_bad_strokes(strokes, message):
    with pytest.raises(ValueRangeError, match=message):
        r.Drawing(START, strokes)


def drawing(**changes):
    return r.Drawing(**{"start": START, "strokes": [LINE], **changes})


@pytest.mark.parametrize(
    ("make", "error", "message"),
    [
        (lambda: drawing(start=np.ones(8)), ValueRangeError, r"start: expected a unit dual quaternion"),
        (lambda: drawing(start=np.ones(7)), ShapeError, r"start: expected shape"),
        (lambda: drawing(plane="XZ"), UnknownNameError, r"plane: unknown name 'XZ'"),
        (lambda: drawing(orientation="paths"), UnknownNameError, r"orientation: .* did you mean 'path'\?"),
        (lambda: drawing(turn_speed=0), ValueRangeError, r"turn_speed: must be > 0, got 0"),
        (lambda: drawing(repeat=0), ValueRangeError, r"repeat: expected a whole number ≥ 1, got 0"),
        (lambda: drawing(repeat=2), ValueRangeError, r"repeat: .* end at its origin, it ends 0.1 m from it"),
    ],
)
def test_bad_parameters(make, error, message):
    with pytest.raises(error, match=message):
        make()

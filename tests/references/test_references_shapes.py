import math

import numpy as np
import pytest
from reference_samples import NAMES, QUARTER, START, TILTED, references

import dqcontrol as dqc
from dqcontrol import algebra, references as r
from dqcontrol.errors import ShapeError, UnknownNameError, ValueRangeError

IDENTITY = np.eye(8)[0]


def moved(reference, times):
    rows = reference.samples(times)
    return algebra.translation(rows[:, :8]) - algebra.translation(reference.samples([0.0])[:, :8])


def test_set_point_rests_for_ever():
    point = r.SetPoint(START)
    assert point.duration == math.inf
    rows = point.samples([0.0, 1.0, 1e6])
    np.testing.assert_array_equal(rows[:, :8], [point.pose] * 3)
    assert not rows[:, 8:20].any()


def test_start_may_be_a_dual_quaternion_and_is_kept():
    circle = r.Circle(dqc.DualQuaternion(START), radius=0.1, duration=5.0)
    np.testing.assert_allclose(circle.samples([0.0])[0, :8], START, atol=1e-15)


def test_circle_is_the_published_one():
    circle = r.Circle(START, radius=0.07, duration=60.0)
    angle = np.linspace(0.0, 2 * math.pi, 3000, endpoint=False)
    expected = np.stack([0.07 * np.sin(angle), 0 * angle, 0.07 * (np.cos(angle) - 1)], axis=1)
    np.testing.assert_allclose(moved(circle, angle / (2 * math.pi) * 60.0), expected, atol=1e-14)
    rotations = circle.samples(np.linspace(0.0, 60.0, 9))[:, :4]
    np.testing.assert_allclose(rotations, [START[:4]] * 9, atol=1e-15)


@pytest.mark.parametrize(
    ("plane", "u", "v"),
    [
        ("xy", [1, 0, 0], [0, 1, 0]),
        ("yz", [0, 1, 0], [0, 0, 1]),
        (2 * np.array([[0, 0, 1], [1, 0, 0]]), [0, 0, 1], [1, 0, 0]),
    ],
)
def test_circle_planes_and_directions(plane, u, v):
    u, v = np.array(u), np.array(v)
    circle = r.Circle(IDENTITY, radius=0.2, duration=4.0, plane=plane, turns=1.5, clockwise=False)
    angle = np.linspace(0.0, 3 * math.pi, 31)[:, None]
    expected = 0.2 * (-np.sin(angle) * u + (np.cos(angle) - 1) * v)
    np.testing.assert_allclose(moved(circle, np.linspace(0.0, 4.0, 31)), expected, atol=1e-14)


def test_circle_speed():
    twist = r.Circle(IDENTITY, radius=0.1, duration=5.0, turns=3).samples([1.234])[:, 8:14]
    assert np.linalg.norm(twist) == pytest.approx(2 * math.pi * 0.1 * 3 / 5)


def test_spiral_is_the_published_one_with_a_ramp():
    angle = np.linspace(0.0, 6 * math.pi, 3000)
    across = 0.05 * np.sin(angle), 0.05 * (np.cos(angle) - 1)
    ramp = 0.05 * angle / (6 * math.pi)
    for axis, expected in (("x", (ramp, *across)), ("y", (across[0], ramp, across[1]))):
        spiral = r.Spiral(START, radius=0.05, length=0.05, axis=axis, duration=24.0)
        times = angle / (6 * math.pi) * 24.0
        np.testing.assert_allclose(moved(spiral, times), np.stack(expected, axis=1), atol=1e-14)


@pytest.mark.parametrize("axis", ["x", "y", "z"])
def test_spiral_axis_by_name_and_as_a_vector_agree(axis):
    vector = 3.0 * np.eye(3)["xyz".index(axis)]
    times = np.linspace(0.0, 6.0, 7)
    by_name, by_vector = (
        r.Spiral(START, radius=0.1, length=0.2, axis=a, duration=6.0).samples(times) for a in (axis, vector)
    )
    np.testing.assert_array_equal(by_name, by_vector)


def test_spiral_advances_along_its_axis_and_circles_across_it():
    axis = np.array([1.0, -2.0, 0.5]) / np.linalg.norm([1.0, -2.0, 0.5])
    spiral = r.Spiral(IDENTITY, radius=0.1, length=-0.3, axis=axis, turns=2.5, duration=5.0)
    path = moved(spiral, np.linspace(0.0, 5.0, 101))
    along = path @ axis
    np.testing.assert_allclose(along, np.linspace(0.0, -0.3, 101), atol=1e-14)
    across = path - along[:, None] * axis
    centre = across[20] / 2  # 20 of 100 intervals are half a turn
    np.testing.assert_allclose(np.linalg.norm(across - centre, axis=1), 0.1, atol=1e-14)
    assert centre[2] < 0  # it starts at the highest point


def test_square_corners_and_sides():
    square = r.Square(START, side=0.1, duration=40.0, shares=[5, 3, 5, 3])
    np.testing.assert_allclose(square.corners, [12.5, 20.0, 32.5, 40.0])
    corners = [[0, 0, 0], [0.1, 0, 0], [0.1, 0, -0.1], [0, 0, -0.1], [0, 0, 0]]
    np.testing.assert_allclose(moved(square, [0, 12.5, 20.0, 32.5, 40.0]), corners, atol=1e-15)
    assert np.linalg.norm(square.samples([15.0])[:, 8:14]) == pytest.approx(0.1 / 7.5)
    other = r.Square(START, side=0.1, duration=40.0, clockwise=False)
    np.testing.assert_allclose(moved(other, [10.0, 20.0]), [[-0.1, 0, 0], [-0.1, 0, -0.1]], atol=1e-15)


def test_points_run_by_sclerp():
    x1, x2 = algebra.pose([1, 0, 0, 0], [0, 0, 0]), QUARTER
    points = r.Points([1.0, 5.0], [x1, -x2])
    fractions = np.linspace(0.0, 1.0, 11)
    expected = algebra.sclerp(x1, x2, fractions)
    np.testing.assert_allclose(points.samples(4.0 * fractions)[:, :8], expected, atol=1e-14)


def test_points_of_one_orientation_run_straight_at_constant_speed():
    positions = np.random.default_rng(2).normal(size=(6, 3))
    times = np.array([0.0, 1.0, 1.5, 3.0, 4.0, 6.0])
    points = r.Points(times, algebra.pose(START[:4], positions))
    asked = np.linspace(0.0, 6.0, 61)
    expected = np.stack([np.interp(asked, times, positions[:, k]) for k in range(3)], axis=1)
    np.testing.assert_allclose(algebra.translation(points.samples(asked)[:, :8]), expected, atol=1e-13)
    np.testing.assert_allclose(points.corners, times[1:])


def test_points_on_one_line_at_one_speed_have_no_inner_corner():
    positions = np.outer([0.0, 1.0, 2.0, 3.0], [0.1, 0.2, 0.3])
    assert r.Points([0, 1, 2, 3], algebra.pose(START[:4], positions)).corners.tolist() == [3.0]


@pytest.mark.parametrize("name", NAMES)
def test_transformed_is_the_motion_seen_from_another_frame(name):
    reference = references()[name]
    other = r.Transformed(reference, by=QUARTER)
    times = np.linspace(0.0, reference.duration, 40)
    rows, seen = reference.samples(times), other.samples(times)
    np.testing.assert_allclose(seen[:, :8], algebra.multiply(QUARTER, rows[:, :8]), atol=1e-14)
    body, body_seen = (algebra.adjoint_twist(algebra.conjugate(x[:, :8]), x[:, 8:14]) for x in (rows, seen))
    np.testing.assert_allclose(body_seen, body, atol=1e-13)  # what the hand itself feels is unchanged
    np.testing.assert_array_equal(other.corners, reference.corners)
    back = r.Transformed(other, by=algebra.conjugate(QUARTER)).samples(times)
    np.testing.assert_allclose(back, rows, atol=1e-13)


def circle(**changes):
    return r.Circle(**{"start": START, "radius": 0.1, "duration": 5.0, **changes})


def spiral(**changes):
    return r.Spiral(**{"start": START, "radius": 0.1, "length": 0.1, "duration": 5.0, **changes})


def square(**changes):
    return r.Square(**{"start": START, "side": 0.1, "duration": 5.0, **changes})


POSES = np.array([IDENTITY, QUARTER, START])


@pytest.mark.parametrize(
    ("make", "error", "message"),
    [
        (
            lambda: r.SetPoint([2, 0, 0, 0, 0, 0, 0, 0]),
            ValueRangeError,
            r"pose: expected a unit dual quaternion",
        ),
        (lambda: r.SetPoint(START, duration=0.0), ValueRangeError, r"duration: must be > 0, got 0"),
        (lambda: r.SetPoint(START, duration=-math.inf), ValueRangeError, r"duration: must be finite"),
        (lambda: circle(start=[1, 0, 0, 0]), ShapeError, r"start: expected shape"),
        (lambda: circle(radius=-0.1), ValueRangeError, r"radius: must be > 0, got -0.1"),
        (lambda: circle(radius=math.nan), ValueRangeError, r"radius: must be finite"),
        (lambda: circle(duration=0), ValueRangeError, r"duration: must be > 0, got 0"),
        (lambda: circle(turns=0), ValueRangeError, r"turns: must be > 0, got 0"),
        (lambda: circle(plane="zx"), UnknownNameError, r"plane: unknown name 'zx'.*allowed: xy, xz, yz"),
        (lambda: circle(plane=[[1, 0, 0]]), ShapeError, r"plane: expected shape"),
        (lambda: circle(plane=[[1, 0, 0], [0, 0, 0]]), ValueRangeError, r"plane: must have no zero axis"),
        (
            lambda: circle(plane=[[1, 0, 0], [1, 1, 0]]),
            ValueRangeError,
            r"plane: must have perpendicular axes, got 45 deg",
        ),
        (lambda: spiral(axis="w"), UnknownNameError, r"axis: unknown name 'w'.*allowed: x, y, z"),
        (
            lambda: spiral(axis=[0, 0, 0]),
            ValueRangeError,
            r"axis: expected 'x', 'y', 'z' or a non-zero vector",
        ),
        (lambda: spiral(axis=[1, 0]), ShapeError, r"axis: expected shape"),
        (lambda: spiral(length=math.inf), ValueRangeError, r"length: must be finite"),
        (lambda: spiral(radius="wide"), ShapeError, r"radius: expected real numbers"),
        (lambda: square(side=0), ValueRangeError, r"side: must be > 0, got 0"),
        (lambda: square(shares=[1, 1]), ShapeError, r"shares: expected shape \(4,\), got \(2,\)"),
        (lambda: square(shares=[1, 1, 0, 1]), ValueRangeError, r"shares: must be > 0"),
        (lambda: r.Points([0, 1], POSES), ShapeError, r"poses: expected shape \(2, 8\)"),
        (lambda: r.Points([0], POSES[:1]), ShapeError, r"times: expected shape \(N,\) with N ≥ 2"),
        (
            lambda: r.Points([0, 2, 2], POSES),
            ValueRangeError,
            r"times: must increase, got 2 after 2 at index 2",
        ),
        (lambda: r.Points([0, 1, 2], POSES * [[1], [1], [2]]), ValueRangeError, r"poses: .* at index \(2,\)"),
        (
            lambda: r.Transformed(circle(), by=np.zeros(8)),
            ValueRangeError,
            r"by: expected a unit dual quaternion",
        ),
    ],
)
def test_bad_input(make, error, message):
    with pytest.raises(error, match=message):
        make()


def test_plane_need_not_have_unit_axes():
    np.testing.assert_allclose(
        circle(plane=TILTED).samples([1.0]), circle(plane=5 * np.array(TILTED)).samples([1.0]), atol=1e-15
    )

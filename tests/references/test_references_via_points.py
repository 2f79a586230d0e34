import numpy as np
import pytest
from reference_samples import QUARTER, START, references
from scipy.interpolate import CubicSpline

from dqcontrol import algebra, references as r
from dqcontrol.errors import ShapeError, ValueRangeError

TIMES = np.array([2.0, 3.0, 5.0, 5.5, 7.0])


@pytest.fixture
def via():
    return references()["via points"]


def test_runs_through_the_poses_at_their_times(via):
    poses = via.samples(TIMES - 2.0)[:, :8]
    np.testing.assert_allclose(poses, via.poses, atol=1e-14)
    np.testing.assert_array_equal(via.times, TIMES - 2.0)


def test_positions_are_those_of_scipys_natural_spline(via):
    times = np.linspace(0.0, 4.999, 400)
    spline = CubicSpline(TIMES - 2.0, algebra.translation(via.poses), bc_type="natural")
    np.testing.assert_allclose(algebra.translation(via.samples(times)[:, :8]), spline(times), atol=1e-14)


def test_twist_and_twist_rate_are_continuous_at_the_poses(via):
    for time in TIMES[1:-1] - 2.0:
        before, after = via.samples([time - 1e-7, time + 1e-7])[:, 8:20]
        assert np.abs(before).max() > 0.1
        np.testing.assert_allclose(before, after, atol=1e-4)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_goes_with_the_frame_and_does_not_mind_the_sign(sign, via):
    poses = via.poses * np.array([1, sign, sign, 1, 1])[:, None]
    moved = r.ViaPoints(TIMES, algebra.multiply(QUARTER, poses))
    times = np.linspace(0.0, 5.0, 101)
    expected = r.Transformed(via, by=QUARTER).samples(times)
    np.testing.assert_allclose(moved.samples(times), expected, atol=1e-12)


def test_two_poses_of_one_orientation_make_a_line():
    ends = algebra.pose(START[:4], [[0, 0, 0], [0.1, 0.2, 0.3]])
    line = r.ViaPoints([0, 2], ends)
    same = r.Points([0, 2], ends).samples([0.5, 1.0])
    np.testing.assert_allclose(line.samples([0.5, 1.0])[:, :20], same[:, :20], atol=1e-15)
    assert line.corners.tolist() == [2.0]


def turned(degrees):
    return algebra.pose(algebra.rotation_from_axis_angle([0, 0, 1], np.radians(degrees)), [0, 0, 0])


def test_a_steady_turn_about_one_axis_turns_in_its_plane():
    turn = r.ViaPoints(np.arange(7.0), np.array([turned(40.0 * k) for k in range(7)]))
    rows = turn.samples(np.linspace(0.0, 5.99, 200))
    np.testing.assert_allclose(rows[:, [8, 9]], 0.0, atol=1e-14)
    middle = rows[60:140, 10]
    np.testing.assert_allclose(middle, np.radians(40.0), rtol=0.05)


THIRD = [0.5, 0.5, 0.5, 0.5, 0, 0, 0, 0]
BACK = [0.5, -0.5, -0.5, -0.5, 0, 0, 0, 0]
WHIRL = [turned(0), THIRD, THIRD, BACK, THIRD]


@pytest.mark.parametrize(
    ("times", "poses", "error", "message"),
    [
        ([0], [START], ShapeError, r"^times: expected shape \(N,\) with N ≥ 2"),
        ([0, 0], [START, START], ValueRangeError, r"^times: must increase, got 0 after 0 at index 1$"),
        ([0, 1], [START], ShapeError, r"^poses: expected shape \(2, 8\)"),
        ([0, 1], [turned(0), turned(170)], ValueRangeError,
         r"^poses: must turn by at most 150 degrees between two, got 170 between index 0 and 1: give one in between$"),
        ([0, 7, 8, 8.5, 8.6], WHIRL, ValueRangeError, r"^poses: turn too far and unevenly between index 0 and 1 for"),
    ],
)  # fmt: skip
def test_bad_input(times, poses, error, message):
    with pytest.raises(error, match=message):
        r.ViaPoints(times, np.array(poses))

import numpy as np
import pytest
from reference_samples import NAMES, differentiated_twist, references, times_inside

from dqcontrol import algebra, references as r
from dqcontrol.errors import ShapeError, ValueRangeError

STEP = 1e-5

each = pytest.mark.parametrize("name", NAMES)


@each
def test_twist_is_the_derivative_of_the_pose(name):
    reference = references()[name]
    times = times_inside(reference)
    assert len(times) > 300
    twist = reference.samples(times)[:, 8:14]
    np.testing.assert_allclose(twist, differentiated_twist(reference, times, STEP), rtol=1e-8, atol=1e-8)


@each
def test_twist_rate_is_the_derivative_of_the_twist(name):
    reference = references()[name]
    times = times_inside(reference)
    before, after = (reference.samples(times + h)[:, 8:14] for h in (-STEP, STEP))
    rate = reference.samples(times)[:, 14:20]
    np.testing.assert_allclose(rate, (after - before) / (2 * STEP), rtol=1e-7, atol=1e-7)


@each
def test_poses_are_unit(name):
    reference = references()[name]
    pose = reference.samples(np.linspace(0.0, reference.duration, 300))[:, :8]
    np.testing.assert_allclose(np.linalg.norm(pose[:, :4], axis=1), 1.0, atol=1e-14)
    np.testing.assert_allclose(np.sum(pose[:, :4] * pose[:, 4:], axis=1), 0.0, atol=1e-14)


@each
def test_pose_is_continuous_everywhere(name):
    reference = references()[name]
    pose = reference.samples(np.linspace(0.0, reference.duration, 200_001))[:, :8]
    step = reference.duration / 200_000
    fastest = np.abs(reference.samples(times_inside(reference, 2000, 1e-6))[:, 8:14]).max()
    assert np.abs(np.diff(pose, axis=0)).max() <= 2.0 * step * fastest + 1e-15


@each
def test_twist_jumps_at_the_corners_and_nowhere_else(name):
    reference = references()[name]
    h = 1e-6
    for corner in reference.corners:
        left, right = reference.samples([corner - h, corner])[:, 8:14]
        assert np.abs(right - left).max() > 1e-3, f"no jump at {corner}"
        np.testing.assert_allclose(right, reference.samples([corner + h])[0, 8:14], atol=1e-4)
    times = np.linspace(h, reference.duration - h, 50_001)
    if len(reference.corners):
        away = np.abs(times[:, None] - reference.corners[None, :]).min(axis=1)
        times = times[away > 2 * h]
    if reference.duration not in reference.corners:
        np.testing.assert_allclose(reference.samples([reference.duration - h])[0, 8:14], 0.0, atol=1e-9)
    before, after = (reference.samples(times + side)[:, 8:14] for side in (-h, h))
    assert np.abs(after - before).max() < 1e-3


@each
def test_corners_give_the_twist_after_them_and_no_twist_rate(name):
    reference = references()[name]
    corners = reference.corners
    rows = reference.samples(corners)
    assert not rows[:, 14:20].any()
    near = reference.samples(np.maximum(corners + 1e-10 * np.resize([1, -1], len(corners)), 0.0))
    np.testing.assert_array_equal(near[:, :20], rows[:, :20])


@each
def test_rests_at_the_last_pose_after_the_end(name):
    reference = references()[name]
    end = reference.duration
    before, *after = reference.samples([end - 1e-9 * end - 2e-9, end, end + 1e-12, 2 * end, 1e9])
    for row in after:
        np.testing.assert_allclose(row[:8], before[:8], atol=1e-7)
        np.testing.assert_array_equal(row[:8], after[0][:8])
        assert not row[8:20].any()


@each
def test_time_is_the_one_asked_for_in_any_order(name):
    reference = references()[name]
    times = np.random.default_rng(0).uniform(0.0, 2 * reference.duration, 50)
    rows = reference.samples(times)
    assert rows.shape == (50, 21)
    np.testing.assert_array_equal(rows[:, 20], times)
    np.testing.assert_allclose(rows, [reference.at(t).data for t in times], rtol=1e-12, atol=1e-13)


@each
def test_samples_of_no_time(name):
    assert references()[name].samples(np.zeros(0)).shape == (0, 21)


@pytest.mark.parametrize(
    ("times", "error", "message"),
    [
        ([0.0, -0.5], ValueRangeError, r"times: must be ≥ 0, got -0.5"),
        ([np.nan], ValueRangeError, r"times: must be finite"),
        ([np.inf], ValueRangeError, r"times: must be finite"),
        ([[1.0]], ShapeError, r"times: expected shape \(N,\), got \(1, 1\)"),
        (1.0, ShapeError, r"times: expected shape \(N,\), got \(\)"),
        (["soon"], ShapeError, r"times: expected real numbers"),
    ],
)
def test_bad_times(times, error, message):
    with pytest.raises(error, match=message):
        references()["circle"].samples(times)


def test_bad_time():
    with pytest.raises(ShapeError, match="time: expected a single number"):
        references()["circle"].at([1.0])


def test_motion_samples_of_a_turning_and_moving_body():
    random = np.random.default_rng(1)
    p0, v0, a, axis = random.normal(size=(4, 3))
    axis /= np.linalg.norm(axis)
    speed, growth = 0.7, 0.3  # rad/s, rad/s²

    def motion(t):
        half = 0.5 * (speed * t + 0.5 * growth * t * t)[:, None]
        t = t[:, None]
        return r.motion_samples(
            p0 + v0 * t + 0.5 * a * t * t,
            v0 + a * t,
            a,
            np.concatenate([np.cos(half), np.sin(half) * axis], axis=1),
            (speed + growth * t) * axis,
            growth * axis,
        )

    t = np.linspace(0.0, 2.0, 20)
    before, now, after = (motion(t + h) for h in (-STEP, 0.0, STEP))
    pose_rate = (after - before)[:, :8] / (2 * STEP)
    twist = 2 * algebra.multiply(pose_rate, algebra.conjugate(now[:, :8]))
    np.testing.assert_allclose(now[:, 8:14], twist[:, [1, 2, 3, 5, 6, 7]], atol=2e-9)
    np.testing.assert_allclose(now[:, 14:20], (after - before)[:, 8:14] / (2 * STEP), atol=2e-9)

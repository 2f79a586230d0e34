import numpy as np
import pytest

from dqcontrol.errors import ShapeError, ValueRangeError
from dqcontrol.loop.record import Record

ARRAYS = ("time", "q", "measured", "command", "pose", "desired")


def pose(axis, angle, position):
    """Return x = r + ε½pr, written out independently of the package."""
    axis = np.asarray(axis, float) / np.linalg.norm(axis)
    w, v, p = np.cos(angle / 2), np.sin(angle / 2) * axis, np.asarray(position, float)
    return np.concatenate([[w], v, [-p @ v / 2], (w * p + np.cross(p, v)) / 2])


def make(x, target, **changes):
    x, target = np.atleast_2d(x), np.atleast_2d(target)
    count = len(x)
    fields = {
        "time": np.arange(count) * 0.1,
        "q": np.zeros((count, 3)),
        "measured": np.zeros((count, 3)),
        "command": np.zeros((count, 2)),
        "pose": x,
        "desired": np.hstack([target, np.zeros((count, 13))]),
        "joint_names": ("x", "y", "phi"),
        "input_names": ("v", "omega"),
    } | changes
    return Record(**fields)


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-6, 0.3, 2.0, np.pi - 1e-6])
def test_errors_have_their_closed_forms(angle):
    target = pose([1, 2, 3], 0.7, [0.1, -0.2, 0.3])
    turned = pose([1, 2, 3], 0.7 + angle, [0.13, -0.2, 0.34])
    record = make(turned, target)
    np.testing.assert_allclose(record.orientation_error, angle, rtol=1e-9, atol=1e-15)
    np.testing.assert_allclose(record.position_error, 0.05, rtol=1e-12)
    np.testing.assert_allclose(record.error, np.hypot(2 * np.sin(angle / 4), 0.025), rtol=1e-12)
    np.testing.assert_allclose(record.position[0], [0.13, -0.2, 0.34], atol=1e-15)


def test_the_other_sign_is_the_same_pose():
    target = pose([1, 0, 0], 0.4, [1, 2, 3])
    assert make(-target, target).error[0] < 1e-15
    assert make(-target, target).orientation_error[0] < 1e-15


def test_rotation_error_is_in_the_frame_of_the_hand():
    turned = pose([0, 0, 1], np.pi / 2, [0, 0, 0])
    target = pose([0, 0, 1], np.pi / 2 + 0.2, [5, 0, 0])
    np.testing.assert_allclose(make(turned, target).rotation_error, [[0, 0, 0.2]], atol=1e-15)


def test_a_diverged_sample_gives_nan_and_leaves_the_others():
    x = np.array([pose([1, 0, 0], 0.1, [0, 0, 0])] * 3)
    broken = x.copy()
    broken[1] = np.inf
    record = make(broken, x)
    assert np.isnan(record.error).tolist() == [False, True, False]
    assert np.isnan(record.position_error).tolist() == [False, True, False]


def test_arrays_are_read_only_and_the_callers_are_not():
    time = np.array([0.0, 1.0])
    record = make([[1, 0, 0, 0, 0, 0, 0, 0]] * 2, [[1, 0, 0, 0, 0, 0, 0, 0]] * 2, time=time)
    for name in ARRAYS:
        assert not getattr(record, name).flags.writeable
    time[0] = -1.0
    assert len(record) == 2
    assert not record.error.flags.writeable


@pytest.mark.parametrize(
    ("changes", "kind", "message"),
    [
        ({"time": [0.0, 0.0]}, ValueRangeError, "time: must be finite and increasing"),
        ({"time": [0.0, np.nan]}, ValueRangeError, "time: must be finite"),
        ({"time": [[0.0, 1.0]]}, ShapeError, r"time: expected shape \(any,\), got \(1, 2\)"),
        ({"q": np.zeros((3, 3))}, ShapeError, r"q: expected shape \(2, any\), got \(3, 3\)"),
        ({"measured": np.zeros((2, 4))}, ShapeError, r"measured: expected shape \(2, 3\), got \(2, 4\)"),
        ({"desired": np.zeros((2, 8))}, ShapeError, r"desired: expected shape \(2, 21\), got \(2, 8\)"),
        ({"command": [["a", "b"]] * 2}, ShapeError, "command: expected real numbers"),
        ({"joint_names": ("x",)}, ShapeError, "joint_names: expected 3 names, got 1"),
        ({"input_names": ()}, ShapeError, "input_names: expected 2 names, got 0"),
    ],
)
def test_what_does_not_fit_is_refused(changes, kind, message):
    x = [[1.0, 0, 0, 0, 0, 0, 0, 0]] * 2
    with pytest.raises(kind, match=message):
        make(x, x, **changes)


def test_an_empty_record_is_refused():
    with pytest.raises(ShapeError, match="at least one sample"):
        make(np.zeros((0, 8)), np.zeros((0, 8)))

import math

import numpy as np
import pytest
from reference_samples import START

import dqcontrol as dqc
from dqcontrol.errors import ShapeError, ValueRangeError
from dqcontrol.references import Sample


def test_layout():
    sample = Sample(dqc.DualQuaternion(START), twist=np.arange(6), twist_rate=np.arange(6, 12), time=2.5)
    np.testing.assert_allclose(sample.data, [*START, *range(12), 2.5], atol=1e-15)
    np.testing.assert_array_equal(sample.pose, sample.data[:8])


def test_rests_unless_told_otherwise():
    np.testing.assert_allclose(Sample(START).data, [*START, *[0.0] * 13], atol=1e-15)


def test_is_frozen():
    with pytest.raises(ValueError, match="read-only"):
        Sample(START).data[0] = 1.0


def test_pose_is_normalised():
    pose = START * (1 + 5e-7)
    assert np.linalg.norm(Sample(pose).data[:4]) == pytest.approx(1.0, abs=1e-15)


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"pose": 2 * START}, ValueRangeError, r"pose: expected a unit dual quaternion, got norm 2"),
        ({"pose": START[:7]}, ShapeError, r"pose: expected shape \(…, 8\)"),
        ({"pose": START, "twist": [1, 2, math.nan, 4, 5, 6]}, ValueRangeError, r"twist: must be finite"),
        ({"pose": START, "twist_rate": "fast"}, ShapeError, r"twist_rate: expected real numbers"),
        ({"pose": START, "time": [1.0]}, ShapeError, r"time: expected a single number"),
    ],
)
def test_bad_input(arguments, error, message):
    with pytest.raises(error, match=message):
        Sample(**arguments)


def test_a_twist_of_the_wrong_length_is_refused():
    with pytest.raises(ShapeError, match=r"twist: expected shape \(6,\), got \(3,\)"):
        Sample(START, twist=[1, 2, 3])


def test_several_poses_are_refused():
    with pytest.raises(ShapeError, match=r"pose: expected shape \(8,\), got \(2, 8\)"):
        Sample([START, START])

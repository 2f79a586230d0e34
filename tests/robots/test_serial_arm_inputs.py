"""Shapes, layouts and bad input of serial arms."""

import numpy as np
import pytest

from dqcontrol.errors import ShapeError, ValueRangeError
from dqcontrol.robots import Inertia, SerialArm, load_robot

METHODS = (
    "fkm",
    "frames",
    "pose_jacobian",
    "twist_jacobian",
    "translation_jacobian",
    "rotation_jacobian",
    "gravity_forces",
)


@pytest.fixture(scope="module")
def arm():
    return load_robot("iiwa7")


@pytest.mark.parametrize("method", METHODS)
def test_batch_equals_single(arm, method):
    q = np.random.default_rng(5).uniform(-2, 2, (2, 3, 7))
    batch = getattr(arm, method)(q)
    single = np.array([[getattr(arm, method)(row) for row in block] for block in q])
    np.testing.assert_array_equal(batch, single)
    assert getattr(arm, method)(np.empty((0, 7))).shape[0] == 0


@pytest.mark.parametrize("method", [*METHODS, "kinematics"])
def test_any_layout(arm, method):
    def call(q):
        result = getattr(arm, method)(q)
        return np.vstack([result.pose_jacobian, result.twist_jacobian]) if method == "kinematics" else result

    base = np.random.default_rng(6).uniform(-2, 2, 14)
    expected = call(base[::2].copy())
    read_only = base[::2].copy()
    read_only.flags.writeable = False
    for q in (base[::2], read_only, list(base[::2]), base[12::-2][::-1]):
        np.testing.assert_array_equal(call(q), expected)
    whole = call(np.ones(7))
    for q in (np.ones(7, dtype=int), [1] * 7, np.ones(7, dtype=np.float32)):
        np.testing.assert_array_equal(call(q), whole)


@pytest.mark.parametrize("method", [*METHODS, "kinematics"])
@pytest.mark.parametrize(
    ("q", "error", "text"),
    [
        (np.zeros(6), ShapeError, "q: expected shape"),
        (0.0, ShapeError, "q: expected shape"),
        (np.full(7, np.nan), ValueRangeError, "q: must be finite"),
        ([0, 0, np.inf, 0, 0, 0, 0], ValueRangeError, "q: must be finite"),
        (["a"] * 7, ShapeError, "q: expected real numbers"),
        (np.zeros(7, dtype=complex), ShapeError, "q: expected real numbers"),
        (None, ShapeError, "q: expected real numbers"),
    ],
)
def test_bad_configurations(arm, method, q, error, text):
    with pytest.raises(error, match=text):
        getattr(arm, method)(q)


def test_bad_gravity(arm):
    with pytest.raises(ShapeError, match=r"gravity: expected shape \(…, 3\)"):
        arm.gravity_forces(np.zeros(7), [0, 0])
    with pytest.raises(ShapeError, match="gravity: expected shape"):
        arm.gravity_forces(np.zeros(7), np.zeros((2, 3)))
    with pytest.raises(ValueRangeError, match="gravity: must be finite"):
        arm.gravity_forces(np.zeros(7), [0, 0, np.nan])
    with pytest.raises(ValueRangeError, match="inertia: ax18 has none"):
        load_robot("ax18").gravity_forces(np.zeros(5))


def test_gravity_in_closed_form():
    body = Inertia(np.array([2.0, 3.0]), np.array([[0.5, 0, 0], [0, 0, 0.1]]), np.zeros((2, 3, 3)))
    turned = [
        np.sqrt(0.5),
        -np.sqrt(0.5),
        0,
        0,
        0,
        0,
        0,
    ]  # z becomes y: the pendulum turns in the vertical plane
    back = [
        np.sqrt(0.5),
        np.sqrt(0.5),
        0,
        0,
        1.0,
        0,
        0,
    ]  # the slider, 1 m farther, moves vertically at q₁ = 0
    arm = SerialArm([turned, back, [1, 0, 0, 0, 0, 0, 0]], ["revolute", "prismatic"], inertia=body)
    angle, slide = 0.3, 0.2
    down = 9.81 * np.cos(angle) * (2 * 0.5 + 3 * 1.0) + 9.81 * np.sin(angle) * 3 * (slide + 0.1)
    np.testing.assert_allclose(
        arm.gravity_forces([angle, slide]), [-down, 9.81 * 3 * np.cos(angle)], rtol=1e-12
    )

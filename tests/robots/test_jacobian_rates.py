"""Time derivatives of the Jacobians against finite differences, Pinocchio and the acceleration that they predict."""
# pyright: reportAttributeAccessIssue=false
# (Pinocchio's compiled names are invisible to pyright)

import numpy as np
import pinocchio as pin
import pytest
from pinocchio_oracle import ARMS, model_of

from dqcontrol.errors import ShapeError, ValueRangeError
from dqcontrol.robots import SerialArm, load_robot

KINDS = ("pose", "twist", "translation", "rotation")


def random_chain(n, seed):
    rng = np.random.default_rng(seed)
    fixed = np.hstack([rng.normal(size=(n + 1, 4)), rng.uniform(-0.3, 0.3, (n + 1, 3))])
    fixed[:, :4] /= np.linalg.norm(fixed[:, :4], axis=1, keepdims=True)
    return SerialArm(fixed, [str(kind) for kind in rng.choice(["revolute", "prismatic"], n, p=[0.7, 0.3])])


def check_rates(arm, q, qdot):
    h = 1e-5
    for kind in KINDS:
        jacobian = getattr(arm, f"{kind}_jacobian")
        expected = (
            8 * (jacobian(q + h * qdot) - jacobian(q - h * qdot))
            - (jacobian(q + 2 * h * qdot) - jacobian(q - 2 * h * qdot))
        ) / (12 * h)
        actual = getattr(arm, f"{kind}_jacobian_derivative")(q, qdot)
        scale = max(1.0, np.abs(expected).max())  # 60 joints have entries of hundreds
        np.testing.assert_allclose(actual, expected, rtol=0, atol=1e-7 * scale, err_msg=kind)


def check_against_pinocchio(arm, q, qdot):
    model = model_of(arm)
    data, tool = model.createData(), model.getFrameId("tool")
    pin.computeJointJacobiansTimeVariation(model, data, q, qdot)
    pin.updateFramePlacements(model, data)
    rate = pin.getFrameJacobianTimeVariation(model, data, tool, pin.WORLD).reshape(6, -1)
    actual = arm.twist_jacobian_derivative(q, qdot)
    scale = max(1.0, np.abs(rate).max())
    np.testing.assert_allclose(actual, np.vstack([rate[3:], rate[:3]]), rtol=0, atol=1e-12 * scale)


@pytest.mark.parametrize("name", ARMS)
def test_presets(name):
    arm = load_robot(name)
    rng = np.random.default_rng(11)
    for q, qdot in rng.uniform(-1.5, 1.5, (5, 2, arm.configuration_size)):
        check_rates(arm, q, qdot)
        check_against_pinocchio(arm, q, qdot)


@pytest.mark.parametrize("n", [1, 2, 3, 6, 7, 60])
def test_random_chains(n):
    for seed in range(4):
        arm = random_chain(n, seed)
        q, qdot = np.random.default_rng(100 + seed).uniform(-1, 1, (2, n))
        check_rates(arm, q, qdot)
        check_against_pinocchio(arm, q, qdot)


def test_a_single_joint_does_not_change_its_own_twist():
    arm = SerialArm.from_dh([0.3], [0.1], [0.5], [0.2])
    np.testing.assert_array_equal(arm.twist_jacobian_derivative([0.4], [2.0]), np.zeros((6, 1)))
    # the point at radius 0.5 m turns at 2 rad/s: towards the axis with 0.5 · 2² m/s²
    acceleration = arm.translation_jacobian_derivative([0.4], [2.0])[:, 0] * 2.0
    np.testing.assert_allclose(acceleration, -2.0 * np.array([np.cos(0.7), np.sin(0.7), 0]), atol=1e-14)


@pytest.mark.parametrize("kind", KINDS)
def test_batch_equals_single(kind):
    arm = load_robot("iiwa7")
    q, qdot = np.random.default_rng(5).uniform(-2, 2, (2, 2, 3, 7))
    method = getattr(arm, f"{kind}_jacobian_derivative")
    single = np.array(
        [[method(*pair) for pair in zip(*block, strict=True)] for block in zip(q, qdot, strict=True)]
    )
    np.testing.assert_array_equal(method(q, qdot), single)


def test_bad_velocities():
    arm = load_robot("iiwa7")
    with pytest.raises(ShapeError, match=r"u: expected shape \(…, 7\), got shape \(6,\)"):
        arm.pose_jacobian_derivative(np.zeros(7), np.zeros(6))
    with pytest.raises(ShapeError, match=r"u: expected shape \(2, 7\) as q has, got \(7,\)"):
        arm.twist_jacobian_derivative(np.zeros((2, 7)), np.zeros(7))
    with pytest.raises(ValueRangeError, match="u: must be finite"):
        arm.rotation_jacobian_derivative(np.zeros(7), np.full(7, np.nan))
    with pytest.raises(ValueRangeError, match="q: must be finite"):
        arm.translation_jacobian_derivative(np.full(7, np.inf), np.zeros(7))

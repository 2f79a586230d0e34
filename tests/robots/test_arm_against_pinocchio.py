"""Kinematics and gravity of loaded and random arms against Pinocchio and finite differences."""
# pyright: reportAttributeAccessIssue=false, reportOptionalMemberAccess=false
# (Pinocchio's compiled names are invisible to pyright)

import numpy as np
import pinocchio as pin
import pytest
from pinocchio_oracle import ARMS, UrdfOracle, model_of, pose_matrix, symmetric

from dqcontrol.robots import Inertia, SerialArm, load_robot, load_urdf
from dqcontrol.robots.files.load import package_files

URDFS = {  # file, base, tip
    "panda": ("panda_description/urdf/panda.urdf", "panda_link0", "panda_hand"),
    "ur5": ("ur_description/urdf/ur5_robot.urdf", "base_link", "tool0"),
    "tiago arm": ("tiago_description/robots/tiago.urdf", "torso_lift_link", "arm_tool_link"),
    "tiago with lift": ("tiago_description/robots/tiago_no_hand.urdf", "base_link", "arm_7_link"),
    "talos arm": ("talos_data/robots/talos_reduced.urdf", "torso_2_link", "gripper_left_base_link"),
    "kinova": ("kinova_description/robots/kinova.urdf", "base", "j2s6s200_end_effector"),
    "xarm7": ("xarm_description/urdf/xarm7.urdf", "link_base", "link7"),
}


def close(actual, desired, atol):
    np.testing.assert_allclose(actual, desired, rtol=0, atol=atol)


def random_arm(rng, n, *, dh=None):
    kinds = [str(kind) for kind in rng.choice(["revolute", "prismatic"], n, p=[0.7, 0.3])]
    tensors = rng.normal(size=(n, 3, 3)) * 0.05
    body = Inertia(
        rng.uniform(0.1, 3, n), rng.normal(size=(n, 3)) * 0.1, tensors @ tensors.transpose(0, 2, 1)
    )
    if dh:
        theta, alpha = rng.uniform(-np.pi, np.pi, (2, n))
        d, a = rng.uniform(-0.3, 0.3, (2, n))
        return SerialArm.from_dh(theta, d, a, alpha, kinds, dh, inertia=body)
    fixed = np.hstack([rng.normal(size=(n + 1, 4)), rng.uniform(-0.3, 0.3, (n + 1, 3))])
    fixed[:, :4] /= np.linalg.norm(fixed[:, :4], axis=1, keepdims=True)
    return SerialArm(fixed, kinds, inertia=body)


def sample(arm, rng, count):
    lower = np.where(np.isfinite(arm.limits.lower), arm.limits.lower, -1.5)
    upper = np.where(np.isfinite(arm.limits.upper), arm.limits.upper, 1.5)
    return rng.uniform(lower, upper, (count, arm.configuration_size))


def check_finite_differences(arm, q):
    h = 1e-5
    steps = h * np.eye(arm.configuration_size)
    poses = (arm.fkm(q + steps) - arm.fkm(q - steps)) / (2 * h)
    close(arm.pose_jacobian(q), poses.T, atol=1e-8)
    points = [np.array([pose_matrix(x)[:3, 3] for x in arm.fkm(q + sign * steps)]) for sign in (1, -1)]
    close(arm.translation_jacobian(q), ((points[0] - points[1]) / (2 * h)).T, atol=1e-8)
    close(arm.rotation_jacobian(q), poses.T[:4], atol=1e-8)


@pytest.fixture(scope="module", params=URDFS)
def oracle(request):
    file, base, tip = URDFS[request.param]
    path = package_files("example-robot-data")[file]
    return UrdfOracle(path, load_urdf(path, base, tip), base, tip)


def test_urdf_kinematics(oracle):
    for q in sample(oracle.arm, np.random.default_rng(1), 10):
        close(pose_matrix(oracle.arm.fkm(q)), oracle.tip_pose(q), atol=1e-12)
        close(oracle.arm.twist_jacobian(q), oracle.twist_jacobian(q), atol=1e-12)
        check_finite_differences(oracle.arm, q)


def test_urdf_lumped_bodies(oracle):
    own = model_of(oracle.arm)
    total = sum(body.mass for body in oracle.model.inertias[1:])
    assert oracle.arm.inertia.mass.sum() == pytest.approx(total, rel=1e-12)
    for q in sample(oracle.arm, np.random.default_rng(2), 5):
        close(oracle.arm.gravity_forces(q), oracle.gravity_forces(q), atol=1e-9)
        close(symmetric(pin.crba(own, own.createData(), q)), oracle.mass_matrix(q), atol=1e-9)


def test_urdf_limits(oracle):
    model, limits = oracle.model, oracle.arm.limits
    for i, joint in enumerate(model.joints[1:]):
        if joint.nq == 1:
            assert limits.lower[i] == model.lowerPositionLimit[joint.idx_q]
            assert limits.upper[i] == model.upperPositionLimit[joint.idx_q]
        else:
            assert limits.upper[i] == np.inf
            assert limits.lower[i] == -np.inf
        for ours, theirs in (
            (limits.velocity[i], model.velocityLimit[i]),
            (limits.effort[i], model.effortLimit[i]),
        ):
            assert ours == (theirs or np.inf)


@pytest.mark.parametrize("name", ARMS)
def test_presets(name):
    arm = load_robot(name)
    for q in sample(arm, np.random.default_rng(3), 10):
        check_against_own_model(arm, q)


@pytest.mark.parametrize("dh", [None, "standard", "modified"])
@pytest.mark.parametrize("n", [1, 2, 5, 7, 60])
def test_random_chains(n, dh):
    rng = np.random.default_rng(100 + n)
    for _ in range(3):
        arm = random_arm(rng, n, dh=dh)
        check_against_own_model(arm, rng.uniform(-1.5, 1.5, n))


def check_against_own_model(arm, q):
    model = model_of(arm)
    data, tool = model.createData(), model.getFrameId("tool")
    pin.framesForwardKinematics(model, data, q)
    close(pose_matrix(arm.fkm(q)), data.oMf[tool].homogeneous, atol=1e-12)
    for pose, joint in zip(arm.frames(q), data.oMi[1:], strict=False):
        close(pose_matrix(pose), joint.homogeneous, atol=1e-12)
    jacobian = pin.computeFrameJacobian(model, data, q, tool, pin.WORLD).reshape(6, -1)
    close(arm.twist_jacobian(q), np.vstack([jacobian[3:], jacobian[:3]]), atol=1e-12)
    jacobian = pin.computeFrameJacobian(model, data, q, tool, pin.LOCAL_WORLD_ALIGNED).reshape(6, -1)
    close(arm.translation_jacobian(q), jacobian[:3], atol=1e-12)
    check_finite_differences(arm, q)
    if arm.inertia is not None:
        torque = pin.computeGeneralizedGravity(model, data, q)
        close(arm.gravity_forces(q), torque, atol=1e-9)
        model.gravity.linear = np.array([1.0, -2.0, 3.0])
        torque = pin.computeGeneralizedGravity(model, data, q)
        close(arm.gravity_forces(q, [1, -2, 3]), torque, atol=1e-9)


@pytest.mark.parametrize("dh", ["standard", "modified"])
def test_dh_is_the_product_of_its_matrices(dh):
    rng = np.random.default_rng(4)
    theta, d, a, alpha = rng.uniform(-1, 1, (4, 4))
    kinds = ["revolute", "prismatic", "prismatic", "revolute"]
    arm = SerialArm.from_dh(theta, d, a, alpha, kinds, dh)
    q = rng.uniform(-1, 1, 4)
    expected = np.eye(4)
    for i, kind in enumerate(kinds):
        th = theta[i] + q[i] * (kind == "revolute")
        along = d[i] + q[i] * (kind == "prismatic")
        c, s = np.cos(th), np.sin(th)
        about_z = np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, along], [0, 0, 0, 1]])
        c, s = np.cos(alpha[i]), np.sin(alpha[i])
        about_x = np.array([[1, 0, 0, a[i]], [0, c, -s, 0], [0, s, c, 0], [0, 0, 0, 1]])
        expected = expected @ (about_z @ about_x if dh == "standard" else about_x @ about_z)
    close(pose_matrix(arm.fkm(q)), expected, atol=1e-14)

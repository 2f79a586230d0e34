"""The robots that come with dqcontrol, against the published numbers that they were made from."""
# pyright: reportAttributeAccessIssue=false, reportOptionalMemberAccess=false
# (Pinocchio's compiled names are invisible to pyright)

import numpy as np
import pinocchio as pin
import pytest
from pinocchio_oracle import ARMS, Z_GRAVITY, model_of, pose_matrix, se3, symmetric

from dqcontrol.robots import SerialArm, describe, load_robot

Z, Y = np.array([0.0, 0, 1]), np.array([0.0, 1, 0])
# lbr_fri_ros2_stack, iiwa7_description.xacro: all link frames parallel at zero
IIWA_ORIGINS = [
    [0, 0, 0.1475],
    [0, -0.0105, 0.1925],
    [0, 0.0105, 0.2075],
    [0, 0.0105, 0.1925],
    [0, -0.0105, 0.2075],
    [0, -0.0707, 0.1925],
    [0, 0.0707, 0.091],
]
IIWA_AXES = [Z, Y, Z, -Y, Z, Y, Z]
IIWA_LINKS = [  # mass, centre, ixx, iyy, izz, iyz
    (3.394011, [0, -0.034819, 0.123299], 0.021383, 0.020403, 0.007563, 0.003797),
    (4.031991, [0, 0.039793, 0.086944], 0.031697, 0.03008, 0.009666, 0.005889),
    (3.394011, [0, 0.034819, 0.123299], 0.021383, 0.020403, 0.007563, -0.003797),
    (4.031989, [0, -0.039793, 0.086944], 0.031695, 0.030079, 0.009665, -0.005889),
    (1.529239, [0, -0.029824, 0.076267], 0.008485, 0.007136, 0.003848, 0.002806),
    (2.403626, [0, 0.07102, 0.00495], 0.007067, 0.006804, 0.004629, 0.000311),
    (0.259474, [3e-6, -2e-6, 0.013782], 0.000171, 0.000171, 0.000299, 0),
]


def published_model(origins, axes, links=None, tool=None):
    model = pin.Model()
    model.gravity.linear = Z_GRAVITY
    parent = 0
    for i, (origin, axis) in enumerate(zip(origins, axes, strict=True)):
        place = pin.SE3(np.eye(3), np.array(origin, dtype=float))
        parent = model.addJoint(
            parent, pin.JointModelRevoluteUnaligned(np.array(axis, dtype=float)), place, f"j{i}"
        )
        if links:
            mass, center, xx, yy, zz, yz = links[i]
            tensor = np.array([[xx, 0, 0], [0, yy, yz], [0, yz, zz]])
            model.appendBodyToJoint(parent, pin.Inertia(mass, np.array(center), tensor), pin.SE3.Identity())
    place = pin.SE3(np.eye(3), np.array(tool or [0.0, 0, 0]))
    model.addFrame(pin.Frame("tool", parent, 0, place, pin.FrameType.OP_FRAME))
    return model


def tool_pose(model, q):
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    return data.oMf[model.getFrameId("tool")].homogeneous


def within(arm, seed, count=20):
    return np.random.default_rng(seed).uniform(
        arm.limits.lower, arm.limits.upper, (count, len(arm.joint_names))
    )


def test_iiwa7_is_the_published_one():
    arm = load_robot("iiwa7")
    model = published_model(IIWA_ORIGINS, IIWA_AXES, IIWA_LINKS, [0.0, 0.0, 0.035])
    own = model_of(arm)
    for q in within(arm, 1):
        np.testing.assert_allclose(pose_matrix(arm.fkm(q)), tool_pose(model, q), rtol=0, atol=1e-12)
        torque = pin.computeGeneralizedGravity(model, model.createData(), q)
        np.testing.assert_allclose(arm.gravity_forces(q), torque, rtol=0, atol=1e-9)
        expected = symmetric(pin.crba(model, model.createData(), q))
        np.testing.assert_allclose(symmetric(pin.crba(own, own.createData(), q)), expected, rtol=0, atol=1e-9)
    assert arm.inertia.mass.sum() == pytest.approx(23.9 - 4.855658, abs=1e-4)


def test_meka_wrist_is_that_of_its_urdf():
    arm = load_robot("meka-a2")
    origins = [
        [0, -0.18465, 0],
        [0, 0, 0],
        [0, -0.03175, -0.27857],
        [0.00502, 0, 0],
        [0, 0, -0.27747],
        [0, 0, 0],
        [0, 0, 0],
    ]
    axes = [-Y, [-1, 0, 0], -Z, -Y, -Z, -Y, [-1, 0, 0]]
    model = published_model(origins, axes)
    to_wrist = np.linalg.inv(pose_matrix(arm.frames(np.zeros(7))[6])) @ tool_pose(model, np.zeros(7))
    np.testing.assert_allclose(to_wrist[:3, 3], 0, atol=1e-12)
    for q in within(arm, 2):
        wrist = pose_matrix(arm.frames(q)[6]) @ to_wrist
        np.testing.assert_allclose(wrist, tool_pose(model, q), rtol=0, atol=1e-12)
        tool = pose_matrix(arm.fkm(q))[:3, 3]
        assert np.linalg.norm(tool - wrist[:3, 3]) == pytest.approx(0.04414, abs=1e-12)


def test_meka_matches_the_standard_dh_table_of_dq_robotics():
    half = np.pi / 2
    standard = SerialArm.from_dh(
        theta=[half, half, -half, np.pi, np.pi, -half, np.pi],
        d=[0.18465, 0, 0.27857, 0, 0.27747, 0, 0],
        a=[0, -0.03175, -0.00502, 0, 0, 0, 0.04414],
        alpha=[-half, -half, half, half, half, -half, np.pi],
    )
    left = np.array([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])  # Rx(90°)
    right = np.array([[0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
    arm = load_robot("meka-a2")
    for q in within(arm, 3):
        expected = left @ pose_matrix(standard.fkm(q)) @ right
        np.testing.assert_allclose(pose_matrix(arm.fkm(q)), expected, rtol=0, atol=1e-12)


def test_meka_hangs_down_at_zero_and_stays_there():
    arm = load_robot("meka-a2")
    pose = pose_matrix(arm.fkm(np.zeros(7)))
    np.testing.assert_allclose(
        pose[:3, 3], [0.00502, -0.18465 - 0.03175, -0.27857 - 0.27747 - 0.04414], atol=1e-12
    )
    assert np.abs(arm.gravity_forces(np.zeros(7))).max() < 1.5


def test_ax18_reaches_along_its_links():
    arm = load_robot("ax18")
    np.testing.assert_allclose(arm.limits.upper, np.deg2rad(150) * np.ones(5))
    np.testing.assert_allclose(arm.limits.velocity, 2.0)
    # at zero: 0.159 forward, 0.02225 down, 0.1225 and 0.17 on from the wrist
    np.testing.assert_allclose(
        pose_matrix(arm.fkm(np.zeros(5)))[:3, 3], [0.159 + 0.1225 + 0.17, 0, 0.167 + 0.02225], atol=1e-12
    )


@pytest.mark.parametrize("name", ARMS)
def test_bodies_are_possible(name):
    inertia = load_robot(name).inertia
    if inertia is None:
        assert name in ("ax18", "kuka-lwr4", "youbot-arm")
        return
    for tensor in inertia.tensor:
        moments = np.linalg.eigvalsh(tensor)
        assert moments[0] > 0
        assert moments[0] + moments[1] > moments[2]  # no body has a moment beyond the sum of the others


def test_describe():
    table = describe(load_robot("iiwa7"))
    assert (table.name, len(table.joints)) == ("iiwa7", 7)
    row = table.joints[3]
    assert (row.name, row.type, row.effort) == ("joint_4", "revolute", 110)
    np.testing.assert_allclose([row.lower, row.upper, row.velocity], [-120, 120, 130])
    assert table.mass == pytest.approx(19.044341)
    assert describe(load_robot("ax18")).mass is None


@pytest.mark.parametrize("name", ARMS)
def test_nothing_is_beyond_the_reach(name):
    arm = load_robot(name)
    q = within(arm, 4, 5000)
    q[:, 0] = 0
    shoulder = pose_matrix(arm.frames(q[0])[1])[:3, 3]
    tools = np.array([pose_matrix(x)[:3, 3] for x in arm.fkm(q)])
    farthest = np.linalg.norm(tools - shoulder, axis=1).max()
    assert 0.6 * describe(arm).reach < farthest < describe(arm).reach + 1e-12


# libbarrett, config/wam7w.conf: mass, centre (mm), tensor xx yy zz xy xz yz (kg mm²), in the frame at each link's end
WAM_LINKS = [
    (10.7677, [-4.43, 121.89, -0.66], [134880.33, 113283.69, 90463.30, -2130.41, -124.85, 685.55]),
    (3.8749, [-2.37, 31.06, 15.42], [21409.58, 13778.75, 15589.06, 271.72, 24.61, -1819.20]),
    (1.8023, [-38.26, 207.51, 0.03], [59110.77, 3245.50, 59270.43, -2496.12, 7.38, -17.67]),
    (2.17266212, [5.53408, 0.06822, 119.27695], [10674.91, 10586.59, 2820.36, 45.03, -1355.57, -110.02]),
    (0.35655692, [0.05483, 28.86286, 1.48493], [371.12, 194.34, 382.09, -0.08, -0.03, -16.13]),
    (0.40915886, [-0.05923, -16.86123, 24.19052], [548.89, 238.46, 451.33, 0.19, -0.10, -44.30]),
    (0.07548270, [0.14836, 0.07252, -3.35185], [39.11, 38.77, 76.14, 0.19, 0, 0]),
]
# Universal Robots, DH parameters for calculations of kinematics and dynamics: mass, centre (mm), likewise
UR5_LINKS = [
    (3.7, [0, -25.61, 1.93]),
    (8.393, [212.5, 0, 113.36]),
    (2.33, [150, 0, 26.5]),
    (1.219, [0, -1.8, 16.34]),
    (1.219, [0, 1.8, 16.34]),
    (0.1879, [0, 0, -1.159]),
]


@pytest.mark.parametrize(("name", "links"), [("barrett-wam", WAM_LINKS), ("ur5", UR5_LINKS)])
def test_bodies_given_at_the_end_of_their_links(name, links):
    arm = load_robot(name)
    model = pin.Model()
    model.gravity.linear = Z_GRAVITY
    for i, (mass, center, *tensors) in enumerate(links):
        model.addJoint(i, pin.JointModelRZ(), se3(arm.chain[i]), f"j{i}")
        xx, yy, zz, xy, xz, yz = np.array(tensors[0] if tensors else [0] * 6) * 1e-6
        tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        body = pin.Inertia(mass, np.array(center) * 1e-3, tensor)
        model.appendBodyToJoint(
            i + 1, body, se3(arm.chain[i + 1])
        )  # theta is 0: the fixed pose is the whole row
    own = model_of(arm)
    for q in within(arm, 6):
        torque = pin.computeGeneralizedGravity(model, model.createData(), q)
        np.testing.assert_allclose(arm.gravity_forces(q), torque, rtol=0, atol=1e-8)
        if name == "barrett-wam":
            expected = symmetric(pin.crba(model, model.createData(), q))
            np.testing.assert_allclose(
                symmetric(pin.crba(own, own.createData(), q)), expected, rtol=0, atol=1e-8
            )

"""Presets and conventions against the models that DQ Robotics and example-robot-data ship."""
# pyright: reportAttributeAccessIssue=false
# (the compiled names of DQ Robotics are invisible to pyright)

import numpy as np
import pytest
from pinocchio_oracle import pose_matrix

from dqcontrol import algebra
from dqcontrol.errors import ShapeError, UnknownNameError
from dqcontrol.robots import SerialArm, load_robot
from dqcontrol.robots.files.load import package_files

dqrobotics = pytest.importorskip("dqrobotics")
theirs = pytest.importorskip("dqrobotics.robots")
modeling = pytest.importorskip("dqrobotics.robot_modeling")

ONE = dqrobotics.DQ([1.0])


def same_pose(ours, other):
    """Compare up to the sign of the whole dual quaternion."""
    sign = np.sign(ours[:4] @ other[:4])
    np.testing.assert_allclose(ours, sign * other, rtol=0, atol=1e-12)


def configurations(arm, seed, count=20):
    return np.random.default_rng(seed).uniform(-3, 3, (count, arm.configuration_size))


def test_panda():
    model = theirs.FrankaEmikaPandaRobot.kinematics()
    model.set_reference_frame(ONE)  # theirs stands 0.0413 m aside
    arm = load_robot("panda")
    for q in configurations(arm, 1):
        same_pose(arm.fkm(q), model.fkm(q).vec8())


def test_barrett_wam():
    model = theirs.BarrettWamArmRobot.kinematics()
    arm = load_robot("barrett-wam")
    for q in configurations(arm, 2):
        same_pose(arm.fkm(q), model.fkm(q).vec8())


def test_kuka_lwr4_up_to_the_wrist():
    model = theirs.KukaLw4Robot.kinematics()
    arm = load_robot("kuka-lwr4")
    wrist = arm.up_to("joint_7")
    for q in configurations(arm, 3):
        same_pose(wrist.fkm(q), model.fkm(q).vec8())
        forward = pose_matrix(arm.fkm(q)) @ [0, 0, -0.078, 1]
        np.testing.assert_allclose(forward[:3], pose_matrix(wrist.fkm(q))[:3, 3], atol=1e-12)


def test_ax18():
    model = theirs.Ax18ManipulatorRobot.kinematics()
    arm = load_robot("ax18")
    for q in configurations(arm, 4):
        same_pose(arm.fkm(q), model.fkm(q).vec8())


@pytest.mark.parametrize(
    ("name", "file", "tip", "turned"),
    [
        (
            "ur5",
            "ur_description/urdf/ur5_robot.urdf",
            "tool0",
            True,
        ),  # base_link is half a turn from the base
        ("panda", "panda_description/urdf/panda.urdf", "panda_link8", False),
    ],
)
def test_presets_and_urdf_within_its_rounding(name, file, tip, turned):
    arm = load_robot(name)
    urdf = load_robot(package_files("example-robot-data")[file], tip_link=tip)
    base = np.diag([-1.0, -1, 1, 1]) if turned else np.eye(4)
    assert arm.joint_names == urdf.joint_names
    for q in configurations(arm, 5):
        expected = base @ pose_matrix(urdf.fkm(q))
        np.testing.assert_allclose(pose_matrix(arm.fkm(q)), expected, rtol=0, atol=5e-11)


def test_denso_rows():
    rng = np.random.default_rng(6)
    table = np.vstack([rng.uniform(-0.5, 0.5, (3, 6)), rng.uniform(-np.pi, np.pi, (3, 6))])
    model = modeling.DQ_SerialManipulatorDenso(table)
    arm = SerialArm.from_denso(*table)
    for q in configurations(arm, 7):
        same_pose(arm.fkm(q), model.fkm(q).vec8())
        sign = np.sign(arm.fkm(q)[:4] @ model.fkm(q).vec8()[:4])
        np.testing.assert_allclose(arm.pose_jacobian(q), sign * model.pose_jacobian(q), rtol=0, atol=1e-12)


def test_denso_with_a_sliding_joint_base_and_tool():
    slide = SerialArm.from_denso(
        [0.1],
        [0.2],
        [0.3],
        [0.4],
        [0.5],
        [0.6],
        ["prismatic"],
        base=algebra.conjugate([1, 0, 0, 0, 0, 0, 0, -0.5]),
    )
    turned = np.array([np.cos(0.6), -np.sin(0.6), np.sin(0.6), np.cos(0.6)]).reshape(2, 2) @ [0.1, 0.2]
    np.testing.assert_allclose(pose_matrix(slide.fkm([0.7]))[:3, 3], [*turned, 0.3 + 0.7 + 1.0], atol=1e-14)


def test_bad_denso_rows():
    with pytest.raises(ShapeError, match=r"beta: expected 2 numbers as in a, got shape \(1,\)"):
        SerialArm.from_denso([0, 0], [0, 0], [0, 0], [0, 0], [0], [0, 0])
    with pytest.raises(
        UnknownNameError, match="joint_types: unknown name 'revolut'; did you mean 'revolute'"
    ):
        SerialArm.from_denso([0], [0], [0], [0], [0], [0], ["revolut"])

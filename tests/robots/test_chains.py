"""Arms joined, shortened and reversed."""

import numpy as np
import pytest
from pinocchio_oracle import pose_matrix

from dqcontrol import DualQuaternion, algebra
from dqcontrol.errors import ShapeError, UnknownNameError, ValueRangeError
from dqcontrol.robots import SerialArm, load_robot

RNG = np.random.default_rng(21)


def close(actual, desired):
    np.testing.assert_allclose(actual, desired, rtol=0, atol=1e-13)


@pytest.fixture(scope="module")
def iiwa():
    return load_robot("iiwa7")


@pytest.fixture(scope="module")
def slider():
    """A sliding joint between two revolute ones, with limits."""
    arm = load_robot("ax18").up_to(3)
    return SerialArm(
        arm.chain[:, :7], ["revolute", "prismatic", "revolute"], joint_names=["a", "b", "c"], name="slider"
    )


def test_joined_poses_are_products(iiwa, slider):
    between = DualQuaternion(algebra.exp_screw([0.1, 0.2, -0.3, 0.2, 0.1, 0.4]))
    end = DualQuaternion(algebra.exp_screw([-0.2, 0.1, 0.3, 0.0, 0.1, 0.2]))
    arm = SerialArm.join([iiwa, between, slider, end.vec8])
    assert arm.name == "iiwa7+slider"
    assert arm.joint_names == (*iiwa.joint_names, "a", "b", "c")
    assert arm.joint_types[7:] == ("revolute", "prismatic", "revolute")
    for q in RNG.uniform(-1, 1, (10, 10)):
        expected = DualQuaternion(iiwa.fkm(q[:7])) * between * DualQuaternion(slider.fkm(q[7:])) * end
        close(pose_matrix(arm.fkm(q)), pose_matrix(expected.vec8))
        before = DualQuaternion(iiwa.fkm(q[:7])) * between
        close(arm.twist_jacobian(q)[:, :7], iiwa.twist_jacobian(q[:7]))
        moved = np.array(
            [(before * _pure(column) * before.conj()).vec6 for column in slider.twist_jacobian(q[7:]).T]
        )
        close(arm.twist_jacobian(q)[:, 7:], moved.T)


def _pure(twist):
    return DualQuaternion([0.0, *twist[:3], 0.0, *twist[3:]])


def test_joined_data_is_kept(iiwa):
    panda = load_robot("panda")
    arm = SerialArm.join([iiwa, panda], name="both")
    assert arm.name == "both"
    assert arm.inertia is not None
    assert iiwa.inertia is not None
    assert panda.inertia is not None
    close(arm.inertia.mass, [*iiwa.inertia.mass, *panda.inertia.mass])
    close(arm.inertia.center[7:], panda.inertia.center)
    for field in ("lower", "upper", "velocity", "effort"):
        np.testing.assert_array_equal(
            getattr(arm.limits, field), [*getattr(iiwa.limits, field), *getattr(panda.limits, field)]
        )
    # hanging from the end of the first, the second is only load: the torque of the last joints is its own
    q = RNG.uniform(-1, 1, 14)
    pose = pose_matrix(iiwa.fkm(q[:7]))
    down = pose[:3, :3].T @ [0, 0, -9.81]
    np.testing.assert_allclose(arm.gravity_forces(q)[7:], panda.gravity_forces(q[7:], down), atol=1e-10)


def test_joined_names_stay_distinct_and_missing_inertia_stays_missing(iiwa):
    arm = SerialArm.join([iiwa, load_robot("ax18")])
    assert arm.joint_names[:2] == ("1/joint_1", "1/joint_2")
    assert arm.joint_names[5:8] == ("joint_6", "joint_7", "2/joint_1")
    assert arm.inertia is None


def test_bad_parts(iiwa):
    with pytest.raises(ShapeError, match="parts: expected at least one SerialArm, got 1 parts"):
        SerialArm.join([[1, 0, 0, 0, 0, 0, 0, 0]])
    with pytest.raises(ValueRangeError, match=r"parts\[1\]: expected unit dual quaternions, got norm 2"):
        SerialArm.join([iiwa, [2, 0, 0, 0, 0, 0, 0, 0]])
    with pytest.raises(ShapeError, match=r"parts\[1\]: expected real numbers, got 'iiwa7'"):
        SerialArm.join([iiwa, "iiwa7"])


@pytest.mark.parametrize("count", range(1, 8))
def test_up_to_a_joint(iiwa, count):
    q = RNG.uniform(-2, 2, (5, 7))
    arm = iiwa.up_to(count)
    assert iiwa.up_to(f"joint_{count}").name == arm.name
    assert arm.joint_names == iiwa.joint_names[:count]
    close(arm.fkm(q[:, :count]), iiwa.frames(q)[:, count - 1])
    close(arm.twist_jacobian(q[:, :count]), iiwa.twist_jacobian(q)[..., :count])
    assert arm.inertia is not None
    assert len(arm.inertia.mass) == len(arm.limits.upper) == count


def test_bad_joints(iiwa):
    with pytest.raises(UnknownNameError, match="joint: unknown name 'joint_9'; did you mean 'joint_"):
        iiwa.up_to("joint_9")
    for joint in (0, 8, True, 2.0):
        with pytest.raises(
            ValueRangeError, match="joint: must be the name of a joint or a number from 1 to 7"
        ):
            iiwa.up_to(joint)


@pytest.mark.parametrize("name", ["iiwa7", "slider"])
def test_reversed(name, request):
    arm = load_robot(name) if name == "iiwa7" else request.getfixturevalue(name)
    back = arm.reversed()
    assert back.joint_names == arm.joint_names[::-1]
    np.testing.assert_array_equal(back.limits.lower, arm.limits.lower[::-1])
    for q in RNG.uniform(-2, 2, (10, arm.configuration_size)):
        close(pose_matrix(back.fkm(q[::-1])), np.linalg.inv(pose_matrix(arm.fkm(q))))
        close(pose_matrix(back.reversed().fkm(q)), pose_matrix(arm.fkm(q)))

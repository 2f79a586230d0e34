import sys
from itertools import pairwise

import numpy as np
import pytest
from algebra_samples import error, random_poses

from dqcontrol import algebra
from dqcontrol.errors import MissingExtraError, ShapeError, ValueRangeError

POSES = random_poses(np.random.default_rng(30), 20)


def test_scipy_rotations():
    rotation = pytest.importorskip("scipy.spatial.transform", reason="SciPy is not installed").Rotation
    r = POSES[:, :4]
    theirs = algebra.scipy_from_rotation(r)
    assert error(theirs.as_matrix(), algebra.matrix_from_rotation(r)) < 1e-15
    assert error(algebra.rotation_from_scipy(theirs), r) < 1e-15
    assert error(algebra.rotation_from_scipy(theirs[3]), r[3]) < 1e-15
    angles = [0.1, -0.4, 2.0]
    assert (
        error(
            algebra.rotation_from_scipy(rotation.from_euler("xyz", angles)), algebra.rotation_from_rpy(angles)
        )
        < 1e-15
    )
    assert (
        error(
            algebra.rotation_from_scipy(rotation.from_euler("ZYZ", angles)), algebra.rotation_from_zyz(angles)
        )
        < 1e-15
    )


def test_pinocchio_placements():
    pin = pytest.importorskip("pinocchio", reason="Pinocchio is not installed")
    for x, y in pairwise(POSES):
        placement = algebra.se3_from_pose(x) * algebra.se3_from_pose(y)
        back = algebra.pose_from_se3(placement)
        assert error(back, algebra.short(algebra.multiply(x, y))) < 1e-14
    assert error(algebra.pose_from_se3(pin.SE3.Identity()), [1, 0, 0, 0, 0, 0, 0, 0]) == 0


def test_mujoco_poses():
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed")
    position, quaternion = algebra.mujoco_from_pose(POSES)
    assert error(algebra.pose_from_mujoco(position, quaternion), POSES) < 1e-15
    matrix, moved = np.empty(9), np.empty(3)
    for p, q, x in zip(position, quaternion, POSES, strict=True):
        mujoco.mju_quat2Mat(matrix, q)
        assert error(matrix.reshape(3, 3), algebra.matrix_from_pose(x)[:3, :3]) < 1e-15
        mujoco.mju_trnVecPose(moved, p, q, np.array([1.0, 2.0, 3.0]))
        assert error(moved, (algebra.matrix_from_pose(x) @ [1, 2, 3, 1])[:3]) < 1e-14


def test_dq_robotics_values():
    dqrobotics = pytest.importorskip("dqrobotics", reason="DQ Robotics is not installed")
    for x, y in pairwise(POSES):
        theirs = algebra.dqrobotics_from_pose(x) * algebra.dqrobotics_from_pose(y)
        ours = algebra.multiply(x, y)
        assert error(algebra.pose_from_dqrobotics(theirs), ours) < 1e-14
        assert error(algebra.translation(ours), dqrobotics.translation(theirs).vec3()) < 1e-14
        assert error(algebra.hamilton_plus(x), dqrobotics.hamiplus8(algebra.dqrobotics_from_pose(x))) < 1e-15
        assert error(algebra.hamilton_minus(x), dqrobotics.haminus8(algebra.dqrobotics_from_pose(x))) < 1e-15


@pytest.mark.parametrize("function", [algebra.se3_from_pose, algebra.dqrobotics_from_pose])
def test_objects_hold_one_pose(function):
    with pytest.raises(ShapeError, match=r"x: expected one pose, shape \(8,\), got shape \(20, 8\)"):
        function(POSES)
    with pytest.raises(ValueRangeError, match="x: expected a unit dual quaternion"):
        function(2 * POSES[0])


@pytest.mark.parametrize(
    ("function", "name"),
    [
        (algebra.se3_from_pose, "pinocchio"),
        (algebra.dqrobotics_from_pose, "dqrobotics"),
    ],
)
def test_a_library_that_is_missing(monkeypatch, function, name):
    monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(MissingExtraError, match=f"^{name}: not installed"):
        function(POSES[0])


@pytest.mark.parametrize(
    ("function", "match"),
    [
        (algebra.pose_from_se3, "placement: expected an object with 'rotation', got 3"),
        (algebra.pose_from_dqrobotics, "x: expected an object with 'vec8', got 3"),
        (algebra.rotation_from_scipy, "rotation: expected an object with 'as_quat', got 3"),
    ],
)
def test_an_object_of_another_kind(function, match):
    with pytest.raises(ShapeError, match=match):
        function(3)

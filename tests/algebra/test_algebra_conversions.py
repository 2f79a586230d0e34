import itertools

import numpy as np
import pytest
from algebra_samples import cases, error, poses, random_poses, rotation_about

from dqcontrol import algebra

NEAR = [0.0, 1e-15, -3e-15, 6e-15, 1e-12, 1e-9, -1e-9, 1e-5]
ANGLES = np.array(
    [center + offset for center in (0.0, np.pi / 2, np.pi, -np.pi / 2) for offset in NEAR] + [0.3, -2.0, 2.5]
)
TRIPLES = np.stack(np.meshgrid(ANGLES, ANGLES, ANGLES, indexing="ij"), axis=-1).reshape(-1, 3)


def turn(axis, angle):
    """Return rotation matrices about a coordinate axis from their definition."""
    c, s, i = np.cos(angle), np.sin(angle), "xyz".index(axis)
    m = np.zeros((*np.shape(angle), 3, 3))
    j, k = (i + 1) % 3, (i + 2) % 3
    m[..., i, i] = 1
    m[..., j, j], m[..., j, k], m[..., k, j], m[..., k, k] = c, -s, s, c
    return m


def zyz_matrix(angles):
    return turn("z", angles[..., 0]) @ turn("y", angles[..., 1]) @ turn("z", angles[..., 2])


def rpy_matrix(angles):
    return turn("z", angles[..., 2]) @ turn("y", angles[..., 1]) @ turn("x", angles[..., 0])


EULER = {
    "zyz": (zyz_matrix, algebra.rotation_from_zyz, algebra.zyz_from_rotation),
    "rpy": (rpy_matrix, algebra.rotation_from_rpy, algebra.rpy_from_rotation),
}


@pytest.mark.parametrize("name", EULER)
def test_angles_to_rotation_and_back(name):
    matrix, to_rotation, to_angles = EULER[name]
    expected = matrix(TRIPLES)
    r = to_rotation(TRIPLES)
    assert error(algebra.matrix_from_rotation(r), expected) < 2e-15
    assert error(matrix(to_angles(r)), expected) < 1e-14
    assert error(matrix(to_angles(-r)), expected) < 1e-14
    assert error(matrix(to_angles(algebra.rotation_from_matrix(expected))), expected) < 1e-14


@pytest.mark.parametrize("name", EULER)
def test_angles_of_random_rotations_are_unique(name):
    _, to_rotation, to_angles = EULER[name]
    rng = np.random.default_rng(20)
    angles = rng.uniform(-np.pi, np.pi, (1000, 3))
    angles[:, 1] = rng.uniform(0.01, 3.13, 1000) - (np.pi / 2 if name == "rpy" else 0)
    assert error(to_angles(to_rotation(angles)), angles) < 1e-13


def test_degenerate_zyz_angles():
    psi = np.linspace(-3, 3, 13)
    flat = algebra.zyz_from_rotation(algebra.rotation_from_zyz(np.stack([psi, 0 * psi, 0 * psi], axis=-1)))
    assert error(flat, np.stack([0 * psi, 0 * psi, psi], axis=-1)) < 1e-15
    r = algebra.rotation_from_matrix(
        zyz_matrix(np.stack([0.5 + 0 * psi, np.pi + 0 * psi, 0.5 - psi], axis=-1))
    )
    over = algebra.zyz_from_rotation(r)  # φ − ψ is known
    assert error(over, np.stack([0 * psi, np.pi + 0 * psi, -psi], axis=-1)) < 2e-15
    # The entries of the matrix that give ψ when θ = π: ψ = atan2(R12, −R11).
    m = algebra.matrix_from_rotation(r)
    assert error(over[:, 2], np.arctan2(m[:, 0, 1], -m[:, 0, 0])) < 2e-15


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_degenerate_rpy_angles(sign):
    roll, yaw = np.linspace(-1.4, 1.4, 9), 0.4
    angles = np.stack([roll, 0 * roll + sign * np.pi / 2, 0 * roll + yaw], axis=-1)
    out = algebra.rpy_from_rotation(algebra.rotation_from_rpy(angles))
    assert error(out, np.stack([roll - sign * yaw, 0 * roll + sign * np.pi / 2, 0 * roll], axis=-1)) < 2e-15
    m = rpy_matrix(angles)
    assert error(out[:, 0], np.arctan2(sign * m[:, 0, 1], m[:, 1, 1])) < 2e-15


@pytest.mark.parametrize("name", EULER)
def test_ranges_of_angles(name):
    _, to_rotation, to_angles = EULER[name]
    out = to_angles(np.concatenate([to_rotation(TRIPLES), -to_rotation(TRIPLES)]))
    low, high = (0, np.pi) if name == "zyz" else (-np.pi / 2, np.pi / 2)
    assert out[:, 1].min() >= low
    assert out[:, 1].max() <= high
    assert np.abs(out).max() <= np.pi


def test_rotation_matrix_and_quaternion():
    signs = np.array(list(itertools.product([-1.0, 0.0, 1.0], repeat=3)))
    axes = np.concatenate([signs[np.abs(signs).any(axis=1)], np.random.default_rng(21).normal(size=(20, 3))])
    for angle in ANGLES:
        r = rotation_about(axes, np.full(len(axes), angle))
        n = axes / np.linalg.norm(axes, axis=1)[:, None]
        k = np.cross(np.eye(3), n[:, None])  # [n]×
        m = np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * (k @ k)  # Rodrigues
        assert error(algebra.matrix_from_rotation(r), m) < 1e-15
        back = algebra.rotation_from_matrix(m)
        assert (back[:, 0] >= 0).all()
        assert np.minimum(np.abs(back - r).max(axis=1), np.abs(back + r).max(axis=1)).max() < 1e-15
        axis, theta = algebra.axis_angle_from_rotation(r)
        assert ((theta >= 0) & (theta <= np.pi)).all()
        assert error(np.linalg.norm(axis, axis=1), np.ones(len(axes))) < 1e-15
        again = algebra.rotation_from_axis_angle(axis, theta)
        assert error(algebra.matrix_from_rotation(again), m) < 1e-14


def test_axis_angle_convention():
    assert (
        error(algebra.rotation_from_axis_angle([0, 0, 5], np.pi / 3), [np.cos(np.pi / 6), 0, 0, 0.5]) < 1e-15
    )
    axis, angle = algebra.axis_angle_from_rotation([1.0, 0, 0, 0])
    assert axis.tolist() == [1, 0, 0]
    assert angle == 0
    axis, angle = algebra.axis_angle_from_rotation(
        rotation_about([0, 1, 0], 1e-200 + 4.0)
    )  # more than half a turn
    assert error(axis, [0, -1, 0]) < 1e-15
    assert abs(angle - (2 * np.pi - 4)) < 1e-15


def test_conversions_broadcast():
    angle = np.linspace(-1, 1, 5)
    r = algebra.rotation_from_axis_angle([[[0.0, 0, 1]], [[1, 0, 0]]], angle)
    assert r.shape == (2, 5, 4)
    assert error(r[1, 2], algebra.rotation_from_axis_angle([1, 0, 0], angle[2])) == 0
    x = algebra.pose(r, np.zeros((5, 3)))
    assert x.shape == (2, 5, 8)
    for convert in (algebra.zyz_from_rotation, algebra.rpy_from_rotation):
        assert convert(r).shape == (2, 5, 3)
    assert algebra.matrix_from_pose(x).shape == (2, 5, 4, 4)
    assert algebra.matrix_from_pose(x[:0]).shape == (0, 5, 4, 4)
    assert algebra.pose_from_matrix(algebra.matrix_from_pose(x[:0])).shape == (0, 5, 8)


@cases(poses())
def test_homogeneous_matrices(x):
    m = algebra.matrix_from_pose(x)
    assert error(m[..., :3, 3], algebra.translation(x)) == 0
    assert error(m[..., 3, :], np.broadcast_to([0, 0, 0, 1.0], (*x.shape[:-1], 4))) == 0
    back = algebra.pose_from_matrix(m)
    assert error(algebra.matrix_from_pose(back), m) < 1e-14
    assert (back[..., 0] >= 0).all()


def test_points_move_as_by_the_matrix():
    x = random_poses(np.random.default_rng(22))
    point = np.array([0.1, -2.0, 0.7])
    moved = algebra.vec3(
        algebra.adjoint(algebra.unvec(algebra.rotation(x)), algebra.unvec(point))
    ) + algebra.translation(x)
    assert error(moved, (algebra.matrix_from_pose(x) @ [*point, 1])[:3]) < 1e-15

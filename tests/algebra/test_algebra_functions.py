import numba
import numpy as np
import pytest
from algebra_samples import (
    cases,
    dual_quaternions,
    error,
    poses,
    quaternion_product,
    random_poses,
    rotation_about,
)
from hypothesis import strategies as st

from dqcontrol import algebra
from dqcontrol.algebra import dual_quaternion_kernels as kernels

ONE = np.array([1.0, 0, 0, 0, 0, 0, 0, 0])


@cases(dual_quaternions(), st.data())
def test_product_is_the_definition_and_associative(a, data):
    b, c = data.draw(dual_quaternions(a.shape[:-1])), data.draw(dual_quaternions(a.shape[:-1]))
    primary = quaternion_product(a[..., :4], b[..., :4])
    dual = quaternion_product(a[..., :4], b[..., 4:]) + quaternion_product(a[..., 4:], b[..., :4])
    ab = algebra.multiply(a, b)
    assert error(ab, np.concatenate([primary, dual], axis=-1)) < 1e-13
    assert error(algebra.multiply(ab, c), algebra.multiply(a, algebra.multiply(b, c))) < 2e-12


@pytest.mark.parametrize(("a", "b", "ab"), [("i", "j", "k"), ("j", "k", "i"), ("k", "i", "j")])
def test_product_of_units(a, b, ab):
    unit = {name: algebra.unvec(np.eye(4)[1 + n]) for n, name in enumerate("ijk")}
    epsilon = np.eye(8)[4]
    assert error(algebra.multiply(unit[a], unit[b]), unit[ab]) == 0
    assert error(algebra.multiply(unit[b], unit[a]), -unit[ab]) == 0
    assert error(algebra.multiply(unit[a], unit[a]), -ONE) == 0
    assert error(algebra.multiply(epsilon, epsilon), np.zeros(8)) == 0


@cases(dual_quaternions(), st.data())
def test_conjugate_and_hamilton_operators(a, data):
    b = data.draw(dual_quaternions(a.shape[:-1]))
    ab = algebra.multiply(a, b)
    assert error(algebra.conjugate(ab), algebra.multiply(algebra.conjugate(b), algebra.conjugate(a))) < 1e-13
    assert error(algebra.conjugate(a), a @ algebra.C8) == 0
    assert error(algebra.conjugate(a)[..., :4], a[..., :4] @ algebra.C4) == 0
    assert error((algebra.hamilton_plus(a) @ b[..., None])[..., 0], ab) < 1e-13
    assert error((algebra.hamilton_minus(b) @ a[..., None])[..., 0], ab) < 1e-13


@cases(dual_quaternions())
def test_inverse_and_norm(a):
    a = a + np.where(np.abs(a[..., :1]) < 0.5, 1.0, 0.0) * ONE  # away from zero divisors
    scale = 1 + np.abs(algebra.inverse(a)).max(initial=0.0)
    one = np.broadcast_to(ONE, a.shape)
    assert error(algebra.multiply(a, algebra.inverse(a)), one) < 1e-13 * scale
    assert error(algebra.multiply(algebra.inverse(a), a), one) < 1e-13 * scale
    squared, length = algebra.multiply(a, algebra.conjugate(a)), algebra.norm(a)  # |a|² = a a*
    assert error(squared[..., 0], length[..., 0] ** 2) < 1e-12
    assert error(squared[..., 4], 2 * length[..., 0] * length[..., 1]) < 1e-12
    assert error(squared[..., [1, 2, 3, 5, 6, 7]], np.zeros((*a.shape[:-1], 6))) < 1e-12


@cases(poses(), st.data())
def test_poses_are_a_group(x, data):
    y, z = data.draw(poses(x.shape[:-1])), data.draw(poses(x.shape[:-1]))
    one = np.broadcast_to(ONE, x.shape)
    xy = algebra.multiply(x, y)
    assert error(algebra.norm(xy), np.broadcast_to([1.0, 0.0], (*x.shape[:-1], 2))) < 1e-14
    assert error(algebra.multiply(xy, z), algebra.multiply(x, algebra.multiply(y, z))) < 1e-14
    assert error(algebra.multiply(x, algebra.conjugate(x)), one) < 1e-14
    assert error(algebra.inverse(x), algebra.conjugate(x)) < 1e-14
    assert error(algebra.multiply(x, ONE), x) == 0
    assert (
        error(algebra.matrix_from_pose(xy), algebra.matrix_from_pose(x) @ algebra.matrix_from_pose(y)) < 1e-13
    )
    assert error(algebra.matrix_from_pose(-x), algebra.matrix_from_pose(x)) == 0


@cases(poses(), st.data())
def test_adjoint(x, data):
    y = data.draw(poses(x.shape[:-1]))
    twist = data.draw(dual_quaternions(x.shape[:-1]))[..., :6]
    moved = algebra.adjoint_twist(x, twist)
    assert error(moved, algebra.vec6(algebra.adjoint(x, algebra.unvec(twist)))) < 1e-12
    assert error(moved, (algebra.adjoint_matrix(x) @ twist[..., None])[..., 0]) < 1e-12
    both = algebra.adjoint_matrix(algebra.multiply(x, y))
    assert error(both, algebra.adjoint_matrix(x) @ algebra.adjoint_matrix(y)) < 1e-12


def test_adjoint_matrix_agrees_with_pinocchio():
    pytest.importorskip("pinocchio", reason="Pinocchio is the reference")
    swap = np.roll(np.eye(6), 3, axis=1)  # Pinocchio stacks [v ; ω]
    for x in random_poses(np.random.default_rng(1), 20):
        assert error(algebra.adjoint_matrix(x), swap @ algebra.se3_from_pose(x).action @ swap) < 1e-14


def test_cross_and_dot_of_pure_values():
    rng = np.random.default_rng(2)
    u, v, w = rng.normal(size=(3, 5, 6))
    a, b = algebra.unvec(u), algebra.unvec(v)
    ab, ba = algebra.multiply(a, b), algebra.multiply(b, a)
    assert error(algebra.cross(a, b), (ab - ba) / 2) < 1e-15
    assert error(algebra.vec6(algebra.cross(a, b)), algebra.cross_twist(u, v)) == 0
    assert error(algebra.cross_twist(u, v)[:, :3], np.cross(u[:, :3], v[:, :3])) < 1e-15
    assert error(algebra.dot(a, b)[:, 0], np.sum(u[:, :3] * v[:, :3], axis=1)) < 1e-14
    assert error(algebra.dot(a, b)[:, [1, 2, 3, 5, 6, 7]], np.zeros((5, 6))) < 1e-15
    cyclic = [
        algebra.cross_twist(p, algebra.cross_twist(q, r)) for p, q, r in ((u, v, w), (v, w, u), (w, u, v))
    ]
    assert error(sum(cyclic), np.zeros((5, 6))) < 1e-13  # Jacobi identity


@cases(poses())
def test_short_is_the_same_pose(x):
    s = algebra.short(x)
    assert (s[..., 0] >= 0).all()
    assert error(algebra.matrix_from_pose(s), algebra.matrix_from_pose(x)) == 0
    assert error(algebra.short(-s)[s[..., 0] > 0], s[s[..., 0] > 0]) == 0


def test_parts_of_a_pose():
    p = np.array([0.3, -1.2, 2.0])
    r = rotation_about([1.0, 2.0, -1.0], 1.1)
    x = algebra.pose(r, p)
    turn = algebra.matrix_from_rotation(r)
    assert error(algebra.rotation(x), r) < 1e-15
    assert error(algebra.translation(x), p) < 1e-15
    assert error(algebra.body_translation(x), turn.T @ p) < 1e-15
    point = algebra.unvec(np.array([1.0, 2.0, 3.0]))
    assert error(algebra.vec3(algebra.adjoint(algebra.unvec(r), point)), turn @ [1, 2, 3]) < 1e-15


def test_vec_and_unvec_are_inverse():
    rng = np.random.default_rng(3)
    for size, vec in ((3, algebra.vec3), (4, algebra.vec4), (6, algebra.vec6), (8, algebra.vec8)):
        v = rng.normal(size=(2, 3, size))
        assert error(vec(algebra.unvec(v)), v) == 0


def test_outputs_are_new_arrays():
    x = np.array([[1.0, 0, 0, 0, 0, 0.5, 0, 0]])
    for function in (algebra.vec8, algebra.rotation, algebra.short, algebra.renormalise, algebra.unvec):
        out = function(x)
        out[:] = 7
    assert error(x, [[1.0, 0, 0, 0, 0, 0.5, 0, 0]]) == 0


def test_any_memory_layout_and_type():
    x = random_poses(np.random.default_rng(4), 4, 3)
    expected = algebra.multiply(x, x)
    frozen = x.copy()
    frozen.flags.writeable = False
    assert error(algebra.multiply(np.asfortranarray(x), frozen), expected) == 0
    assert error(algebra.multiply(x[::2, 1], x[::2, 1]), expected[::2, 1]) == 0
    assert error(algebra.multiply(x[0, 0].tolist(), algebra.DualQuaternion(x[0, 0])), expected[0, 0]) == 0
    assert error(algebra.multiply(np.eye(8, dtype=np.int32)[0], x), x) == 0
    assert algebra.multiply(x[:, :1], x[1]).shape == (4, 3, 8)
    assert algebra.multiply(x[:0], x[0, 0]).shape == (0, 3, 8)
    for i in range(4):
        assert error(algebra.multiply(x[:, :1], x[1])[i, 2], algebra.multiply(x[i, 0], x[1, 2])) == 0


@numba.njit
def _long_product(step, count, each):
    x, y = np.zeros(8), np.zeros(8)
    x[0] = 1.0
    for i in range(count):
        kernels.multiply(x, step, y)
        if (i + 1) % each == 0:
            kernels.renormalise(y, x)
        else:
            x[:] = y
    return x


@pytest.mark.slow
def test_a_million_products_stay_unit_when_renormalised():
    step = random_poses(np.random.default_rng(5))
    x = _long_product(step, 1_000_000, 100)
    assert abs(np.linalg.norm(x[:4]) - 1) < 1e-15
    assert abs(x[:4] @ x[4:]) < 1e-15 * np.linalg.norm(x[4:])
    g = algebra.log_screw(step)
    turns = 1_000_000 * g  # the same screw, with the whole turns of the half angle taken out of the rotation
    axis, angle = g[:3] / np.linalg.norm(g[:3]), np.linalg.norm(turns[:3])
    expected = np.concatenate([[np.cos(angle)], np.sin(angle) * axis])
    assert error(x[:4], expected) < 1e-8


def test_renormalise_is_idempotent_and_close():
    x = random_poses(np.random.default_rng(6), 50)
    noisy = x * 1.001 + 1e-4
    unit = algebra.renormalise(noisy)
    assert error(algebra.norm(unit), np.broadcast_to([1.0, 0.0], (50, 2))) < 1e-15
    assert error(algebra.renormalise(unit), unit) < 1e-15
    assert error(unit, x) < 2e-3

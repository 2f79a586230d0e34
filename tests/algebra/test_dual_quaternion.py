import copy
import doctest
import pickle
import subprocess
import sys

import numpy as np
import pytest
from algebra_samples import cases, error, poses, random_poses

from dqcontrol import algebra
from dqcontrol.algebra import DualQuaternion, conversions, dual_quaternion, functions
from dqcontrol.errors import ShapeError, ValueRangeError

X, Y = (DualQuaternion(x) for x in random_poses(np.random.default_rng(40), 2))
BATCH = DualQuaternion(random_poses(np.random.default_rng(41), 3, 2))
ONE = DualQuaternion.identity()


def test_holds_a_checked_read_only_copy():
    data = np.array([1, 0, 0, 0, 0, 0, 0, 0])
    x = DualQuaternion(data)
    data[0] = 9
    assert x.vec8.tolist() == [1, 0, 0, 0, 0, 0, 0, 0]
    assert x.vec8.dtype == np.float64
    for view in (x.vec8, x.P, x.D, (x * x).vec8, BATCH[0].vec8, np.asarray(x)):
        with pytest.raises(ValueError, match="read-only"):
            view[...] = 1


@cases(poses())
def test_reads_like_the_papers(values):
    x = DualQuaternion(values)
    assert x * x.conj() == DualQuaternion.identity(x.batch_shape)
    assert x.inverse() == x.conj()
    assert x.log().exp().isclose(x, 1e-11).all()
    assert (x**2).isclose(x * x, 1e-10).all()
    assert (1 - x) + x - 1 == 0 * x
    assert 2 * x == x + x
    assert x * 2 / 2 == x
    assert (-x) * (-1) == x
    assert x.same_pose(-x).all()
    assert not x.isclose(-x).any()
    assert error(DualQuaternion.from_pose(x.rotation, x.translation), x) < 1e-14
    assert DualQuaternion.from_matrix(x.matrix()).same_pose(x).all()
    assert error(np.concatenate([x.P, x.D], axis=-1), x.vec8) == 0


def test_methods_are_the_functions():
    xi = X.log()
    assert error(X * Y, algebra.multiply(X, Y)) == 0
    assert error(X.norm(), algebra.norm(X)) == 0
    assert error(xi.vec6, algebra.log_screw(X)) == 0
    assert error(X.body_translation, algebra.body_translation(X)) == 0
    assert error(X.adjoint(Y), algebra.adjoint(X, Y)) == 0
    assert error(xi.cross(Y.log()), algebra.cross(xi, Y.log())) == 0
    assert error(xi.dot(Y.log()), algebra.dot(xi, Y.log())) == 0
    assert error(X.sclerp(Y, [0.2, 0.7]), algebra.sclerp(X, Y, [0.2, 0.7])) == 0
    assert error(X ** [0.2, 0.7], algebra.power(X, [0.2, 0.7])) == 0
    assert error((2 * X).renormalise(), X) < 1e-15
    assert (-X.short()).short() == X.short()
    assert DualQuaternion.unvec(X.rotation).vec4.tolist() == X.rotation.tolist()
    assert DualQuaternion.unvec([1, 2, 3]).vec3.tolist() == [1, 2, 3]


def test_makers():
    p = [1.0, 2, 3]
    assert DualQuaternion.from_translation(p).translation.tolist() == p
    angles = np.array([0.1, -0.2, 0.3])
    x = DualQuaternion.from_rpy(angles, p)
    assert error(x.rpy(), angles) < 1e-15
    assert error(x.translation, np.array(p)) < 1e-15
    axis, angle = DualQuaternion.from_axis_angle([0, 3, 0], 0.5).axis_angle()
    assert error(axis, [0, 1, 0]) < 1e-15
    assert abs(angle - 0.5) < 1e-15
    turned = DualQuaternion.from_matrix(x.matrix()[:3, :3])
    assert error(turned.rotation, x.rotation) < 1e-15
    assert turned.translation.tolist() == [0, 0, 0]
    assert DualQuaternion([X, Y]).batch_shape == (2,)
    assert DualQuaternion(X) == X
    assert DualQuaternion.identity((2, 3)).batch_shape == (2, 3)


def test_equality_has_a_tolerance_and_no_hash():
    near = DualQuaternion(X.vec8 + 1e-13)
    assert near == X
    assert near == X.vec8
    assert DualQuaternion(X.vec8 + 1e-11) != X
    assert -X != X
    assert X != Y
    assert DualQuaternion.identity() == 1
    assert X != 1
    assert X != "x"
    assert X != None  # noqa: E711
    assert BATCH[0] != BATCH
    assert DualQuaternion([ONE, ONE]) != ONE
    assert DualQuaternion([ONE, ONE]) == 1
    assert BATCH.isclose(BATCH[1, 1]).tolist() == [[False, False], [False, True], [False, False]]
    far = DualQuaternion.from_translation([1e6, 0, 0])
    assert far == DualQuaternion.from_translation([1e6 * (1 + 1e-13), 0, 0])
    with pytest.raises(TypeError, match="unhashable"):
        hash(X)


def test_batches():
    assert len(BATCH) == 3
    assert [x.batch_shape for x in BATCH] == [(2,)] * 3
    assert BATCH[1][0] == BATCH[1, 0]
    assert error(BATCH[..., 1], BATCH.vec8[:, 1]) == 0
    assert error(BATCH[1:, 0], BATCH.vec8[1:, 0]) == 0
    assert error(BATCH[np.array([True, False, True])], BATCH.vec8[[0, 2]]) == 0
    assert error((X * BATCH)[2, 1], X * BATCH[2, 1]) == 0
    assert (BATCH[:, 0] * BATCH[0, 0]).batch_shape == (3,)
    with pytest.raises(IndexError):
        BATCH[0, 0, 0]
    with pytest.raises(TypeError, match="a single DualQuaternion cannot be indexed"):
        X[0]
    with pytest.raises(TypeError, match="a single DualQuaternion has no length"):
        len(X)
    with pytest.raises(TypeError, match="no length"):
        iter(X).__next__()


def test_numpy_functions_see_the_coefficients():
    assert np.shape(BATCH) == (3, 2, 8)
    assert error(np.stack([X, Y]), np.stack([X.vec8, Y.vec8])) == 0
    assert error(np.abs(X), np.abs(X.vec8)) == 0
    assert np.linalg.norm(1 - X) == np.linalg.norm((1 - X).vec8)
    assert np.asarray(X, dtype=np.float32).dtype == np.float32
    fresh = np.array(X)
    fresh[0] = 5
    assert DualQuaternion(X.vec8) == X
    for two in (np.float64(2), np.float32(2), np.int64(2), np.array(2.0)):
        assert two * X == X * 2
        assert X * two == X * 2
        assert isinstance(two * X, DualQuaternion)
        assert two - X == 2 - X


def test_pickle_and_copy():
    for x in (X, BATCH):
        for again in (pickle.loads(pickle.dumps(x)), copy.copy(x), copy.deepcopy(x)):
            assert error(again, x) == 0
            assert not again.vec8.flags.writeable


def test_prints():
    half = DualQuaternion.from_axis_angle([0, 0, 1], np.pi, [1, 2, 0])
    assert str(half) == "1k + ε(1i - 0.5j)"
    assert str(ONE) == "1"
    assert str(0 * X) == "0"
    assert str(DualQuaternion([-0.5, 0, 1e-14, 0, 0, -2, 0, 0])) == "-0.5 + ε(-2i)"
    assert str(DualQuaternion([0, 0, 0, 0, 0, 1, 0, 0])) == "ε(1i)"
    assert str(DualQuaternion([ONE, ONE * 2])) == "[1,\n 2]"
    assert str(DualQuaternion.identity((100,))).endswith("…]")
    assert repr(ONE.conj()) == "DualQuaternion([1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])"
    assert "-0.0" not in repr(ONE.conj())
    for x in (X, BATCH):
        assert error(eval(repr(x)), x) == 0
    assert repr(DualQuaternion.identity((100, 2))).startswith("<DualQuaternion batch (100, 2): [1.0, 0.0,")


@pytest.mark.parametrize(
    "use",
    [
        lambda x: x.rotation,
        lambda x: x.translation,
        lambda x: x.body_translation,
        lambda x: x.log(),
        lambda x: x**2,
        lambda x: x.matrix(),
        lambda x: x.rpy(),
        lambda x: x.axis_angle(),
        lambda x: x.sclerp(ONE, 0.5),
    ],
)
def test_what_needs_a_pose_names_the_norm(use):
    with pytest.raises(
        ValueRangeError, match=r"expected a unit dual quaternion \(norm 1\), got norm 2 \+ ε [-+.e\d]+$"
    ):
        use(2 * X)
    with pytest.raises(ValueRangeError, match=r"got norm 1 \+ ε 0\.25 at index \(1,\)"):
        use(DualQuaternion([ONE, DualQuaternion([1, 0, 0, 0, 0.25, 0, 0, 0])]))


@pytest.mark.parametrize(
    ("use", "kind", "match"),
    [
        (lambda: DualQuaternion([1, 2, 3]), ShapeError, r"vec8: expected shape \(…, 8\), got shape \(3,\)"),
        (lambda: DualQuaternion(["a"] * 8), ShapeError, "vec8: expected real numbers"),
        (lambda: DualQuaternion([np.nan] * 8), ValueRangeError, "vec8: must be finite"),
        (
            lambda: X * np.ones(8),
            ShapeError,
            r"got an array of shape \(8,\); make coefficients a DualQuaternion",
        ),
        (lambda: np.ones(8) * X, ShapeError, r"got an array of shape \(8,\)"),
        (lambda: X * [1, 2], ShapeError, r"operand: expected a number or a DualQuaternion"),
        (lambda: X * "a", TypeError, "can't multiply|unsupported"),
        (lambda: X + None, TypeError, "unsupported"),
        (lambda: X**Y, TypeError, "unsupported"),
        (lambda: X / Y, TypeError, "unsupported"),
        (lambda: X / 0, ValueRangeError, "division: a dual quaternion cannot be divided by 0"),
        (lambda: X * np.inf, ValueRangeError, "number: must be finite, got inf"),
        (
            lambda: BATCH + DualQuaternion.identity((5,)),
            ShapeError,
            r"a, b: batches of shapes \(3, 2\), \(5,\)",
        ),
        (
            lambda: BATCH * DualQuaternion.identity((5,)),
            ShapeError,
            r"a, b: batches of shapes \(3, 2\), \(5,\)",
        ),
        (
            lambda: BATCH.isclose(np.ones((5, 8))),
            ShapeError,
            r"value, other: batches of shapes \(3, 2\), \(5,\)",
        ),
        (lambda: X.isclose([1, 2]), ShapeError, r"other: expected shape \(…, 8\)"),
        (lambda: X.same_pose("x"), ShapeError, r"other: expected real numbers"),
        (lambda: (0 * X).inverse(), ValueRangeError, "x: primary part is zero"),
        (lambda: (0 * X).renormalise(), ValueRangeError, "x: primary part is zero"),
        (lambda: (-ONE).log(), ValueRangeError, "x: rotation −1 .* use short"),
        (lambda: X.exp(), ValueRangeError, r"x: expected a pure dual quaternion \(real parts 0\)"),
        (lambda: X.vec4, ValueRangeError, r"x: expected a quaternion \(dual part 0\)"),
        (lambda: X.vec3, ValueRangeError, r"x: expected a pure quaternion"),
        (lambda: X.adjoint("y"), ShapeError, "y: expected real numbers"),
        (
            lambda: DualQuaternion.from_matrix(np.zeros((3, 4))),
            ShapeError,
            r"matrix: expected shape \(…, 4, 4\)",
        ),
    ],
)
def test_errors(use, kind, match):
    with pytest.raises(kind, match=match):
        use()


@pytest.mark.parametrize("module", [functions, conversions, dual_quaternion])
def test_examples_of_the_docstrings(module):
    result = doctest.testmod(module)
    assert result.attempted > 0
    assert result.failed == 0


def test_import_compiles_nothing():
    code = (
        "import dqcontrol.algebra.functions as b; "
        "assert b._kernel.cache_info().currsize == 0; "
        "assert not any('compiled' in vars(b.__dict__[k + '_batch']) for k in ('unary', 'binary', 'ternary'))"
    )
    subprocess.run([sys.executable, "-c", code], check=True)

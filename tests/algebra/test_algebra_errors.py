"""Every public function refuses wrong shapes, types, NaN and values outside its domain, by name."""

import numpy as np
import pytest
from algebra_samples import rotation_about

from dqcontrol import algebra
from dqcontrol.errors import NoteWarning, ShapeError, ValueRangeError

X = algebra.pose(rotation_about([1.0, 2, 3], 0.7), [0.1, 0.2, 0.3])
PURE = algebra.unvec([1.0, 2, 3, 4, 5, 6])
POSE, QUATERNION, TWIST, VECTOR, NUMBER = (8,), (4,), (6,), (3,), None

ARGUMENTS = {  # function: {argument: (a good value, its trailing shape)}
    "adjoint": {"x": (X, POSE), "y": (X, POSE)},
    "adjoint_matrix": {"x": (X, POSE)},
    "adjoint_twist": {"x": (X, POSE), "twist": (np.ones(6), TWIST)},
    "as_unit": {"value": (X, POSE)},
    "as_unit_quaternion": {"value": (X[:4], QUATERNION)},
    "axis_angle_from_rotation": {"rotation": (X[:4], QUATERNION)},
    "body_translation": {"x": (X, POSE)},
    "conjugate": {"x": (X, POSE)},
    "cross": {"a": (PURE, POSE), "b": (PURE, POSE)},
    "cross_twist": {"a": (np.ones(6), TWIST), "b": (np.ones(6), TWIST)},
    "dot": {"a": (PURE, POSE), "b": (PURE, POSE)},
    "dqrobotics_from_pose": {"x": (X, POSE)},
    "exp_body": {"g": (np.ones(6), TWIST)},
    "exp_inertial": {"g": (np.ones(6), TWIST)},
    "exp_screw": {"g": (np.ones(6), TWIST)},
    "hamilton_minus": {"y": (X, POSE)},
    "hamilton_plus": {"x": (X, POSE)},
    "inverse": {"x": (X, POSE)},
    "log_body": {"x": (X, POSE)},
    "log_inertial": {"x": (X, POSE)},
    "log_screw": {"x": (X, POSE)},
    "matrix_from_pose": {"x": (X, POSE)},
    "matrix_from_rotation": {"rotation": (X[:4], QUATERNION)},
    "mujoco_from_pose": {"x": (X, POSE)},
    "multiply": {"a": (X, POSE), "b": (X, POSE)},
    "norm": {"x": (X, POSE)},
    "pose": {"rotation": (X[:4], QUATERNION), "translation": (np.ones(3), VECTOR)},
    "pose_from_matrix": {"matrix": (np.eye(4), (4, 4))},
    "pose_from_mujoco": {"position": (np.ones(3), VECTOR), "quaternion": (X[:4], QUATERNION)},
    "power": {"x": (X, POSE), "t": (0.5, NUMBER)},
    "renormalise": {"x": (X, POSE)},
    "rotation": {"x": (X, POSE)},
    "rotation_from_axis_angle": {"axis": (np.ones(3), VECTOR), "angle": (0.5, NUMBER)},
    "rotation_from_matrix": {"matrix": (np.eye(3), (3, 3))},
    "rotation_from_rpy": {"angles": (np.ones(3), VECTOR)},
    "rotation_from_zyz": {"angles": (np.ones(3), VECTOR)},
    "rpy_from_rotation": {"rotation": (X[:4], QUATERNION)},
    "scipy_from_rotation": {"rotation": (X[:4], QUATERNION)},
    "sclerp": {"x1": (X, POSE), "x2": (X, POSE), "t": (0.5, NUMBER)},
    "se3_from_pose": {"x": (X, POSE)},
    "short": {"x": (X, POSE)},
    "translation": {"x": (X, POSE)},
    "unvec": {"v": (np.ones(6), (6,))},
    "vec3": {"x": (algebra.unvec([1.0, 2, 3]), POSE)},
    "vec4": {"x": (algebra.unvec(X[:4]), POSE)},
    "vec6": {"x": (PURE, POSE)},
    "vec8": {"x": (X, POSE)},
    "zyz_from_rotation": {"rotation": (X[:4], QUATERNION)},
}
LIBRARIES = {
    "dqrobotics_from_pose": "dqrobotics",
    "scipy_from_rotation": "scipy",
    "se3_from_pose": "pinocchio",
}
OBJECTS = {"pose_from_se3", "pose_from_dqrobotics", "rotation_from_scipy"}  # tested with their libraries
CASES = [(function, argument) for function, arguments in ARGUMENTS.items() for argument in arguments]
UNIT = {
    "adjoint_matrix": "x",
    "adjoint_twist": "x",
    "as_unit": "value",
    "body_translation": "x",
    "dqrobotics_from_pose": "x",
    "log_body": "x",
    "log_inertial": "x",
    "log_screw": "x",
    "matrix_from_pose": "x",
    "mujoco_from_pose": "x",
    "power": "x",
    "rotation": "x",
    "sclerp": "x2",
    "se3_from_pose": "x",
    "translation": "x",
}


def call(function, argument=None, value=None):
    arguments = {name: good for name, (good, _) in ARGUMENTS[function].items()}
    if argument:
        arguments[argument] = value
    if function.startswith("as_unit"):
        arguments["field"] = "value"
    return getattr(algebra, function)(**arguments)


def test_the_table_is_complete():
    functions = {name for name in algebra.__all__ if callable(getattr(algebra, name))} - {
        "DualQuaternion",
        "apply",
    }
    assert functions == set(ARGUMENTS) | OBJECTS


@pytest.mark.parametrize("function", ARGUMENTS)
def test_the_good_values_pass(function):
    if function in LIBRARIES:
        pytest.importorskip(LIBRARIES[function], reason="the function makes an object of this library")
    assert call(function) is not None


@pytest.mark.parametrize(("function", "argument"), [case for case in CASES if ARGUMENTS[case[0]][case[1]][1]])
def test_wrong_shapes(function, argument):
    for wrong in (np.ones(5), np.ones((8, 5)), 1.0, []):
        with pytest.raises(ShapeError, match=rf"^{argument}: expected shape \(…, \d.*got shape \("):
            call(function, argument, wrong)


@pytest.mark.parametrize(("function", "argument"), CASES)
@pytest.mark.parametrize("wrong", ["text", None, 1j, [[1.0], [1.0, 2.0]], True, {}])
def test_wrong_types(function, argument, wrong):
    with pytest.raises(ShapeError, match=f"^{argument}: expected real numbers, got "):
        call(function, argument, wrong)


@pytest.mark.parametrize(("function", "argument"), CASES)
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_not_finite(function, argument, bad):
    value = np.array(ARGUMENTS[function][argument][0], dtype=float)
    value.flat[-1] = bad
    with pytest.raises(ValueRangeError, match=f"^{argument}: must be finite, got "):
        call(function, argument, value)


@pytest.mark.parametrize(("function", "argument"), UNIT.items())
def test_not_unit(function, argument):
    with pytest.raises(
        ValueRangeError, match=rf"^{argument}: expected a unit dual quaternion \(norm 1\), got norm 2 \+ "
    ):
        call(function, argument, 2 * X)
    stretched = X + 0.01 * np.eye(8)[4]
    with pytest.raises(
        ValueRangeError, match=rf"^{argument}: .* got norm 1 \+ ε 0\.00\d+ at index \(0, 1\)$"
    ):
        call(function, argument, np.array([[X, stretched]]))
    with pytest.raises(ValueRangeError, match=rf"^{argument}: .* got norm 0 \+ ε 0$"):
        call(function, argument, np.zeros(8))


@pytest.mark.parametrize(
    ("function", "argument"), [case for case in CASES if ARGUMENTS[case[0]][case[1]][1] == QUATERNION]
)
def test_not_a_unit_quaternion(function, argument):
    with pytest.raises(
        ValueRangeError, match=rf"^{argument}: must have norm 1 within 0\.001, got 0\.5 at index \(1,\)$"
    ):
        call(function, argument, np.array([X[:4], 0.5 * X[:4]]))


@pytest.mark.parametrize(
    ("use", "match"),
    [
        (lambda: algebra.inverse(np.eye(8)[5]), "^x: primary part is zero .* no inverse"),
        (lambda: algebra.inverse([X, np.eye(8)[4]]), r"^x: primary part is zero .* at index \(1,\)"),
        (
            lambda: algebra.renormalise(np.zeros(8)),
            "^x: primary part is zero .* no unit dual quaternion near",
        ),
        (lambda: algebra.log_screw([-1.0, 0, 0, 0, 0, 0, 0, 0]), "^x: rotation −1 .* no logarithm"),
        (lambda: algebra.log_body([X, [-1.0, 0, 0, 0, 0, 0, 0, 0]]), r"^x: rotation −1 .* at index \(1,\)"),
        (lambda: algebra.log_inertial([-1.0, 0, 0, 0, 0, 0.5, 0, 0]), "^x: rotation −1"),
        (lambda: algebra.power([-1.0, 0, 0, 0, 0, 0, 0, 0], 0.5), "^x: rotation −1 .* use short"),
        (lambda: algebra.vec3(X), r"^x: expected a pure quaternion .* got a remainder of 0\.9"),
        (lambda: algebra.vec4(X), r"^x: expected a quaternion \(dual part 0\)"),
        (lambda: algebra.vec6(X), "^x: expected a pure dual quaternion"),
        (lambda: algebra.cross(X, PURE), "^a: expected a pure dual quaternion"),
        (lambda: algebra.dot(PURE, X), "^b: expected a pure dual quaternion"),
        (
            lambda: algebra.rotation_from_axis_angle([[1, 0, 0], [0, 0, 0]], 1),
            r"^axis: must not be zero at index \(1,\)",
        ),
        (
            lambda: algebra.rotation_from_matrix(2 * np.eye(3)),
            r"^matrix: expected a rotation, but RᵀR differs .* by 3",
        ),
        (lambda: algebra.rotation_from_matrix([np.eye(3), np.ones((3, 3))]), r"^matrix: .* at index \(1,\)"),
        (lambda: algebra.rotation_from_matrix(np.diag([1, 1, -1])), "^matrix: .* a reflection"),
        (
            lambda: algebra.pose_from_matrix(np.diag([1, 1, 1, 2])),
            r"^matrix: the last row must be \[0, 0, 0, 1\], got",
        ),
        (lambda: algebra.pose_from_matrix(np.diag([1, -1, 1, 1])), "^matrix: .* a reflection"),
    ],
)
def test_outside_the_domain(use, match):
    with pytest.raises(ValueRangeError, match=match):
        use()


@pytest.mark.parametrize("function", [name for name, arguments in ARGUMENTS.items() if len(arguments) > 1])
def test_batches_that_do_not_broadcast(function):
    goods = [good for good, _ in ARGUMENTS[function].values()]
    batches = [np.stack([good] * n) for n, good in enumerate(goods, start=2)]
    shapes = ", ".join(rf"\({n},\)" for n in range(2, 2 + len(goods)))
    with pytest.raises(
        ShapeError, match=rf"^{', '.join(ARGUMENTS[function])}: batches of shapes {shapes} do not"
    ):
        getattr(algebra, function)(*batches)


def test_quaternions_written_with_four_or_five_digits_are_normalised():
    """As in YAML: 0.70711 squared twice is 1.00001, and 0.7071 gives 0.99999."""
    for value in (0.70711, 0.7071):
        with pytest.warns(NoteWarning, match=r"rotation: normalised; its norm was (1\.0000|0\.9999)"):
            found = algebra.pose([value, 0, value, 0], [1, 2, 3])
        assert np.linalg.norm(found[:4]) == pytest.approx(1, abs=1e-15)
        assert np.abs(algebra.translation(found) - [1, 2, 3]).max() < 1e-15
    with pytest.raises(
        ValueRangeError, match=r"^rotation: must have norm 1 within 0\.001, got 1\.00119; normali"
    ):
        algebra.pose([1.00119, 0, 0, 0], [1, 2, 3])
    with pytest.raises(ValueRangeError, match=r"got norm 1\.00000\d+ \+ ε 0"):
        algebra.log_body([1.000004, 0, 0, 0, 0, 0, 0, 0])

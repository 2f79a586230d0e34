"""Our robot files: what they mean, and the message when they are wrong."""
# pyright: reportAttributeAccessIssue=false, reportOptionalMemberAccess=false
# (Pinocchio's compiled names are invisible to pyright)

import numpy as np
import pinocchio as pin
import pytest
from pinocchio_oracle import pose_matrix

from dqcontrol.errors import FileFormatError
from dqcontrol.robots import SerialArm, load_robot_file

DH = """
name: toy
angles: degrees
convention: standard
joints:
  - name: a
    dh: {theta: 10, d: 0.1, a: 0.2, alpha: 90}
    limits: {lower: -90, upper: 45, velocity: 180, effort: 5}
  - {name: b, type: prismatic, dh: {theta: 20, a: 0.3}, limits: {lower: 0, upper: 0.5, velocity: 0.1}}
"""
DENSO = """
name: toy
angles: degrees
convention: denso
base: {position: [0, 0, 1]}
joints:
  - {name: a, denso: {a: 0.1, b: 0.2, d: 0.3, alpha: 10, beta: 20, gamma: 30}}
  - {name: b, type: prismatic, denso: {d: 0.4, beta: -90}}
"""
FREE = """
name: toy
angles: radians
base: {position: [0, 0, 1], quaternion: [0, 1, 0, 0]}
tool: {position: [0.1, 0, 0]}
joints:
  - name: a
    pose: {position: [0, 0, 0.5], rpy: [0.1, 0.2, 0.3]}
    axis: [1, 2, 2]
    inertia: {mass: 2, center: [0.1, 0, 0], tensor: {xx: 1e-2, yy: 2e-2, zz: 2e-2, xy: 1e-3}}
  - name: b
    pose: {}
    type: prismatic
    axis: [0, 0, -1]
    inertia: {mass: 1, center: [0, 0, 0.1], tensor: {xx: 1, yy: 1, zz: 1}}
"""


@pytest.fixture
def load(tmp_path):
    def write_and_load(text):
        path = tmp_path / "toy.yaml"
        path.write_text(text, encoding="utf-8")
        return load_robot_file(path)

    return write_and_load


def test_denso_rows_in_degrees(load):
    alpha, beta, gamma = np.deg2rad([[10, 0], [20, -90], [30, 0]])
    types = ["revolute", "prismatic"]
    same = SerialArm.from_denso([0.1, 0], [0.2, 0], [0.3, 0.4], alpha, beta, gamma, types)
    lifted = pose_matrix(same.fkm([0.5, 0.6])) + np.outer([0, 0, 1, 0], [0, 0, 0, 1])
    np.testing.assert_allclose(pose_matrix(load(DENSO).fkm([0.5, 0.6])), lifted, atol=1e-15)


def test_dh_rows_in_degrees(load):
    arm = load(DH)
    right = np.pi / 2
    same = SerialArm.from_dh(
        np.deg2rad([10, 20]), [0.1, 0], [0.2, 0.3], [right, 0], ["revolute", "prismatic"]
    )
    np.testing.assert_allclose(arm.fkm([0.3, 0.4]), same.fkm([0.3, 0.4]), atol=1e-15)
    np.testing.assert_allclose(arm.limits.lower, [-right, 0])
    np.testing.assert_allclose(arm.limits.upper, [right / 2, 0.5])  # metres are not degrees
    np.testing.assert_allclose(arm.limits.velocity, [np.pi, 0.1])
    np.testing.assert_allclose(arm.limits.effort, [5, np.inf])
    assert (arm.name, arm.joint_names, arm.joint_types) == ("toy", ("a", "b"), ("revolute", "prismatic"))
    assert arm.inertia is None


def test_radians(load):
    arm = load(DH.replace("degrees", "radians"))
    np.testing.assert_allclose(arm.limits.lower, [-90, 0])
    same = SerialArm.from_dh([10, 20], [0.1, 0], [0.2, 0.3], [90, 0], ["revolute", "prismatic"])
    np.testing.assert_allclose(arm.fkm([0.3, 0.4]), same.fkm([0.3, 0.4]), atol=1e-15)


def test_fixed_poses_and_axes(load):
    arm = load(FREE)
    q = [0.7, 0.2]
    base = pin.SE3(np.diag([1.0, -1, -1]), np.array([0, 0, 1.0]))
    first = pin.SE3(pin.rpy.rpyToMatrix(0.1, 0.2, 0.3), np.array([0, 0, 0.5]))
    turn = pin.SE3(pin.exp3(np.array([1, 2, 2]) / 3 * q[0]), np.zeros(3))
    slide = pin.SE3(np.eye(3), np.array([0.1, 0, -q[1]]))
    expected = base * first * turn * slide
    np.testing.assert_allclose(pose_matrix(arm.fkm(q)), expected.homogeneous, atol=1e-14)


def test_inertia_is_turned_with_the_axis(load):
    arm = load(FREE)
    base, q = pin.SE3(np.diag([1.0, -1, -1]), np.array([0, 0, 1.0])), [0.7, 0.2]
    frame = base * pin.SE3(pin.rpy.rpyToMatrix(0.1, 0.2, 0.3), np.array([0, 0, 0.5]))
    frame = frame * pin.SE3(pin.exp3(np.array([1, 2, 2]) / 3 * q[0]), np.zeros(3))
    own = pose_matrix(arm.frames(q)[0])
    np.testing.assert_allclose(
        own[:3, :3] @ arm.inertia.center[0] + own[:3, 3], frame.act(np.array([0.1, 0, 0]))
    )
    tensor = np.array([[1e-2, 1e-3, 0], [1e-3, 2e-2, 0], [0, 0, 2e-2]])
    np.testing.assert_allclose(
        own[:3, :3] @ arm.inertia.tensor[0] @ own[:3, :3].T,
        frame.rotation @ tensor @ frame.rotation.T,
        atol=1e-15,
    )


CHANGES = [  # text, what it becomes, message
    (
        "theta: 10",
        "tetha: 10",
        r"joints\[0\].dh: unknown key 'tetha'; did you mean 'theta'\? \(allowed: theta, d, a, alpha\)",
    ),
    ("name: toy", "name: toy\nlimit: 3", r"toy.yaml: unknown key 'limit' \(allowed: name, angles, joints"),
    ("name: toy\n", "", r"toy.yaml: missing key 'name'"),
    ("- name: a\n   ", "-", r"joints\[0\]: missing key 'name'"),
    ("angles: degrees\n", "", r"toy.yaml: missing key 'angles'"),
    ("degrees", "grad", r"angles: unknown name 'grad'"),
    ("standard", "craig", r"convention: unknown name 'craig'"),
    ("prismatic", "linear", r"joints\[1\].type: unknown name 'linear'"),
    ("d: 0.1", "d: .nan", r"joints\[0\].dh.d: must be finite, got nan"),
    ("d: 0.1", "d: .inf", r"joints\[0\].dh.d: must be finite, got inf"),
    ("d: 0.1", "d: 1e4", r"joints\[0\].dh.d: expected a number <= 1000.0, got 10000.0"),
    ("d: 0.1", "d: ten", r"joints\[0\].dh.d: expected a number, got text"),
    ("d: 0.1", "d: true", r"joints\[0\].dh.d: expected a number, got true"),
    ("lower: -90", "lower: 90", r"joints\[0\].limits: lower 90 ≥ upper 45; lower must be below upper"),
    ("velocity: 180", "velocity: 0", r"joints\[0\].limits.velocity: expected a number > 0.0, got 0"),
    ("name: b", "name: a", r"joints\[1\].name: 'a' is already the name of joints\[0\]"),
    ("name: b", "name: ''", r"joints\[1\].name: expected text of length >= 1"),
    ("name: toy", "name: toy\nname: tay", r"toy.yaml:3: key 'name' appears twice"),
    ("theta: 20", "theta: 20, theta: 30", r"toy.yaml:9: key 'theta' appears twice"),
    ("convention: standard\n", "", r"convention: missing key, the joints have DH rows"),
    (
        "dh: {theta: 20, a: 0.3}",
        "pose: {}",
        r"joints\[1\]: missing key 'dh', the file's convention is standard DH",
    ),
    ("dh: {theta: 20", "axis: [0, 0, 1], dh: {theta: 20", r"joints\[1\].axis: not allowed beside 'dh'"),
    ("  - {name: b", "  {name: b", r"toy.yaml:10: could not find expected ':'"),
    ("name: toy", "name: &x toy\ndescription: *x", r"toy.yaml:3: aliases are not read here"),
    ("name: toy", "name: !!python/name:os.system", r"toy.yaml:2: could not determine a constructor"),
    ("name: toy", "name: \x07", r"toy.yaml: unacceptable character"),
]


@pytest.mark.parametrize(("old", "new", "text"), CHANGES)
def test_wrong_dh_files(load, old, new, text):
    assert old in DH
    with pytest.raises(FileFormatError, match=text):
        load(DH.replace(old, new, 1))


DENSO_CHANGES = [
    ("convention: denso", "", r"convention: missing key, the joints have DENSO rows \(allowed: denso\)"),
    (
        "convention: denso",
        "convention: standard",
        r"joints\[0\]: missing key 'dh', the file's convention is standard DH",
    ),
    (
        "denso: {d: 0.4, beta: -90}",
        "dh: {}",
        r"joints\[1\]: missing key 'denso', the file's convention is denso",
    ),
    ("name: b,", "name: b, dh: {},", r"joints\[1\].dh: not allowed beside 'denso'"),
    ("gamma: 30", "theta: 30", r"joints\[0\].denso: unknown key 'theta'"),
]


@pytest.mark.parametrize(("old", "new", "text"), DENSO_CHANGES)
def test_wrong_denso_files(load, old, new, text):
    assert old in DENSO
    with pytest.raises(FileFormatError, match=text):
        load(DENSO.replace(old, new, 1))


FREE_CHANGES = [
    ("pose: {}", "", r"joints\[1\]: missing key 'pose' \(or 'dh', with a 'convention'\)"),
    ("axis: [1, 2, 2]", "axis: [0, 0, 0]", r"toy.yaml: axis: must not be zero"),
    ("axis: [1, 2, 2]", "axis: [1, 2]", r"joints\[0\].axis: expected a list of length 3, got 2"),
    (
        "quaternion: [0, 1, 0, 0]",
        "quaternion: [1, 1, 0, 0]",
        r"base.quaternion: must have norm 1 within 0.001, got 1.41",
    ),
    ("quaternion:", "rpy: [0, 0, 0], quaternion:", r"base: has both 'rpy' and 'quaternion'"),
    ("mass: 2", "mass: -2", r"joints\[0\].inertia.mass: expected a number >= 0.0, got -2"),
    ("xx: 1e-2", "xx: -1e-2", r"joints\[0\].inertia.tensor: must not be negative in any direction"),
    ("    inertia: {mass: 1", "    # {mass: 1", r"joints\[1\]: missing key 'inertia', other joints have it"),
]


@pytest.mark.parametrize(("old", "new", "text"), FREE_CHANGES)
def test_wrong_pose_files(load, old, new, text):
    assert old in FREE
    with pytest.raises(FileFormatError, match=text):
        load(FREE.replace(old, new, 1))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "expected a mapping, got nothing"),
        ("- 1", "expected a mapping, got a list"),
        ("name: x\nangles: degrees\njoints: []", r"joints: expected a list of length >= 1, got \[\]"),
        ("[" * 5000, "nested too deeply"),
        ("a: b: c", "toy.yaml:1: mapping values are not allowed here"),
    ],
)
def test_files_of_another_kind(load, text, message):
    with pytest.raises(FileFormatError, match=message):
        load(text)


def test_unreadable_files(tmp_path):
    with pytest.raises(FileFormatError, match=r"none.yaml: no such file"):
        load_robot_file(tmp_path / "none.yaml")
    path = tmp_path / "toy.yaml"
    path.write_bytes(b"name: \xff\xfe")
    with pytest.raises(FileFormatError, match=r"toy.yaml: not a text file"):
        load_robot_file(path)

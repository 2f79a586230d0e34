"""Files of whole bodies, and the whole bodies that come with dqcontrol."""

import shutil

import numpy as np
import pytest

from dqcontrol import DualQuaternion
from dqcontrol.errors import Error, FileFormatError
from dqcontrol.robots import DifferentialDrive, HolonomicBase, WholeBody, describe, load_robot
from dqcontrol.robots.files import load

BODY = """
name: toy
angles: degrees
parts:
  - {kind: differential-drive, wheel_radius: 0.05, half_track: 0.2, displacement: 0.3, rim_speed: 0.6}
  - {kind: pose, position: [0.1, 0, 0.2], rpy: [0, 0, 90]}
  - {kind: arm, robot: ax18, reversed: true}
  - {kind: holonomic-base, speed: 0.5, turn_rate: 90}
  - {kind: arm, robot: mine.yaml}
"""


@pytest.fixture
def file(tmp_path):
    """Write a file, beside an arm's."""
    shutil.copy(load.MODELS / "ur5.yaml", tmp_path / "mine.yaml")

    def write(text, name="toy.yaml"):
        path = tmp_path / name
        path.write_text(text, encoding="utf-8")
        return path

    return write


def test_a_file_is_the_list_of_its_parts(file):
    body = load_robot(file(BODY))
    quarter = DualQuaternion.from_rpy([0, 0, np.pi / 2], [0.1, 0, 0.2])
    parts = [
        DifferentialDrive(0.05, 0.2, 0.3, 0.6),
        quarter,
        load_robot("ax18").reversed(),
        HolonomicBase(0.5, np.pi / 2),
        load_robot("ur5"),
    ]
    same = WholeBody(parts)
    assert isinstance(body, WholeBody)
    assert (body.name, body.form) == ("toy", "constrained")
    assert body.input_names == same.input_names
    np.testing.assert_allclose(body.drives, same.drives)
    np.testing.assert_allclose(body.limits.velocity, same.limits.velocity)
    q = np.linspace(-1, 1, same.configuration_size)
    np.testing.assert_allclose(body.pose_jacobian(q), same.pose_jacobian(q), rtol=0, atol=1e-15)
    free = load_robot(file(BODY + "form: unconstrained\n"))
    assert free.input_size == free.configuration_size == 17


def test_example_robot_data_as_a_part(file):
    body = load_robot(
        file(
            """
name: toy
angles: radians
parts:
  - {kind: holonomic-base}
  - kind: arm
    robot: example-robot-data:panda_description/urdf/panda.urdf
    tip_link: panda_hand
"""
        )
    )
    assert body.joint_names[3:] == tuple(f"panda_joint{i}" for i in range(1, 8))


CHANGES = [  # text, what it becomes, message
    ("wheel_radius: 0.05", "wheel_radius: 0", r"parts\[0\].wheel_radius: expected a number > 0.0, got 0"),
    ("half_track: 0.2, ", "", r"parts\[0\]: missing key 'half_track'"),
    ("displacement: 0.3", "displacement: 0", r"toy.yaml: parts\[0\]: displacement: must not be 0"),
    ("rim_speed", "rimspeed", r"parts\[0\]: unknown key 'rimspeed'; did you mean 'rim_speed'"),
    ("kind: pose", "kind: frame", r"parts\[1\].kind: unknown name 'frame'"),
    ("kind: holonomic-base", "kind: holonomic", r"unknown name 'holonomic'; did you mean 'holonomic-base'"),
    ("rpy: [0, 0, 90]", "quaternion: [1, 1, 0, 0]", r"toy.yaml: parts\[1\].quaternion: must have norm 1"),
    (
        "kind: holonomic-base",
        "kind: holonomic-base, size: [1, 0, 1]",
        r"size\[1\]: expected a number > 0.0, got 0",
    ),
    ("robot: ax18", "robot: ax19", r"toy.yaml: parts\[2\]: robot: unknown name 'ax19'; did you mean 'ax18'"),
    ("robot: mine.yaml", "robot: none.yaml", r"none.yaml: no such file"),
    ("robot: mine.yaml", "robot: toy.yaml", r"parts\[4\]: robot: .*toy.yaml' is a whole body, not an arm"),
    ("robot: ax18", "robot: youbot", r"parts\[2\]: robot: 'youbot' is a whole body, not an arm"),
    (
        "robot: ax18",
        "robot: ax18, tip_link: hand",
        r"parts\[2\]: tip_link: only URDF and MJCF files have links",
    ),
    ("angles: degrees", "angles: degrees\nform: holonomic", r"form: unknown name 'holonomic'"),
    ("angles: degrees", "angles: degrees\njoints: []", r"unknown key 'joints'"),
    (BODY[BODY.index("  - ") :], "  []\n", r"parts: expected a list of length >= 1"),
    (
        BODY[BODY.index("  - ") :],
        "  - {kind: pose}\n",
        r"parts: expected at least one base or arm, got 1 parts",
    ),
]


@pytest.mark.parametrize(("old", "new", "message"), CHANGES)
def test_bad_files(file, old, new, message):
    assert old in BODY
    with pytest.raises(FileFormatError, match=message):
        load_robot(file(BODY.replace(old, new, 1)))


def test_links_of_a_whole_body():
    with pytest.raises(Error, match="tip_link: only URDF and MJCF files have links to choose from"):
        load_robot("little-john", tip_link="hand")


def test_little_john():
    body = load_robot("little-john")
    assert body.input_names == ("v", "omega", *(f"joint_{i}" for i in range(1, 6)))
    np.testing.assert_allclose(body.limits.velocity, [0.5, 0.5 / 0.13, 2, 2, 2, 2, 2])
    np.testing.assert_array_equal(body.limits.upper[:3], np.inf)
    # the wheels' rims at their limit: straight on, and turning on the spot
    for u in ([0.5, 0], [0, 0.5 / 0.13]):
        wheels = body.wheel_speeds([*u, 0, 0, 0, 0, 0])[:2]
        np.testing.assert_allclose(np.abs(wheels) * 0.065, 0.5)
    # arm stretched forward: the tool of ax18, and 0.17 m of the base's height
    hand = DualQuaternion(body.fkm(np.zeros(8)))
    np.testing.assert_allclose(hand.translation, [0.4515, 0, 0.35925], atol=1e-12)
    wrist = DualQuaternion(load_robot("little-john-wrist").fkm(np.zeros(8)))
    np.testing.assert_allclose(wrist.translation, [0.2815, 0, 0.35925], atol=1e-12)


def test_youbot_stands_upright_at_zero_and_bends_back():
    body = load_robot("youbot")
    np.testing.assert_allclose(body.limits.velocity[:3], [0.8, 0.8, np.pi / 2])
    up = DualQuaternion(body.fkm(np.zeros(8))).translation
    np.testing.assert_allclose(up, [0.22575, 0, 0.1441 + 0.147 + 0.155 + 0.135 + 0.218], atol=1e-12)
    arm = load_robot("youbot-arm")
    assert DualQuaternion(arm.fkm([0, 0.3, 0, 0, 0])).translation[0] < 0
    assert arm.limits.upper[1] < -arm.limits.lower[1]  # less far back than forward


def test_describe():
    about = describe(load_robot("little-john"))
    assert (about.name, about.bases, len(about.joints)) == ("little-john", "differential drive", 8)
    assert about.reach == pytest.approx(describe(load_robot("ax18")).reach)
    x, y, phi, joint = about.joints[:4]
    assert (x.input, x.velocity, x.upper) == ("v", 0.5, np.inf)
    assert (y.input, y.velocity, y.effort) == ("", None, None)
    assert (phi.input, phi.type) == ("omega", "revolute")
    assert phi.velocity == pytest.approx(np.rad2deg(0.5 / 0.13))
    assert (joint.input, joint.effort) == ("joint_1", 1.77)
    two = WholeBody([HolonomicBase(), load_robot("ax18"), DifferentialDrive(0.1, 0.1)])
    assert (describe(two).bases, describe(two).reach) == ("holonomic + differential drive", 0)

"""What URDF files may say, and the message when they say something else."""
# pyright: reportAttributeAccessIssue=false, reportOptionalMemberAccess=false
# (Pinocchio's compiled names are invisible to pyright)

import logging
import warnings

import numpy as np
import pinocchio as pin
import pytest
from pinocchio_oracle import pose_matrix

from dqcontrol.errors import FileFormatError, NoteWarning, UnknownNameError
from dqcontrol.robots import load_urdf


def joint(name, parent, child, kind="revolute", inner=""):
    limit = '<limit lower="-1" upper="2" velocity="3" effort="4"/>' if "<limit" not in inner else ""
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="0.1 0.2 0.3" rpy="0.1 0.2 0.3"/>{limit}{inner}</joint>\n'
    )


def robot(*parts, links="abcd"):
    body = "".join(f'<link name="{link}"/>\n' for link in links) + "".join(parts)
    return f'<robot name="toy">\n{body}</robot>'


CHAIN = (joint("ab", "a", "b"), joint("bc", "b", "c", "continuous"), joint("cd", "c", "d", "fixed"))


@pytest.fixture
def load(tmp_path):
    def write_and_load(content, **arguments):
        path = tmp_path / "toy.urdf"
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return load_urdf(path, **arguments)

    return write_and_load


def test_names_types_and_limits(load):
    slide = joint("cd", "c", "d", "prismatic", '<limit lower="0" upper="0.5" velocity="0"/>')
    arm = load(robot(*CHAIN[:2], slide))
    assert (arm.name, arm.joint_names) == ("toy", ("ab", "bc", "cd"))
    assert arm.joint_types == ("revolute", "revolute", "prismatic")
    np.testing.assert_array_equal(arm.limits.lower, [-1, -np.inf, 0])
    np.testing.assert_array_equal(arm.limits.upper, [2, np.inf, 0.5])
    np.testing.assert_array_equal(arm.limits.velocity, [3, 3, np.inf])
    np.testing.assert_array_equal(arm.limits.effort, [4, 4, np.inf])
    assert arm.inertia is None
    assert load(robot(*CHAIN), name="other").name == "other"


def test_part_of_a_chain(load):
    text = robot(*CHAIN)
    assert load(text, base_link="b").joint_names == ("bc",)
    assert load(text, tip_link="b").joint_names == ("ab",)


@pytest.mark.parametrize(
    "axis", [(0, 0, 1), (0, 0, -1), (1, 0, 0), (0, -2, 0), (1e-9, 0, -1), (0.3, -0.5, -0.7)]
)
def test_axes_of_any_direction(load, axis):
    words = " ".join(map(str, axis))
    arm = load(robot(joint("ab", "a", "b", "prismatic", f'<axis xyz="{words}"/>'), links="ab"))
    link = pose_matrix(arm.fkm([0.0]))[:3, :3]
    np.testing.assert_allclose(
        arm.translation_jacobian([0.0])[:, 0], link @ axis / np.linalg.norm(axis), atol=1e-12
    )
    np.testing.assert_allclose(link, pin.rpy.rpyToMatrix(0.1, 0.2, 0.3), atol=1e-12)


def test_default_tip_must_be_unique(load):
    two = robot(joint("ab", "a", "b"), joint("ac", "a", "c"), joint("cd", "c", "d", "fixed"))
    with pytest.raises(
        UnknownNameError, match=r"tip_link: must be given .* 2 links end a chain of 1 joints: b, d"
    ):
        load(two)
    assert load(two, tip_link="d").joint_names == ("ac",)
    longer = robot(joint("ab", "a", "b"), joint("bc", "b", "c"), joint("ad", "a", "d"))
    assert load(longer).joint_names == ("ab", "bc")


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ({"tip_link": "dd"}, r"tip_link: unknown link 'dd'; did you mean 'd'\? \(links of .*: a, b, c, d\)"),
        ({"base_link": "world"}, "base_link: unknown link 'world'"),
        ({"base_link": ""}, "base_link: unknown link ''"),
        ({"base_link": "c", "tip_link": "b"}, r"tip_link: 'b' is not below base link 'c' .* on b < a"),
        ({"base_link": "c"}, "tip_link: no joint moves between 'c' and 'd'"),
        ({"tip_link": "a"}, "tip_link: no joint moves between 'a' and 'a'"),
    ],
)
def test_bad_links(load, arguments, text):
    with pytest.raises(UnknownNameError, match=text):
        load(robot(*CHAIN), **arguments)


BAD_ROBOTS = {
    r":6: joint 'ab': is floating; a serial arm has only": (joint("ab", "a", "b", "floating"), *CHAIN[1:]),
    r":6: joint 'ab': is planar": (joint("ab", "a", "b", "planar"), *CHAIN[1:]),
    r":7: joint 'bc': follows joint 'ab' \(mimic\)": (
        CHAIN[0],
        joint("bc", "b", "c", inner='<mimic joint="ab"/>'),
        CHAIN[2],
    ),
    r":6: joint 'ab': unknown type 'revolut'; did you mean 'revolute'\?": (joint("ab", "a", "b", "revolut"),),
    r":6: joint 'ab': limit: lower 2 ≥ upper 1": (
        joint("ab", "a", "b", inner='<limit lower="2" upper="1"/>'),
        *CHAIN[1:],
    ),
    r":6: joint 'ab': limit: lower 0 ≥ upper 0.*'continuous'": (
        joint("ab", "a", "b", inner='<limit effort="1"/>'),
        *CHAIN[1:],
    ),
    r":6: joint 'ab': limit: velocity and effort must be ≥ 0, got -1": (
        joint("ab", "a", "b", inner='<limit lower="0" upper="1" velocity="-1"/>'),
        *CHAIN[1:],
    ),
    r":6: joint 'ab': axis must not be zero": (
        joint("ab", "a", "b", inner='<axis xyz="0 0 0"/>'),
        *CHAIN[1:],
    ),
    r":6: joint 'ab': <axis> xyz: expected 3 finite numbers, got '0 0'": (
        joint("ab", "a", "b", inner='<axis xyz="0 0"/>'),
    ),
    r":6: joint 'ab': <axis> xyz: expected 3 finite numbers, got '0 nan 1'": (
        joint("ab", "a", "b", inner='<axis xyz="0 nan 1"/>'),
    ),
    r":6: joint 'ab': <limit> upper: expected a finite number, got '1,5'": (
        joint("ab", "a", "b", inner='<limit upper="1,5"/>'),
    ),
    r":6: joint 'ab': <limit> upper: expected a finite number, got 'nan'": (
        joint("ab", "a", "b", inner='<limit upper="nan"/>'),
    ),
    r":6: joint 'ax': unknown child link 'x'": (joint("ax", "a", "x"),),
    r":7: joint 'cb': link 'b' is already the child of 'ab'": (CHAIN[0], joint("cb", "c", "b")),
    r":7: joint 'ab' is already defined on line 6": (CHAIN[0], CHAIN[0]),
    r"not a tree: several links have no parent: a, d": CHAIN[:2],
    r"not a tree: every link has a parent": (*CHAIN, joint("da", "d", "a")),
    r":6: joint 'ab': missing <child link=…>": ('<joint name="ab" type="fixed"><parent link="a"/></joint>',),
    r":6: <parent> misses its attribute 'link'": ('<joint name="ab" type="fixed"><parent/></joint>',),
    r":6: <link> misses its attribute 'name'": ("<link/>",),
    r":6: link 'e': <inertia> misses its attribute 'iyz'": (
        '<link name="e"><inertial><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0"/></inertial></link>',
    ),
    r":6: link 'e': mass must be ≥ 0, got -1": (
        '<link name="e"><inertial><mass value="-1"/></inertial></link>',
    ),
}


@pytest.mark.parametrize("text", BAD_ROBOTS)
def test_bad_robots(load, text, caplog):
    with caplog.at_level(logging.DEBUG), pytest.raises(FileFormatError, match=text):
        load(robot(*BAD_ROBOTS[text]))
    assert not caplog.records


def test_a_gripper_that_nobody_asked_for_is_left_out(load):
    with_jaw = robot(*CHAIN, joint("jaw_joint", "d", "e"), links="abcde")
    with pytest.warns(NoteWarning, match=r"ends at d, without the joints of its gripper \(jaw_joint\)"):
        assert load(with_jaw).joint_names == ("ab", "bc")
    fingers = (joint("left_finger", "d", "e"), joint("right_finger", "d", "f"))
    with pytest.warns(NoteWarning, match=r"ends at d, .*\(left_finger, right_finger\)"):
        assert load(robot(*CHAIN, *fingers, links="abcdef")).links[-1] == "d"
    follows = '<mimic joint="left_finger"/>'  # what follows is no joint of the arm, whatever its name
    tied = robot(*CHAIN, fingers[0], joint("second", "e", "f", inner=follows), links="abcdef")
    with pytest.warns(NoteWarning, match=r"ends at d, .*\(left_finger, second\)"):
        assert load(tied).joint_names == ("ab", "bc")
    camera = robot(*CHAIN, *fingers, joint("mount", "c", "g", "fixed"), links="abcdefg")
    with pytest.warns(NoteWarning, match="ends at d,"):  # not at a frame beside the gripper
        assert load(camera).joint_names == ("ab", "bc")
    two_arms = (joint("ax", "a", "x"), joint("xy", "x", "y"), joint("yz", "y", "z", "fixed"))
    with pytest.raises(UnknownNameError, match=r"2 links end a chain of 2 joints: d, z \(--tip-link d;"):
        load(robot(*CHAIN, *fingers, *two_arms, links="abcdefxyz"))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert load(with_jaw, tip_link="e").joint_names == ("ab", "bc", "jaw_joint")  # asked for
        load(robot(joint("finger", "a", "b"), links="ab"))  # nothing but a finger


def test_a_loop_beside_the_tree(load):
    with pytest.raises(FileFormatError, match="not a tree: c, d form a loop"):
        load(robot(CHAIN[0], joint("cd", "c", "d"), joint("dc", "d", "c")))


GOOD = robot(*CHAIN)
ENTITY = '<!DOCTYPE robot [<!ENTITY a "aaaa">]>\n' + GOOD.replace('"toy"', '"&a;"')


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "utf-32"])
def test_document_types_are_refused(load, encoding):
    with pytest.raises(FileFormatError, match=r"toy.urdf:1: declares a document type or entities"):
        load(ENTITY.encode(encoding))


@pytest.mark.parametrize("declared", ["UTF-7", "cp037", "UTF-32"])
def test_exotic_encodings_are_refused(load, declared):
    with pytest.raises(FileFormatError, match="not well-formed XML"):
        load(f'<?xml version="1.0" encoding="{declared}"?>\n'.encode() + GOOD.encode(declared))


def test_utf16_is_read(load):
    assert load(GOOD.encode("utf-16")).joint_names == ("ab", "bc")


@pytest.mark.parametrize(
    ("content", "text"),
    [
        ("", r"toy.urdf:1: not well-formed XML: is empty"),
        ("  \n", "not well-formed XML: is empty"),
        ("<robot name='x'>\n<link name='a'>\n</robot>", r"toy.urdf:3: not well-formed XML: mismatched tag"),
        (GOOD[:-8], "not well-formed XML: no element found"),
        (b"\x00\xff\x13", "not well-formed XML"),
        ("<sdf version='1.6'/>", r":1: expected <robot>, got <sdf>"),
        ("<robot/>", r":1: <robot> misses its attribute 'name'"),
        ("<robot name='x'/>", "has no links; a file of macros is for others to include"),
        ("<robot name='x'><x:y/></robot>", "unbound prefix"),
        (
            '<robot name="x" xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:macro name="m"/></robot>',
            "has no links; a file of macros is for others to include",
        ),
    ],
)
def test_malformed_files(load, content, text):
    with pytest.raises(FileFormatError, match=text):
        load(content)


def test_missing_file(tmp_path):
    with pytest.raises(FileFormatError, match=r"none.urdf: no such file"):
        load_urdf(tmp_path / "none.urdf")
    with pytest.raises(FileFormatError, match="is a folder"):
        load_urdf(tmp_path)


def test_meshes_are_not_opened(load):
    mesh = '<link name="e"><visual><geometry><mesh filename="package://nowhere/a.stl"/></geometry></visual></link>'
    assert load(robot(*CHAIN, mesh, joint("de", "d", "e", "fixed"))).joint_names == ("ab", "bc")


def test_deep_nesting_is_refused(load):
    with pytest.raises(FileFormatError, match=":1: more than 50 elements inside each other"):
        load("<robot name='x'>" + "<link name='a'>" * 100_000)


def test_branches_and_fixed_links_are_lumped(load):
    def body(name, mass, x):
        return (
            f'<link name="{name}"><inertial><origin xyz="{x} 0 0"/><mass value="{mass}"/>'
            '<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>\n'
        )

    def at(name, parent, child, kind):
        text = joint(name, parent, child, kind, '<axis xyz="0 0 1"/>')
        return text.replace('xyz="0.1 0.2 0.3" rpy="0.1 0.2 0.3"', 'xyz="1 0 0"')

    text = robot(
        *(body(link, mass, 0.5) for link, mass in zip("abcde", (9, 1, 2, 3, 4), strict=True)),
        at("ab", "a", "b", "revolute"),
        at("bc", "b", "c", "fixed"),  # moves with b
        at("cd", "c", "d", "floating"),  # hangs on c, held at zero
        at("ce", "c", "e", "revolute"),  # the next joint
        links="",
    )
    inertia = load(text, tip_link="e").inertia
    np.testing.assert_allclose(inertia.mass, [1 + 2 + 3, 4])
    middle = (1 * 0.5 + 2 * 1.5 + 3 * 2.5) / 6
    np.testing.assert_allclose(inertia.center, [[middle, 0, 0], [0.5, 0, 0]], atol=1e-15)
    about = 0.3 + sum(m * (x - middle) ** 2 for m, x in ((1, 0.5), (2, 1.5), (3, 2.5)))
    np.testing.assert_allclose(inertia.tensor[0], np.diag([0.3, about, about]), atol=1e-15)

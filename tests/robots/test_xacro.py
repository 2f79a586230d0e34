"""Xacro files: expanded with packages that are found without ROS, or a line that says what is missing."""

import sys

import pytest

from dqcontrol.cli import main
from dqcontrol.errors import FileFormatError, MissingExtraError
from dqcontrol.robots import describe, load_robot
from dqcontrol.robots.files.urdf_xml import PACKAGES, missing_meshes, missing_note

NAMESPACE = 'xmlns:xacro="http://www.ros.org/wiki/xacro"'
ARM = f"""<robot name="arm" {NAMESPACE}>
  <xacro:include filename="$(find arm_description)/urdf/segment.xacro"/>
  <link name="base"/>
  <xacro:segment name="a" parent="base" length="0.3" axis="0 0 1"/>
  <xacro:segment name="b" parent="a" length="${{0.1 * 2}}" axis="0 1 0"/>
</robot>"""
SEGMENT = f"""<robot {NAMESPACE}><xacro:macro name="segment" params="name parent length axis">
  <link name="${{name}}"><visual><geometry>
    <mesh filename="package://arm_meshes/${{name}}.stl"/></geometry></visual></link>
  <joint name="j_${{name}}" type="revolute"><parent link="${{parent}}"/><child link="${{name}}"/>
    <origin xyz="0 0 ${{length}}"/><axis xyz="${{axis}}"/>
    <limit lower="-2" upper="2" velocity="1" effort="10"/></joint>
</xacro:macro></robot>"""


@pytest.fixture
def arm(tmp_path, monkeypatch):
    monkeypatch.delenv("ROS_PACKAGE_PATH", raising=False)
    folder = tmp_path / "src/arm_description/urdf"
    folder.mkdir(parents=True)
    (folder / "segment.xacro").write_text(SEGMENT)
    (folder / "arm.urdf.xacro").write_text(ARM)
    return folder / "arm.urdf.xacro"


def test_a_xacro_file_is_a_robot_like_any_other(arm):
    pytest.importorskip("xacro")
    about = describe(load_robot(arm))
    assert (about.name, about.ends) == ("arm", "base → b")
    assert [joint.name for joint in about.joints] == ["j_a", "j_b"]


def test_what_is_missing_is_named(arm):
    pytest.importorskip("xacro")
    for old, new, message in (
        ("arm_description", "other", "needs the package 'other', which is not found; put it beside"),
        ("segment.xacro", "none.xacro", "none.xacro"),
        ('length="0.3"', 'length="$(arg size)"', "argument size; arguments have no values here"),
        ("xacro:segment", "xacro:segmnt", "unknown macro name"),
        ("</robot>", "", "xacro cannot expand it"),
    ):
        arm.write_text(ARM.replace(old, new))
        with pytest.raises(FileFormatError, match=message):
            load_robot(arm)


@pytest.mark.parametrize("bomb", ["9**9**9", "len([1] * 10**11)", "len('a' * 10**12)"])
def test_an_expression_without_end_is_refused(arm, bomb, monkeypatch):
    pytest.importorskip("xacro")
    monkeypatch.setattr("dqcontrol.robots.files.urdf_xml._MOST_SECONDS", 1.0)
    arm.write_text(ARM.replace("0.1 * 2", bomb))
    with pytest.raises(FileFormatError, match=r"within 1 s|cannot expand it"):
        load_robot(arm)


def test_a_package_elsewhere_is_named_on_the_command_line(arm, tmp_path, monkeypatch, capsys):
    pytest.importorskip("xacro")
    monkeypatch.setenv(PACKAGES, "")
    alone = tmp_path / "alone/arm.urdf.xacro"
    alone.parent.mkdir()
    arm.rename(alone)
    (tmp_path / "src").rename(tmp_path / "far")
    package = tmp_path / "far/arm_description"
    (package / "package.xml").write_text("<package><name>arm_description</name></package>")
    package = package.rename(tmp_path / "far/checkout")  # another name than its package.xml says

    def show(*options):
        monkeypatch.setattr(sys, "argv", ["dqcontrol", "robots", "show", str(alone), *options])
        main()

    with pytest.raises(SystemExit):
        show()
    assert "needs the package 'arm_description', which is not found" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        show("--package", str(tmp_path / "nowhere"))
    assert "nowhere' is no folder; give that of a package" in capsys.readouterr().err
    show("--package", str(tmp_path), f"--package={package}")
    assert "base → b" in capsys.readouterr().out


def test_without_xacro_it_says_what_to_install(arm, monkeypatch):
    monkeypatch.setitem(sys.modules, "xacro", None)
    with pytest.raises(
        MissingExtraError, match=r"pip install 'dqcontrol\[xacro\]', or expand it .*: xacro arm"
    ):
        load_robot(arm)


def test_meshes_that_are_not_found_are_named_with_how_to_help(arm, tmp_path):
    urdf = tmp_path / "arm.urdf"
    mesh = '<link name="{0}"><visual><geometry><mesh filename="package://arm_meshes/{0}.stl"/></geometry></visual></link>'
    urdf.write_text(f'<robot name="x">{mesh.format("a")}</robot>')
    assert missing_note(urdf).startswith(
        "arm.urdf: a mesh is not found (package://arm_meshes/a.stl), so plain shapes are drawn: "
        "put the package 'arm_meshes' beside"
    )
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes/package.xml").write_text("<package><name>arm_meshes</name></package>")
    assert missing_meshes(urdf) == [
        "package://arm_meshes/a.stl"
    ]  # a folder of another name beside is not looked into
    (tmp_path / "meshes").rename(tmp_path / "arm_meshes")
    (tmp_path / "arm_meshes/a.stl").touch()
    assert missing_note(urdf) == ""

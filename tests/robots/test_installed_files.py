"""Robot files of installed packages, named by package and path, and Menagerie's models by name."""

import importlib.metadata
import sys

import mujoco
import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.cli import main
from dqcontrol.errors import FileFormatError, MissingExtraError, ShapeError, UnknownNameError
from dqcontrol.robots import load_robot
from dqcontrol.robots.files.load import installed_robot_files, package_files

ARM = """<mujoco model="lever"><compiler angle="radian"/><worldbody><body name="bar"><joint name="hinge"/>
<geom size="0.1" pos="0.3 0 0"/><site name="hand" pos="0.5 0 0"/>
<body name="jaw" pos="0.4 0 0"><joint name="gripper" type="slide" range="0 0.02"/><geom size="0.02"/></body></body>
</worldbody>{actuator}</mujoco>"""
MACRO = """<robot name="x" xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:macro name="m" params="n">
<link name="base"/><link name="tip"/><joint name="${n}" type="continuous"><parent link="base"/><child link="tip"/>
</joint></xacro:macro>%s</robot>"""


pytestmark = pytest.mark.filterwarnings("ignore::dqcontrol.errors.NoteWarning")  # on grippers left out


@pytest.fixture
def wheel(tmp_path, monkeypatch):
    """Put a package as an installer leaves it on the path."""
    site = tmp_path / "site"
    files = {
        "toys/models/lever/lever.xml": ARM.format(actuator=""),
        "toys/models/other/lever.xml": ARM.format(actuator=""),
        "toys/models/table.xml": "<mujoco><worldbody><geom size='1'/></worldbody></mujoco>",
        "toys/models/notes.xml": "<notes/>",
        "toys/models/macros.xacro": MACRO % "",
        "toys/models/arm.urdf": MACRO % '<xacro:m n="turn"/>',
        "toys-1.0.dist-info/METADATA": "Metadata-Version: 2.1\nName: toys\nVersion: 1.0\n",
    }
    for name, text in files.items():
        (site / name).parent.mkdir(parents=True, exist_ok=True)
        (site / name).write_text(text)
    (site / "toys-1.0.dist-info/RECORD").write_text("".join(f"{name},,\n" for name in files))
    monkeypatch.syspath_prepend(str(site))
    return site


@pytest.mark.slow
def test_a_package_brings_robots_by_their_places(wheel):
    assert list(package_files("toys")) == ["arm.urdf", "lever/lever.xml", "macros.xacro", "other/lever.xml"]
    assert ("toys:arm.urdf", wheel / "toys/models/arm.urdf") in installed_robot_files()
    arm = load_robot("toys:lever/lever.xml", tip_link="hand")  # a site
    assert arm.joint_names == ("hinge",)
    np.testing.assert_allclose(dqc.DualQuaternion(arm.fkm([np.pi / 2])).translation, [0, 0.5, 0], atol=1e-15)
    assert dqc.load_robot("toys:models/lever/lever.xml", tips="all").joint_names == ("hinge", "gripper")
    assert load_robot(arm.origin[0], *arm.origin[1:]).joint_names == ("hinge",)


@pytest.mark.slow
def test_each_file_that_a_wheel_here_brings_loads_or_is_refused_in_a_line(record_property):
    loaded, refused = 0, {}
    for source, _ in installed_robot_files():
        try:
            loaded += dqc.load_robot(source, tips="all").configuration_size > 0
        except dqc.Error as error:
            refused[source] = str(error)
    record_property("loaded", loaded)
    record_property("refused", refused)
    assert loaded > 0
    assert all(text and "\n" not in text for text in refused.values()), refused


@pytest.mark.usefixtures("wheel")
def test_an_unknown_name_is_looked_for_in_installed_files():
    with pytest.raises(UnknownNameError, match=r"; installed: toys:lever/lever.xml, toys:other"):
        load_robot("Lever")
    with pytest.raises(UnknownNameError) as found:
        load_robot("spider")
    assert "installed" not in str(found.value)


def test_a_urdf_file_of_xacro_is_expanded_whatever_its_name(wheel):
    pytest.importorskip("xacro")
    assert load_robot("toys:arm.urdf").joint_names == ("turn",)


@pytest.mark.parametrize(
    ("source", "error", "text"),
    [
        ("toys:lever.xml", UnknownNameError, "'lever.xml' may be each of lever/lever.xml, other/lever.xml"),
        ("toys:arms.urdf", UnknownNameError, "toys: unknown file 'arms.urdf'; did you mean 'arm.urdf'"),
        ("toys:", UnknownNameError, r"unknown file '' \(allowed: arm.urdf"),
        ("none-such:a.urdf", MissingExtraError, "none-such: is not installed.*pip install none-such"),
    ],
)
def test_what_is_not_there_is_said(wheel, source, error, text):
    with pytest.raises(error, match=text):
        load_robot(source)


def test_the_command_lists_them_or_says_why_not(wheel, capsys, monkeypatch):
    pytest.importorskip("xacro")
    toys = importlib.metadata.distribution("toys")
    monkeypatch.setattr(importlib.metadata, "distributions", lambda: [toys])
    monkeypatch.setenv("DQCONTROL_WIDE", "1")
    monkeypatch.setattr(sys, "argv", ["dqcontrol", "robots", "list", "--installed"])
    main()
    said = capsys.readouterr().out
    rows = {line.split("│")[1].strip(): line for line in said.splitlines() if "toys:" in line}
    assert "without the joints of its gripper (gripper)" in rows["toys:lever/lever.xml"]
    assert "no velocity limit of its joints" in rows["toys:arm.urdf"]
    assert "refused" in rows["toys:macros.xacro"]
    assert "has no links; a file of macros is for others to include" in rows["toys:macros.xacro"]
    assert "4 files: 3 arms, 0 trees, 1 refused" in said


def test_show_says_which_velocity_limits_are_missing(wheel, capsys, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["dqcontrol", "robots", "show", "toys:lever/lever.xml"])
    main()
    assert (
        "joints without velocity limit: 1; docs/own-robot.md says how to give one" in capsys.readouterr().out
    )


def test_models_of_menagerie(tmp_path, monkeypatch):
    pytest.importorskip("mujoco_menagerie")
    monkeypatch.delenv("MENAGERIE_ROOT", raising=False)
    monkeypatch.setenv("MENAGERIE_CACHE_DIR", str(tmp_path / "cache"))
    with pytest.raises(
        MissingExtraError, match="not on this computer yet; fetch it with: mujoco-menagerie prefetch"
    ):
        load_robot("menagerie:robotstudio_so101")
    with pytest.raises(
        UnknownNameError,
        match="menagerie: unknown name 'robotstudio_so_101'; did you mean 'robotstudio_so101'",
    ):
        load_robot("menagerie:robotstudio_so_101")
    monkeypatch.setenv("MENAGERIE_ROOT", str(tmp_path))
    with pytest.raises(FileFormatError, match="'robotstudio_so101' is not in MENAGERIE_ROOT="):
        load_robot("menagerie:robotstudio_so101")
    (tmp_path / "robotstudio_so101").mkdir()
    (tmp_path / "robotstudio_so101/so101.xml").write_text(ARM.format(actuator=""))
    assert load_robot("menagerie:robotstudio_so101").joint_names == ("hinge",)
    assert "menagerie:robotstudio_so101" in dict(installed_robot_files())


@pytest.mark.parametrize(
    ("actuator", "gear"), [("motor ctrlrange='-7 5'", 3.0), ("general gainprm='2' ctrlrange='0 6'", 1.0)]
)
def test_a_motor_gives_its_joint_the_largest_torque_that_mujoco_lets_it_have(tmp_path, actuator, gear):
    path = tmp_path / "lever.xml"
    path.write_text(ARM.format(actuator=f"<actuator><{actuator} joint='hinge' gear='{gear}'/></actuator>"))
    model = mujoco.MjModel.from_xml_path(str(path))
    data, found = mujoco.MjData(model), []
    for told in (-1e3, 1e3):
        data.ctrl[:] = told
        mujoco.mj_forward(model, data)
        found.append(abs(data.qfrc_actuator[0]))
    assert load_robot(path).limits.effort[0] == pytest.approx(max(found))


def test_what_servos_may_be_told_limits_their_joints(tmp_path):
    path = tmp_path / "lever.xml"
    servo = "<actuator><{} joint='hinge' gear='2' ctrlrange='-3 4'/></actuator>"
    path.write_text(ARM.format(actuator=servo.format("velocity kv='5'")))
    assert load_robot(path).limits.velocity[0] == 2.0
    path.write_text(ARM.format(actuator=servo.format("position kp='5'")))
    limits = load_robot(path).limits
    assert (limits.lower[0], limits.upper[0]) == (-1.5, 2.0)
    assert np.isinf(limits.velocity[0])
    assert np.isinf(limits.effort[0])


def test_what_stands_by_a_planar_joint_stays_where_the_file_has_it(tmp_path):
    text = """<robot name="cart"><link name="world"/><link name="base"/><link name="bar"/>
    <joint name="drives" type="KIND"><origin xyz="1 2 0" rpy="0 0 0.5"/><parent link="world"/>
    <child link="base"/></joint>
    <joint name="turn" type="continuous"><parent link="base"/><child link="bar"/></joint></robot>"""
    for kind in ("planar", "fixed"):
        (tmp_path / f"{kind}.urdf").write_text(text.replace("KIND", kind))
    planar, fixed = (dqc.load_robot(tmp_path / f"{kind}.urdf", tips="all") for kind in ("planar", "fixed"))
    np.testing.assert_array_equal(planar.fkm([0.3]), fixed.fkm([0.3]))
    with pytest.raises(FileFormatError, match=r"is planar; .* \(--base-link base begins below it\)"):
        load_robot(tmp_path / "planar.urdf")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"drive": "found", "tips": "all"}, "drive: makes a base on wheels; leave out 'tips'"),
        ({"wheel_radius": 0.1}, "wheel_radius: is that of a drive; give drive='found'"),
        ({"tips": ["tool"], "tip_link": "tool"}, "tips: make a tree and 'tip_link' a chain"),
        ({"tips": "panda_link8"}, "tips: expected 'all' or a list of links, got 'panda_link8'"),
        ({"tips": []}, "tips: expected 'all' or a list of links, got \\[\\]"),
        ({"floating": True}, "floating: is the root of a tree; give 'tips'"),
    ],
)
def test_a_robot_is_of_one_kind(options, message):
    with pytest.raises(ShapeError, match=message):
        dqc.load_robot("example-robot-data:panda_description/urdf/panda.urdf", **options)

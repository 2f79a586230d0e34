"""Our files of trees and of two arms, and the command that writes them."""

import sys

import numpy as np
import pytest
import yaml

import dqcontrol as dqc
from dqcontrol import cli
from dqcontrol.errors import FileFormatError
from dqcontrol.robots import load_robot
from dqcontrol.robots.files.tree_file import plain_tree

HAND = """<robot name="hand"><link name="palm"/><link name="a1"><inertial><mass value="0.3"/>
  <inertia ixx="1e-3" ixy="0" ixz="0" iyy="1e-3" iyz="0" izz="2e-3"/></inertial></link><link name="b1"/>
<joint name="a" type="revolute"><origin xyz="0.1 0 0" rpy="0.3 0 0"/><parent link="palm"/><child link="a1"/>
  <axis xyz="0 1 0"/><limit lower="-1" upper="1" velocity="2" effort="3"/></joint>
<joint name="b" type="prismatic"><origin xyz="-0.1 0 0"/><parent link="a1"/><child link="b1"/>
  <axis xyz="0 0 1"/><limit lower="-1" upper="1" velocity="2" effort="3"/>
  <mimic joint="a" multiplier="-2" offset="0.1"/></joint></robot>"""

TWO = {
    "name": "two",
    "angles": "degrees",
    "left": {
        "robot": "ur5",
        "base": {"position": [0, 0.3, 0], "rpy": [0, 0, 90]},
        "tool": {"position": [0, 0, 0.1]},
    },
    "right": {"robot": "ur5", "base": {"position": [0, -0.3, 0]}},
}


@pytest.fixture
def hand(tmp_path):
    (tmp_path / "hand.urdf").write_text(HAND)
    return tmp_path / "hand.urdf"


def test_a_tree_is_the_same_from_its_file(hand, tmp_path):
    robot = load_robot(hand, tips="all")
    (tmp_path / "hand.yaml").write_text(yaml.safe_dump(plain_tree(robot)))
    again = dqc.load_robot(tmp_path / "hand.yaml")
    assert isinstance(again, dqc.TreeRobot)
    assert again.joint_names == robot.joint_names
    assert (again.limits.effort == robot.limits.effort).all()
    for name in ("a1", "b1", "palm"):
        assert np.abs(again.fkm([0.4], name) - robot.fkm([0.4], name)).max() < 1e-15
    assert np.abs(again.gravity_forces([0.4]) - robot.gravity_forces([0.4])).max() < 1e-15


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"carrier": "aa"}, r"joints\[1\]\.carrier: unknown name 'aa'; did you mean 'a'"),
        ({"name": "a"}, r"joints\[1\]\.name: 'a' is already the name of another joint"),
        ({"mimic": {"joint": "b"}}, "joint 'b': follows joint 'b', which itself follows 'b'"),
        ({"sort": "revolute"}, r"joints\[1\]: unknown key 'sort'|joints\[1\].*sort"),
    ],
)
def test_what_is_wrong_in_a_file_of_a_tree(hand, tmp_path, change, message):
    data = plain_tree(load_robot(hand, tips="all"))
    data["joints"][1] |= change
    (tmp_path / "hand.yaml").write_text(yaml.safe_dump(data))
    with pytest.raises(FileFormatError, match=message):
        dqc.load_robot(tmp_path / "hand.yaml")


def test_a_file_of_two_arms(tmp_path):
    (tmp_path / "two.yaml").write_text(yaml.safe_dump(TWO))
    arms, ur5 = dqc.load_robot(tmp_path / "two.yaml"), dqc.load_robot("ur5")
    assert isinstance(arms, dqc.TwoArms)
    assert arms.task.label == "left seen from right"
    q = np.linspace(-1, 1, 12)
    base = dqc.DualQuaternion.from_rpy([0, 0, np.pi / 2], [0, 0.3, 0])
    left = base * dqc.DualQuaternion(ur5.fkm(q[:6])) * dqc.DualQuaternion.from_translation([0, 0, 0.1])
    assert np.abs(arms.fkm(q, "left") - left.vec8).max() < 1e-14


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"left": {"robot": "ur6"}}, r"left: robot: unknown name 'ur6'; did you mean 'ur5'"),
        ({"right": None}, r"right"),
        ({"base": {"robot": "youbot", "mirrored": True}}, "base: mirrored: 'youbot' is a whole body"),
        ({"left": {"robot": "two-pandas"}}, "left: robot: 'two-pandas' is a tree"),
        ({"task": "both"}, r"task: .*both.* \(allowed: .*relative"),
    ],
)
def test_what_is_wrong_in_a_file_of_two_arms(tmp_path, change, message):
    (tmp_path / "two.yaml").write_text(yaml.safe_dump(TWO | change))
    with pytest.raises(FileFormatError, match=message):
        dqc.load_robot(tmp_path / "two.yaml")


def test_convert(hand, tmp_path, monkeypatch, capsys):
    def run(*words):
        monkeypatch.setattr(sys, "argv", ["dqcontrol", "robots", "convert", *map(str, words)])
        with pytest.raises(SystemExit) as end:
            cli.main()
        assert end.value.code == 2
        return capsys.readouterr().err

    monkeypatch.setattr(
        sys,
        "argv",
        ["dqcontrol", "robots", "convert", str(hand), str(tmp_path / "tree.yaml"), "--tips", "all"],
    )
    cli.main()
    assert "hand, 1 coordinates" in capsys.readouterr().out
    assert (
        np.abs(
            dqc.load_robot(tmp_path / "tree.yaml").fkm([0.2]) - load_robot(hand, tips="all").fkm([0.2])
        ).max()
        < 1e-15
    )
    monkeypatch.setattr(
        sys,
        "argv",
        ["dqcontrol", "robots", "convert", str(hand), str(tmp_path / "arm.yaml"), "--tip-link", "a1"],
    )
    cli.main()
    arm = dqc.load_robot(hand, tip_link="a1")
    assert np.abs(dqc.load_robot(tmp_path / "arm.yaml").fkm([0.2]) - arm.fkm([0.2])).max() < 1e-15
    assert "exists; choose another name" in run(hand, tmp_path / "arm.yaml", "--tip-link", "a1")
    assert "give one of them" in run(hand, tmp_path / "new.yaml", "--tip-link", "a1", "--tips", "all")
    assert "is made of several files" in run("two-pandas", tmp_path / "new.yaml")

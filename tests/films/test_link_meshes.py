"""Clips and pictures draw the links that a URDF file shows, where they are."""

from pathlib import Path

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.algebra import matrix_from_pose, translation
from dqcontrol.films.film import add_meshes, framing_of_arm, link_meshes
from dqcontrol.plants.mujoco.mujoco_model import (
    RODS,
    compiled,
    skeleton,
    skeleton_positions,
)
from dqcontrol.robots.files.mjcf import import_mujoco

pytest.importorskip("mujoco")
pytest.importorskip("trimesh")
pytest.importorskip("yourdfpy")
Q = np.array([0.4, -0.6])
LINK = """
  <link name="{name}">
    <visual>
      <origin xyz="0 0 {up}" rpy="0 0 0.3"/>
      <geometry><box size="0.2 0.1 {height}"/></geometry>
      <material name="{name}"><color rgba="{colour} 1"/></material>
    </visual>
  </link>"""


@pytest.fixture
def arm(tmp_path: Path) -> dqc.SerialArm:
    """Return an arm of two joints on a foot that reaches 0.5 m below its base frame."""
    links = LINK.format(name="foot", up=-0.25, height=0.5, colour="0 0 1")
    links += LINK.format(name="one", up=0.2, height=0.4, colour="1 0 0")
    links += LINK.format(name="two", up=0.1, height=0.2, colour="0 1 0")
    joints = "".join(
        f'<joint name="{child}_joint" type="revolute"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="0 0 {up}" rpy="0.2 0 0"/><axis xyz="0 1 0"/>'
        '<limit lower="-2" upper="2" velocity="1" effort="1"/></joint>'
        for parent, child, up in (("foot", "one", 0.0), ("one", "two", 0.4))
    )
    (tmp_path / "two.urdf").write_text(f'<robot name="two">{links}{joints}</robot>')
    found = dqc.load_robot(tmp_path / "two.urdf")
    assert isinstance(found, dqc.SerialArm)
    return found


def test_meshes_stand_where_the_frames_take_them_and_rods_are_hidden(arm):
    meshes, spec, mujoco = link_meshes(arm), skeleton(arm), import_mujoco()
    assert [mesh.row for mesh in meshes] == [-1, 0, 1]
    assert [mesh.colour[:3] for mesh in meshes] == [(0, 0, 1), (1, 0, 0), (0, 1, 0)]
    add_meshes(spec, arm, meshes)
    model = compiled(spec)
    data = mujoco.MjData(model)
    data.qpos[:] = Q
    mujoco.mj_kinematics(model, data)
    frames = arm.frames(Q)
    drawn = np.flatnonzero(model.geom_type == mujoco.mjtGeom.mjGEOM_MESH)
    assert len(drawn) == 3
    for geom, mesh in zip(sorted(drawn, key=lambda g: model.geom_dataid[g]), meshes, strict=True):
        which = model.geom_dataid[geom]
        first = model.mesh_vertadr[which]
        local = model.mesh_vert[first : first + model.mesh_vertnum[which]]
        shown = local @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]
        place = np.eye(4) if mesh.row < 0 else matrix_from_pose(frames[mesh.row])
        wanted = mesh.vertices @ place[:3, :3].T + place[:3, 3]
        for corner in wanted:
            assert np.linalg.norm(shown - corner, axis=1).min() < 1e-6
    rods = model.geom_group == RODS
    assert (model.geom_rgba[rods & (model.geom_type != mujoco.mjtGeom.mjGEOM_MESH), 3] == 0).all()


def test_the_picture_holds_the_foot_which_stands_on_the_floor(arm):
    meshes, hand = link_meshes(arm), translation(arm.fkm(Q))[None]
    framing = framing_of_arm(arm, Q[None], hand, meshes)
    assert framing.floor == pytest.approx(-0.5)
    assert framing.stands
    assert not framing_of_arm(arm, Q[None], hand, []).stands


def test_arms_without_a_file_keep_their_rods():
    arm = dqc.load_robot("iiwa7")
    spec = skeleton(arm)
    add_meshes(spec, arm, link_meshes(arm))
    model = compiled(spec)
    assert (model.geom_rgba[:, 3] == 1).all()


GRIPPER = """<robot name="gripper">
  <link name="foot"/><link name="wrist"/><link name="left"/><link name="right"/>
  <joint name="turn" type="revolute"><parent link="foot"/><child link="wrist"/><axis xyz="1 0 0"/>
    <origin xyz="0 0 0.3" rpy="0.1 0.2 0.3"/><limit lower="-2" upper="2" velocity="1" effort="1"/></joint>
  <joint name="left_finger" type="prismatic"><parent link="wrist"/><child link="left"/><axis xyz="0 1 0"/>
    <origin xyz="0 0 0.1"/><mimic joint="right_finger" multiplier="-0.5" offset="0.01"/>
    <limit lower="-1" upper="1" velocity="1" effort="1"/></joint>
  <joint name="right_finger" type="prismatic"><parent link="wrist"/><child link="right"/><axis xyz="0 1 0"/>
    <limit lower="0" upper="0.04" velocity="1" effort="1"/></joint>
</robot>"""


def test_joints_that_follow_others_are_drawn_where_they_are(tmp_path):
    (tmp_path / "gripper.urdf").write_text(GRIPPER)
    robot, mujoco = dqc.load_robot(tmp_path / "gripper.urdf", tips="all"), import_mujoco()
    q = np.array([0.7, 0.03])
    model = compiled(skeleton(robot))
    data = mujoco.MjData(model)
    data.qpos[:] = skeleton_positions(robot, q)
    mujoco.mj_kinematics(model, data)
    for i, frame in enumerate(robot.frames(q)[:3]):
        assert np.allclose(data.body(f"link_{i + 1}").xpos, translation(frame), atol=1e-12)
    assert data.joint("left_finger").qpos == pytest.approx(-0.015)
    assert model.joint("left_finger").range == pytest.approx([-0.02, 0.0])

"""Geoms of MJCF files: what is seen, and what is kept apart, where MuJoCo has it."""

import mujoco
import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.figures.robot_bodies import robot_shapes
from dqcontrol.geometry import Box, Capsule, Sphere
from dqcontrol.robots.collision_shapes import collision_shapes
from dqcontrol.robots.files.mjcf import geom_mesh, mjcf_geoms, shown_geoms

TEXT = """<mujoco model="shapes">
<asset><mesh name="wedge" vertex="0 0 0 0.2 0 0 0 0.1 0 0 0 0.1"/><material name="red" rgba="1 0 0 1"/></asset>
<worldbody><geom type="plane" size="1 1 0.1"/>
  <body name="a" pos="0 0 0.3" euler="10 20 30"><joint name="one" axis="0 1 0" range="-90 90" ref="20"/>
    <geom type="capsule" fromto="0 0 0 0.3 0.1 0" size="0.02" material="red"/>
    <geom name="seen" type="cylinder" size="0.05 0.1" pos="0 0 0.1" contype="0" conaffinity="0"/>
    <geom type="box" size="0.02 0.03 0.04" pos="0.1 0 0" euler="0 0 45" group="3"/>
    <body name="b" pos="0.3 0.1 0"><joint name="two" axis="0 0 1" range="-90 90"/>
      <geom type="ellipsoid" size="0.1 0.03 0.02" pos="0.1 0 0"/><geom type="mesh" mesh="wedge" pos="0 0.1 0"/>
      <geom type="sphere" size="0.03" pos="0.2 0 0"/></body></body>
</worldbody></mujoco>"""


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    found = tmp_path_factory.mktemp("mjcf") / "shapes.xml"
    found.write_text(TEXT)
    return found


def test_geoms_are_where_mujoco_has_them(path):
    model = mujoco.MjModel.from_xml_path(str(path))
    data, geoms = mujoco.MjData(model), mjcf_geoms(path)
    assert [geom.kind for geom in geoms] == ["capsule", "cylinder", "box", "ellipsoid", "mesh", "sphere"]
    assert geoms[0].colour == (255, 0, 0)
    assert {geom.name for geom in geoms} >= {"a", "seen", "a.3", "b", "b.2", "b.3"}
    assert "a.3" not in {geom.name for geom in shown_geoms(path)}
    q = np.array([0.4, -0.7])
    data.qpos[:] = q
    mujoco.mj_kinematics(model, data)
    for robot in (dqc.load_robot(path, tips="all"), dqc.load_robot(path, tip_link="b")):
        assert robot.placed_links is not None
        frames = dqc.algebra.matrix_from_pose(robot.frames(q))
        for k, geom in enumerate(geoms, 1):
            at = robot.placed_links.frames[geom.body]
            place = frames[at.joint] @ dqc.algebra.matrix_from_pose(
                dqc.algebra.pose(at.pose[:4], at.pose[4:])
            )
            assert np.abs((place @ geom.place)[:3, 3] - data.geom_xpos[k]).max() < 1e-12
            assert np.abs((place @ geom.place)[:3, :3].ravel() - data.geom_xmat[k]).max() < 1e-12
        assert {body.carrier for body in robot_shapes(robot)} == {0, 1}


@pytest.mark.slow
def test_what_collides_is_inside_of_its_shape(path):
    robot = dqc.load_robot(path, tips="all")
    fitted = {each.shape.name: each.shape for each in collision_shapes(robot)}
    assert "seen" not in fitted
    assert [type(fitted[name].shape) for name in ("a", "a.3", "b", "b.2", "b.3")] == [
        Capsule,
        Box,
        Capsule,
        Capsule,
        Sphere,
    ]
    for geom in mjcf_geoms(path):
        if geom.name not in ("b", "b.2"):
            continue
        assert robot.placed_links is not None
        at = robot.placed_links.frames[geom.body]
        place = dqc.algebra.matrix_from_pose(dqc.algebra.pose(at.pose[:4], at.pose[4:]))
        corners = geom_mesh(geom).vertices @ place[:3, :3].T + place[:3, 3]
        capsule = fitted[geom.name].shape
        assert isinstance(capsule, Capsule)
        along = capsule.end - capsule.start
        share = np.clip((corners - capsule.start) @ along / max(along @ along, 1e-12), 0, 1)
        away = np.linalg.norm(corners - capsule.start - share[:, None] * along, axis=1)
        assert away.max() < capsule.radius + 1e-9

"""MJCF files: kinematics against MuJoCo's own, gains, and what is refused."""

import mujoco
import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.errors import FileFormatError, UnknownNameError
from dqcontrol.plants import MujocoPlant
from dqcontrol.plants.mujoco.mujoco_servos import mass_matrix
from dqcontrol.robots import load_tree
from dqcontrol.robots.mjcf import mjcf_servos

TWO_ARMS = """<mujoco model="two arms">
<compiler angle="degree" autolimits="true"/>
<default><joint armature="0.1"/><default class="slim"><geom type="capsule" size="0.02"/></default></default>
<include file="assets.xml"/>
<worldbody>
  <body name="torso" pos="0 0 0.5" quat="0.9 0.1 0.2 0.3">
    <joint name="waist" axis="0 0 1" range="-90 90" ref="10"/><geom size="0.1"/>
    <body name="left" pos="0 0.2 0.1" euler="10 20 30">
      <joint name="l1" axis="1 1 0" pos="0.01 0.02 0.03" range="-120 120"/>
      <joint name="l2" axis="0 1 0" pos="0 0 -0.01" range="-100 100"/>
      <geom class="slim" fromto="0 0 0 0.3 0 0"/>
      <body name="left hand" pos="0.3 0 0"><joint name="l3" type="slide" axis="1 0 0" range="0 0.2"/>
        <geom class="slim" fromto="0 0 0 0.1 0 0"/>
        <body name="finger" pos="0.1 0 0"><joint name="l4" axis="0 0 1"/><geom size="0.02"/></body></body>
    </body>
    <body name="right" pos="0 -0.2 0.1"><joint name="r1" axis="0 0 1" range="-120 120"/>
      <geom class="slim" fromto="0 0 0 0.3 0 0"/><body name="right hand" pos="0.3 0 0"><geom size="0.02"/></body></body>
  </body>
</worldbody>
<equality><joint joint1="l4" joint2="l3" polycoef="0.1 2 0 0 0"/></equality>
<actuator><position joint="l1" kp="200" kv="20" forcerange="-30 30"/>
  <motor joint="r1" gear="2" forcerange="-5 5"/></actuator>
</mujoco>"""


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    folder = tmp_path_factory.mktemp("mjcf")
    (folder / "assets.xml").write_text(
        '<mujocoinclude><asset><material name="grey"/></asset></mujocoinclude>'
    )
    (folder / "two.xml").write_text(TWO_ARMS)
    return folder / "two.xml"


def test_every_body_against_mujoco(path):
    robot, model = load_tree(path), mujoco.MjModel.from_xml_path(str(path))
    assert robot.joint_names == ("waist", "l1", "l2", "l3", "r1")
    data, rng = mujoco.MjData(model), np.random.default_rng(1)
    turns, moves = np.empty((3, model.nv)), np.empty((3, model.nv))
    for _ in range(10):
        q = rng.uniform(np.maximum(robot.limits.lower, -3), np.minimum(robot.limits.upper, 3))
        l4 = model.qpos0[4] + 0.1 + 2 * (q[3] - model.qpos0[3])
        data.qpos[:] = [*q[:4], l4, q[4]]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        gather = np.insert(np.eye(5), 4, 2 * np.eye(5)[3], axis=0)
        for name in robot.frame_names[2:]:
            body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name)
            if body < 0:
                continue
            pose = robot.fkm(q, name)
            assert np.abs(dqc.algebra.translation(pose) - data.xpos[body]).max() < 1e-12
            assert np.abs(np.sign(pose[:4] @ data.xquat[body]) * pose[:4] - data.xquat[body]).max() < 1e-12
            mujoco.mj_jac(model, data, moves, turns, data.xpos[body], body)
            ours = robot.with_task(name).hand_jacobian(q)
            assert np.abs(ours - np.vstack([turns, moves]) @ gather).max() < 1e-12


def test_limits_masses_and_gains(path):
    robot, model = load_tree(path), mujoco.MjModel.from_xml_path(str(path))
    assert np.abs(robot.limits.lower[:3] - np.radians([-90, -120, -100])).max() < 1e-12
    assert robot.limits.effort.tolist() == [np.inf, 30, np.inf, np.inf, 10]
    assert robot.inertia is not None
    assert abs(robot.inertia.mass.sum() - model.body_mass.sum()) < 1e-9
    gains = mjcf_servos(path)
    assert list(gains) == ["l1"]
    assert (gains["l1"].stiffness, gains["l1"].damping, gains["l1"].effort, gains["l1"].armature) == (
        200,
        20,
        30,
        0.1,
    )
    data, q = mujoco.MjData(model), np.array([0.2, 0.5, -0.4, 0.1, 0.3])
    data.qpos[:] = [*q[:4], model.qpos0[4] + 0.1 + 2 * q[3], q[4]]
    mujoco.mj_forward(model, data)
    bias = data.qfrc_bias
    expected = [bias[0], bias[1], bias[2], bias[3] + 2 * bias[4], bias[5]]
    assert np.abs(robot.gravity_torque(q) - expected).max() < 1e-9


def test_inertia_of_joints_with_a_reference_position(tmp_path):
    """A joint's ``ref`` is its coordinate where the file has its bodies: masses turn and shift with it."""
    text = TWO_ARMS[: TWO_ARMS.index("<equality>")].replace('<include file="assets.xml"/>', "")
    text = text.replace('range="-120 120"', 'range="-120 120" ref="35"').replace(' armature="0.1"', "")
    text = text.replace('<joint name="l2" axis="0 1 0" pos="0 0 -0.01" range="-100 100"/>', "")
    path = tmp_path / "ref.xml"
    path.write_text(text.replace('range="0 0.2"', 'range="0 0.2" ref="0.07"') + "</mujoco>")
    robot, model = load_tree(path), mujoco.MjModel.from_xml_path(str(path))
    assert np.abs(model.qpos0 - np.array([*np.radians([10, 35]), 0.07, 0, np.radians(35)])).max() < 1e-12
    data, rng = mujoco.MjData(model), np.random.default_rng(4)
    for _ in range(5):
        q = rng.uniform(np.maximum(robot.limits.lower, -1), np.minimum(robot.limits.upper, 1))
        data.qpos[:] = q
        mujoco.mj_forward(model, data)
        ours = MujocoPlant(armature=0.0).start(robot, q, 0.01, 1, 0)
        assert np.abs(mass_matrix(ours.model, ours.data) - mass_matrix(model, data)).max() < 1e-12
        assert np.abs(robot.gravity_torque(q) - data.qfrc_bias).max() < 1e-12


def test_a_chain_of_it_is_an_arm(path):
    arm = dqc.load_robot(path, tip_link="left hand")
    assert arm.joint_names == ("waist", "l1", "l2", "l3")
    robot, q = load_tree(path), np.array([0.2, 0.5, -0.4, 0.1])
    assert np.abs(arm.fkm(q) - robot.fkm([*q, 0.3], "left hand")).max() < 1e-14
    with pytest.raises(UnknownNameError, match="tip_link: unknown link 'left hnd'; did you mean 'left hand'"):
        dqc.load_robot(path, tip_link="left hnd")
    with pytest.raises(FileFormatError, match=r"two.xml:\d+: joint 'l4': follows joint 'l3' \(mimic\)"):
        dqc.load_robot(path, tip_link="finger")


TIED = '<tendon><fixed name="t"><joint joint="l1" coef="1"/></fixed></tendon><equality><tendon tendon1="t"/>'


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "</equality>",
            '<connect body1="left hand" body2="right hand" anchor="0 0 0"/></equality>',
            r"two.xml:\d+: equality 'equality_1': connects 'left hand' and 'right hand': that closes a loop",
        ),
        (
            "</equality>",
            '<weld name="bond" body1="left hand" body2="right hand"/></equality>',
            r"equality 'bond': welds 'left hand' and 'right hand'",
        ),
        ("0.1 2 0 0 0", "0.1 2 1 0 0", r"ties joint 'l4' to 'l3' by a polynomial"),
        ('name="l4" axis="0 0 1"', 'name="l4" type="ball"', r"joint 'l4': is a ball joint"),
        (
            '<geom size="0.1"/>',
            '<geom sise="0.1"/>',
            r"MuJoCo cannot read it: XML Error: Schema violation.*sise",
        ),
        ("assets.xml", "none.xml", r"MuJoCo cannot read it.*none.xml"),
        ("<equality>", TIED, r"equality 'equality_0': ties tendons"),
    ],
)
def test_what_is_refused_is_named(path, tmp_path, old, new, message):
    assert old in TWO_ARMS
    (tmp_path / "assets.xml").write_text((path.parent / "assets.xml").read_text())
    text = TWO_ARMS.replace(old, new)
    if "ball" in message:
        text = text.split("<equality>")[0] + "</mujoco>"
    (tmp_path / "two.xml").write_text(text)
    with pytest.raises(FileFormatError, match=message):
        load_tree(tmp_path / "two.xml")


def test_a_file_that_is_not_there():
    with pytest.raises(FileFormatError, match=r"none\.xml: cannot be read: No such file"):
        load_tree("none.xml")

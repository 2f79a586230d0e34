"""MJCF files: kinematics against MuJoCo's own, gains, and what is refused."""

import mujoco
import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.errors import FileFormatError, NoteWarning, UnknownNameError
from dqcontrol.plants import MujocoPlant
from dqcontrol.plants.mujoco.mujoco_model import mass_matrix
from dqcontrol.robots import load_robot
from dqcontrol.robots.files.mjcf import mjcf_servos

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
    robot, model = load_robot(path, tips="all"), mujoco.MjModel.from_xml_path(str(path))
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
    robot, model = load_robot(path, tips="all"), mujoco.MjModel.from_xml_path(str(path))
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
    assert np.abs(robot.gravity_forces(q) - expected).max() < 1e-9


def test_inertia_of_joints_with_a_reference_position(tmp_path):
    """A joint's ``ref`` is its coordinate where the file has its bodies: masses turn and shift with it."""
    text = TWO_ARMS[: TWO_ARMS.index("<equality>")].replace('<include file="assets.xml"/>', "")
    text = text.replace('range="-120 120"', 'range="-120 120" ref="35"').replace(' armature="0.1"', "")
    text = text.replace('<joint name="l2" axis="0 1 0" pos="0 0 -0.01" range="-100 100"/>', "")
    path = tmp_path / "ref.xml"
    path.write_text(text.replace('range="0 0.2"', 'range="0 0.2" ref="0.07"') + "</mujoco>")
    robot, model = load_robot(path, tips="all"), mujoco.MjModel.from_xml_path(str(path))
    assert np.abs(model.qpos0 - np.array([*np.radians([10, 35]), 0.07, 0, np.radians(35)])).max() < 1e-12
    data, rng = mujoco.MjData(model), np.random.default_rng(4)
    for _ in range(5):
        q = rng.uniform(np.maximum(robot.limits.lower, -1), np.minimum(robot.limits.upper, 1))
        data.qpos[:] = q
        mujoco.mj_forward(model, data)
        ours = MujocoPlant(armature=0.0).start(robot, q, 0.01, 1, 0)
        assert np.abs(mass_matrix(ours.model, ours.data) - mass_matrix(model, data)).max() < 1e-12
        assert np.abs(robot.gravity_forces(q) - data.qfrc_bias).max() < 1e-12


def test_a_chain_of_it_is_an_arm(path):
    arm = dqc.load_robot(path, tip_link="left hand")
    assert arm.joint_names == ("waist", "l1", "l2", "l3")
    robot, q = load_robot(path, tips="all"), np.array([0.2, 0.5, -0.4, 0.1])
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
        load_robot(tmp_path / "two.xml", tips="all")


# An arm whose gripper closes loops, as those of two fingers with parallel jaws do: drivers carry couplers, and
# connect equalities pin followers to these; one driver follows the other.
FINGER = """<body name="{0}_driver" pos="0 {1} 0.05"><joint name="{0}_driver_joint" axis="1 0 0"/><geom size="0.01"/>
  <body name="{0}_coupler" pos="0 {1} 0.02"><joint name="{0}_coupler_joint" axis="1 0 0"/><geom size="0.01"/></body>
</body>
<body name="{0}_spring" pos="0 {1} 0.06"><joint name="{0}_spring_joint" axis="1 0 0"/><geom size="0.01"/>
  <body name="{0}_follower" pos="0 {1} 0.03"><joint name="{0}_follower_joint" axis="1 0 0"/><geom size="0.01"/>
    <body name="{0}_pad" pos="0 0 0.02"><geom size="0.01"/></body></body></body>"""
PARALLEL = f"""<mujoco model="arm"><worldbody><body name="upper" pos="0 0 0.2" euler="10 0 0">
<joint name="j1" axis="0 0 1"/><geom size="0.1"/>
<body name="fore" pos="0.3 0 0.1"><joint name="j2" axis="0 1 0" range="-90 90"/><geom size="0.1"/>
<body name="wrist" pos="0.2 0 0"><joint name="j3" axis="1 0 0"/><geom size="0.05"/>
<body name="mount" pos="0.05 0 0" euler="0 90 0"><geom size="0.02"/><site name="pinch" pos="0 0 0.15" euler="0 0 45"/>
<site name="wrist"/>{FINGER.format("right", 0.01)}{FINGER.format("left", -0.01)}</body></body></body></body></worldbody>
<tendon><fixed name="split"><joint joint="right_driver_joint" coef="0.5"/><joint joint="left_driver_joint" coef="0.5"/>
</fixed></tendon>
<equality><connect anchor="0 0 0.01" body1="right_follower" body2="right_coupler"/>
<connect anchor="0 0 0.01" body1="left_follower" body2="left_coupler"/>
<joint joint1="right_driver_joint" joint2="left_driver_joint"/></equality></mujoco>"""


def test_loops_of_a_gripper_stay_beside_the_arm(tmp_path):
    path = tmp_path / "parallel.xml"
    path.write_text(PARALLEL)
    with pytest.warns(NoteWarning, match="arm: the arm ends at mount, without the joints of its gripper"):
        arm = dqc.load_robot(path)
    assert arm.joint_names == ("j1", "j2", "j3")
    model = mujoco.MjModel.from_xml_path(str(path))
    assert arm.inertia is not None
    assert abs(arm.inertia.mass.sum() - model.body_mass.sum()) < 1e-12
    tree = load_robot(path, tips=["pinch"])
    assert tree.joint_names == ("j1", "j2", "j3")
    with pytest.raises(
        FileFormatError,
        match=r"connects 'right_follower' and 'right_coupler': that closes a loop.*a tip above",
    ):
        load_robot(path, tips="all")
    with pytest.raises(FileFormatError, match=r"parallel.xml:\d+: equality .* closes a loop"):
        dqc.load_robot(path, tip_link="left_pad")


def test_a_site_is_a_tip(tmp_path):
    path = tmp_path / "parallel.xml"
    path.write_text(PARALLEL)
    model = mujoco.MjModel.from_xml_path(str(path))
    data, q = mujoco.MjData(model), np.array([0.3, -0.4, 0.8])
    data.qpos[:3] = q
    mujoco.mj_kinematics(model, data)
    site, arm = data.site("pinch"), dqc.load_robot(path, tip_link="pinch")
    hand = dqc.DualQuaternion(arm.fkm(q))
    assert np.abs(hand.translation - site.xpos).max() < 1e-12
    seen = dqc.DualQuaternion(load_robot(path, tips=["mount"]).fkm(q, "pinch"))
    assert np.abs(seen.matrix()[:3, :3] - site.xmat.reshape(3, 3)).max() < 1e-12
    assert np.abs(hand.matrix() - seen.matrix()).max() < 1e-12
    assert dqc.load_robot(path, tip_link="wrist site").joint_names == arm.joint_names  # "wrist" is a body


def test_what_is_welded_to_the_hand_or_hangs_on_a_ball_leaves_the_arm(tmp_path):
    """A free body goes where it is welded to; a ball joint beside the chain does not move it."""
    free = '<body name="cup"><freejoint/><geom size="0.02"/></body></worldbody>'
    ball = '<body name="bell"><joint name="ring" type="ball"/><geom size="0.02"/></body><site name="wrist"/>'
    text = PARALLEL.replace("</worldbody>", free).replace('<site name="wrist"/>', ball)
    path = tmp_path / "cup.xml"
    path.write_text(text.replace("</equality>", '<weld body1="mount" body2="cup"/></equality>'))
    assert dqc.load_robot(path, tip_link="mount").joint_names == ("j1", "j2", "j3")
    with pytest.raises(FileFormatError, match="joint 'ring': is a ball joint"):
        dqc.load_robot(path, tip_link="bell")


def test_a_loop_within_the_arm_is_refused(tmp_path):
    """Not shortened: the joint before the loop is no arm."""
    path = tmp_path / "linkage.xml"
    text = PARALLEL.replace("</equality>", '<connect anchor="0 0 0" body1="fore" body2="world"/></equality>')
    path.write_text(text)
    with (
        pytest.warns(NoteWarning, match="ends at mount"),
        pytest.raises(FileFormatError, match="connects 'fore' and 'world': that closes a loop"),
    ):
        dqc.load_robot(path)


def test_a_file_that_is_not_there():
    with pytest.raises(FileFormatError, match=r"none\.xml: no such file"):
        load_robot("none.xml", tips="all")

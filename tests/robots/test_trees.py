"""Trees of joints from URDF files: against Pinocchio, against chains, and what is refused."""
# pyright: reportAttributeAccessIssue=false
# (Pinocchio's compiled names are invisible to pyright)

import numpy as np
import pinocchio as pin
import pytest

import dqcontrol as dqc
from dqcontrol.errors import FileFormatError, UnknownNameError
from dqcontrol.robots import PoseTask, load_robot
from dqcontrol.robots.files.load import package_files
from dqcontrol.robots.files.urdf import urdf_tree

SOME = (
    "tiago_description/robots/tiago.urdf",
    "panda_description/urdf/panda.urdf",
    "ur_description/urdf/ur5_robot.urdf",
)
REFUSED = {  # what others read and what a tree cannot hold, or what nobody can
    "alex_description/urdf/alex_psyonic_hands.urdf": "follows joint 'index_q1', which does not exist",
    "centauro_description/urdf/centauro.urdf": "lower 0 ≥ upper 0",
    "double_pendulum_description/urdf/double_pendulum.urdf": "lower 0 ≥ upper 0",
    "double_pendulum_description/urdf/double_pendulum_simple.urdf": "lower 0 ≥ upper 0",
    "hector_description/robots/quadrotor_base.urdf": "has no joint that turns or slides",
    "hector_description/robots/quadrotor_base.urdf.xacro": "misses its attribute 'name'",
    "hector_description/robots/quadrotor_base.xacro": "xacro cannot expand it: No such file",
    "iris_description/robots/iris_simple.urdf": "has no joint that turns or slides",
    "quadruped_description/urdf/quadruped.urdf": "lower 0 ≥ upper 0",
    "ur_description/urdf/ur3.urdf": "misses its attribute 'name'",
}

HAND = """<robot name="hand">
<link name="palm"/><link name="a1"/><link name="a2"/><link name="b1"/><link name="b2"/>
<joint name="a" type="revolute"><origin xyz="0.1 0 0" rpy="0.3 0 0"/><parent link="palm"/><child link="a1"/>
  <axis xyz="0 1 0"/><limit lower="-1" upper="1" velocity="2" effort="3"/></joint>
<joint name="a tip" type="revolute"><origin xyz="0.2 0 0"/><parent link="a1"/><child link="a2"/>
  <axis xyz="0 1 0"/><limit lower="-2" upper="2" velocity="2" effort="3"/>
  <mimic joint="a" multiplier="0.5" offset="0.1"/></joint>
<joint name="b" type="prismatic"><origin xyz="-0.1 0 0"/><parent link="palm"/><child link="b1"/>
  <axis xyz="0 0 1"/><limit lower="-1" upper="1" velocity="2" effort="3"/><mimic joint="a" multiplier="-2"/></joint>
<joint name="free" type="continuous"><origin xyz="0 0.1 0"/><parent link="b1"/><child link="b2"/></joint>
</robot>"""


def at_random(robot, seed=1):
    lower, upper = np.maximum(robot.limits.lower, -2), np.minimum(robot.limits.upper, 2)
    return np.random.default_rng(seed).uniform(lower, np.maximum(upper, lower))


def pinocchio_at(model, tree, robot, q):
    """Return Pinocchio's configuration, and the matrix that takes our rates to its."""
    theirs, gather = pin.neutral(model), np.zeros((model.nv, robot.input_size))
    index = {name: i for i, name in enumerate(robot.joint_names)}
    for joint in tree.joints:
        if joint.kind not in ("revolute", "prismatic"):
            continue
        leader, multiplier, offset = joint.mimic or (joint.name, 1.0, 0.0)
        value, at = multiplier * q[index[leader]] + offset, model.joints[model.getJointId(joint.name)]
        theirs[at.idx_q : at.idx_q + at.nq] = [np.cos(value), np.sin(value)] if at.nq == 2 else value
        gather[at.idx_v, index[leader]] = multiplier
    return theirs, gather


def check_against_pinocchio(path):
    tree = urdf_tree(path)
    robot, model = tree.tree(), pin.buildModelFromUrdf(str(path))
    data, q = model.createData(), at_random(robot)
    theirs, gather = pinocchio_at(model, tree, robot, q)
    pin.computeJointJacobians(model, data, theirs)
    pin.updateFramePlacements(model, data)
    frames = robot.frames(q)[-len(robot.frame_names) :]
    for name, frame in zip(robot.frame_names, frames, strict=True):
        number = model.getFrameId(name, pin.BODY)
        if number >= model.nframes:
            continue
        pose, expected = robot.fkm(q, name), data.oMf[number]
        assert np.abs(dqc.algebra.translation(pose) - expected.translation).max() < 1e-12
        assert np.abs(dqc.DualQuaternion(pose).matrix()[:3, :3] - expected.rotation).max() < 1e-12
        assert np.abs(pose * np.sign(pose @ frame) - frame).max() < 1e-12
        jacobian = pin.getFrameJacobian(model, data, number, pin.WORLD) @ gather
        assert np.abs(np.vstack([jacobian[3:], jacobian[:3]]) - robot.twist_jacobian_of(name, q)).max() < 1e-9


@pytest.mark.parametrize("name", SOME)
def test_every_frame_against_pinocchio(name):
    check_against_pinocchio(package_files("example-robot-data")[name])


@pytest.mark.slow
def test_every_file_of_example_robot_data_against_pinocchio():
    refused = {}
    for name, path in package_files("example-robot-data").items():
        try:
            load_robot(path, tips="all")
        except (FileFormatError, UnknownNameError) as error:
            refused[name] = str(error)
            continue
        check_against_pinocchio(path)
    assert refused.keys() == REFUSED.keys()
    assert all(REFUSED[name] in reason for name, reason in refused.items())


@pytest.mark.parametrize("name", SOME)
def test_centre_of_mass_against_pinocchio(name):
    path = package_files("example-robot-data")[name]
    tree = urdf_tree(path)
    robot, model = tree.tree(), pin.buildModelFromUrdf(str(path))
    model.inertias[0] = pin.Inertia.Zero()  # ours is that of all that moves
    data, q = model.createData(), at_random(robot)
    theirs, gather = pinocchio_at(model, tree, robot, q)
    pin.jacobianCenterOfMass(model, data, theirs)
    assert np.abs(dqc.algebra.translation(robot.pose_of("center_of_mass", q)) - data.com[0]).max() < 1e-12
    jacobian = robot.twist_jacobian_of("center_of_mass", q)
    assert np.abs(jacobian[3:] - data.Jcom @ gather).max() < 1e-9
    assert not jacobian[:3].any()


def test_mimic_joints_are_one_coordinate(tmp_path):
    (tmp_path / "hand.urdf").write_text(HAND)
    check_against_pinocchio(tmp_path / "hand.urdf")
    robot = load_robot(tmp_path / "hand.urdf", tips="all")
    assert robot.joint_names == ("a", "free")
    assert robot.follows == ("a",)
    q, h = np.array([0.3, -0.4]), 1e-5
    for task in (
        PoseTask("relative", ("a2", "b2")),
        PoseTask("absolute", ("a2", "b2")),
        PoseTask("frame", ("b2",)),
    ):
        expected = [
            (robot.pose_of(task, q + h * e) - robot.pose_of(task, q - h * e)) / (2 * h) for e in np.eye(2)
        ]
        assert np.abs(robot.pose_jacobian_of(task, q) - np.transpose(expected)).max() < 1e-9


def test_any_base_and_a_chain_of_it_are_the_same():
    path = package_files("example-robot-data")["tiago_description/robots/tiago.urdf"]
    arm = dqc.load_robot(path, "torso_lift_link", "arm_7_link")
    robot = load_robot(path, "torso_lift_link", tips=["arm_7_link"])
    q = at_random(robot)
    assert robot.joint_names[-7:] == arm.joint_names
    assert np.abs(robot.fkm(q) - arm.fkm(q[-7:])).max() < 1e-14
    assert np.abs(robot.fkm(q, "arm_7_link", base="torso_lift_link") - arm.fkm(q[-7:])).max() < 1e-14
    assert (robot.twist_jacobian(q)[:, :-7] == 0).all()
    assert np.abs(robot.twist_jacobian(q)[:, -7:] - arm.twist_jacobian(q[-7:])).max() < 1e-14


def test_gravity_of_a_tree_against_pinocchio():
    path = package_files("example-robot-data")["tiago_description/robots/tiago.urdf"]
    tree = urdf_tree(path)
    robot, model = tree.tree(), pin.buildModelFromUrdf(str(path))
    q = at_random(robot)
    theirs, gather = pinocchio_at(model, tree, robot, q)
    expected = gather.T @ pin.computeGeneralizedGravity(model, model.createData(), theirs)
    assert np.abs(robot.gravity_forces(np.stack([q, q]))[1] - expected).max() < 1e-9


def test_floating_base():
    path = package_files("example-robot-data")["tiago_description/robots/tiago.urdf"]
    fixed, free = load_robot(path, tips="all"), load_robot(path, tips="all", floating=True)
    assert free.joint_names[:6] == ("base_x", "base_y", "base_z", "base_yaw", "base_pitch", "base_roll")
    q, place = at_random(fixed), np.array([0.3, -0.2, 0.5, 0.4, -0.3, 0.2])
    base = dqc.DualQuaternion.from_rpy(place[:2:-1], place[:3])
    expected = base * dqc.DualQuaternion(fixed.fkm(q, "arm_7_link"))
    assert dqc.DualQuaternion(free.fkm(np.concatenate([place, q]), "arm_7_link")).same_pose(expected)


def test_inverse_kinematics_of_several_tips():
    robot = load_robot(
        package_files("example-robot-data")["tiago_description/robots/tiago_dual.urdf"],
        tips=["arm_left_7_link", "arm_right_7_link"],
    )
    q = 0.5 * at_random(robot, 2) + 0.25 * (robot.limits.lower + robot.limits.upper)
    poses = {name: robot.fkm(q, name) for name in ("arm_left_7_link", "arm_right_7_link")}
    found = robot.solve_tasks(poses)
    assert found.success, found.reason
    for name, pose in poses.items():
        assert dqc.DualQuaternion(robot.fkm(found.q, name)).same_pose(pose, 1e-5)
    far = {
        "arm_left_7_link": poses["arm_left_7_link"],
        "arm_right_7_link": dqc.DualQuaternion.from_translation([5, 0, 0]),
    }
    failed = robot.solve_tasks(far, restarts=5)
    assert "unreachable: not all at once" in failed.reason
    assert "arm_right_7_link" in failed.reason


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            'mimic joint="a" multiplier="-2"',
            'mimic joint="a tip"',
            r"hand.urdf:8: joint 'b': follows joint 'a tip', which itself follows 'a'; let it follow that",
        ),
        (
            'mimic joint="a" multiplier="-2"',
            'mimic joint="aa"',
            r"joint 'b': follows joint 'aa', which does not exist; did you mean 'a'\?",
        ),
        ('<joint name="b" type', '<joint name="a" type', r"joint 'a' is already defined on line 3"),
        ('<parent link="b1"/>', '<parent link="b2"/>', "the links are not a tree: b2 form a loop"),
    ],
)
def test_what_is_refused_is_named_with_its_line(tmp_path, old, new, message):
    path = tmp_path / "hand.urdf"
    assert old in HAND
    path.write_text(HAND.replace(old, new))
    with pytest.raises(FileFormatError, match=message):
        load_robot(path, tips="all")


def test_a_tip_that_does_not_exist(tmp_path):
    path = tmp_path / "hand.urdf"
    path.write_text(HAND)
    with pytest.raises(UnknownNameError, match="frame: unknown link 'b3'; did you mean 'b"):
        load_robot(path, tips=["b3"])
    with pytest.raises(UnknownNameError, match=r"is no \.urdf, \.xacro or \.xml"):
        load_robot("panda", tips="all")

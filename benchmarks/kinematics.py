"""Poses and Jacobians of one configuration, called from Python, against Pinocchio, MuJoCo and DQ Robotics."""

from __future__ import annotations

from functools import partial
from typing import Any

import dqrobotics as dqr
import mujoco
import numpy as np
import pinocchio
from dqrobotics.robot_modeling import DQ_CooperativeDualTaskSpace, DQ_SerialManipulatorDH
from measure import Ratio, medians

import dqcontrol as dqc
from dqcontrol.robots.files.load import package_files

PANDA = "panda_description/urdf/panda.urdf"
TALOS = "talos_data/robots/talos_reduced.urdf"
TIPS = "gripper_left_base_link", "gripper_right_base_link", "left_sole_link"
Q = np.array([0.1, -0.5, 0.2, -2.0, 0.3, 1.6, 0.7])
DH = np.array(  # of the iiwa 7, in the order of DQ Robotics: θ, d, a, α
    [
        np.zeros(7),
        [0.34, 0, 0.4, 0, 0.4, 0, 0.126],
        np.zeros(7),
        [-np.pi / 2, np.pi / 2, np.pi / 2, -np.pi / 2, -np.pi / 2, np.pi / 2, 0],
    ]
)


def dq_robotics_arm() -> Any:
    """Return the arm of `DH` in DQ Robotics."""
    return DQ_SerialManipulatorDH(np.vstack([DH, np.zeros(7)]))


def our_arm() -> dqc.SerialArm:
    """Return the arm of `DH`."""
    return dqc.SerialArm.from_dh(*DH)


def against_pinocchio_and_mujoco(rounds: int) -> list[Ratio]:
    arm = dqc.load_robot(f"example-robot-data:{PANDA}", tip_link="panda_hand")
    path = package_files("example-robot-data")[PANDA]
    full = pinocchio.buildModelFromUrdf(str(path))
    model = pinocchio.buildReducedModel(full, [8, 9], pinocchio.neutral(full))
    data, frame = model.createData(), model.getFrameId("panda_hand")
    physics = mujoco.MjModel.from_xml_string(as_mjcf(arm))
    state = mujoco.MjData(physics)
    rotational, translational = np.empty((3, 7)), np.empty((3, 7))
    hand = physics.nbody - 1
    out = arm.kinematics(Q)

    def by_pinocchio() -> Any:
        pinocchio.computeJointJacobians(model, data, Q)
        pinocchio.updateFramePlacement(model, data, frame)
        return pinocchio.getFrameJacobian(model, data, frame, pinocchio.LOCAL_WORLD_ALIGNED)

    def by_one_call() -> Any:  # the quickest path; it leaves the placement in data.oMf, and no 8 x 7 Jacobian
        return pinocchio.computeFrameJacobian(model, data, Q, frame, pinocchio.LOCAL_WORLD_ALIGNED)

    def by_mujoco() -> None:
        state.qpos[:] = Q
        mujoco.mj_kinematics(physics, state)
        mujoco.mj_comPos(physics, state)
        mujoco.mj_jacBody(physics, state, translational, rotational, hand)

    def all_read() -> None:
        found = arm.kinematics(Q)
        _ = found.pose, found.pose_jacobian, found.twist_jacobian

    by_mujoco()
    jacobian = arm.hand_jacobian(Q)
    check(np.vstack([by_pinocchio()[3:], by_pinocchio()[:3]]), jacobian)
    check(np.vstack([rotational, translational]), jacobian)
    check(np.vstack([by_one_call()[3:], by_one_call()[:3]]), jacobian)
    functions = {
        "out": lambda: arm.kinematics(Q, out),
        "new": all_read,
        "pinocchio": by_pinocchio,
        "one call": by_one_call,
        "mujoco": by_mujoco,
    }
    t = medians(functions, 3000, rounds)
    theirs = "Pinocchio: joint Jacobians, frame placement and Jacobian"
    one_call = "Pinocchio's one call: computeFrameJacobian"
    return [
        Ratio("kinematics(q, out)", t["out"], "µs", theirs, t["pinocchio"], "≤ 0.60"),
        Ratio(
            "kinematics(q, out)", t["out"], "µs", "MuJoCo: kinematics, comPos, jacBody", t["mujoco"], "≤ 0.45"
        ),
        Ratio("kinematics(q), all three read", t["new"], "µs", theirs, t["pinocchio"], "≤ 1.10"),
        Ratio("kinematics(q, out)", t["out"], "µs", one_call, t["one call"], "≤ 1.00"),
        Ratio("kinematics(q), all three read", t["new"], "µs", one_call, t["one call"], "≤ 1.40"),
    ]


def against_dq_robotics(rounds: int) -> list[Ratio]:
    arm, theirs = our_arm(), dq_robotics_arm()
    q, u, out = Q, np.linspace(-1, 1, 7), arm.kinematics(Q)
    pose, jacobian = theirs.fkm(q), theirs.pose_jacobian(q)
    check(dqr.vec8(pose), arm.fkm(q))
    check(jacobian, arm.pose_jacobian(q))
    check(theirs.pose_jacobian_derivative(q, u), arm.pose_jacobian_derivative(q, u))
    check(theirs.translation_jacobian(jacobian, pose)[1:], arm.translation_jacobian(q))
    check(theirs.rotation_jacobian(jacobian), arm.rotation_jacobian(q))
    pairs = {
        "kinematics(q, out)": (
            lambda: arm.kinematics(q, out),
            lambda: (theirs.fkm(q), theirs.pose_jacobian(q)),
            "≤ 0.20",
        ),
        "fkm": (lambda: arm.fkm(q), lambda: theirs.fkm(q), "≤ 1.00"),
        "pose_jacobian": (lambda: arm.pose_jacobian(q), lambda: theirs.pose_jacobian(q), "≤ 1.00"),
        "translation_jacobian": (
            lambda: arm.translation_jacobian(q),
            lambda: theirs.translation_jacobian(theirs.pose_jacobian(q), theirs.fkm(q)),
            "≤ 1.00",
        ),
        "rotation_jacobian": (
            lambda: arm.rotation_jacobian(q),
            lambda: theirs.rotation_jacobian(theirs.pose_jacobian(q)),
            "≤ 1.00",
        ),
        "pose_jacobian_derivative": (
            lambda: arm.pose_jacobian_derivative(q, u),
            lambda: theirs.pose_jacobian_derivative(q, u),
            "≤ 1.00",
        ),
    }
    functions = {name: pair[0] for name, pair in pairs.items()}
    functions |= {f"their {name}": pair[1] for name, pair in pairs.items()}
    t = medians(functions, 3000, rounds)
    return [
        Ratio(name, t[name], "µs", "DQ Robotics, the same", t[f"their {name}"], pair[2])
        for name, pair in pairs.items()
    ]


def two_arms_against_dq_robotics(rounds: int) -> list[Ratio]:
    arms = dq_robotics_arm(), dq_robotics_arm()  # what takes them does not keep them
    ours, theirs = dqc.TwoArms(our_arm(), our_arm()), DQ_CooperativeDualTaskSpace(*arms)
    q = np.concatenate([Q, Q + 0.1])
    check(theirs.relative_pose_jacobian(q), ours.relative_pose_jacobian(q))
    check(dqr.vec8(theirs.absolute_pose(q)), ours.absolute_pose(q, sign=1))
    names = "relative_pose_jacobian", "absolute_pose_jacobian"  # theirs of the absolute pose is wrong
    functions = {name: partial(getattr(ours, name), q) for name in names}
    functions |= {f"their {name}": partial(getattr(theirs, name), q) for name in names}
    t = medians(functions, 3000, rounds)
    return [
        Ratio(f"TwoArms.{name}", t[name], "µs", "DQ Robotics, the same", t[f"their {name}"], "≤ 0.40")
        for name in names
    ]


def tree_against_pinocchio(rounds: int) -> list[Ratio]:
    """Time three tips of a humanoid: pose and twist Jacobian of each."""
    path = package_files("example-robot-data")[TALOS]
    robot, model = dqc.load_robot(path, tips="all"), pinocchio.buildModelFromUrdf(str(path))
    data, q = model.createData(), np.linspace(-0.3, 0.3, robot.configuration_size)
    their_q, columns = (
        pinocchio.neutral(model),
        [],
    )  # they give joints of grippers that follow others columns, too
    for value, name in zip(q, robot.joint_names, strict=True):
        columns.append(model.joints[model.getJointId(name)].idx_q)
        their_q[columns[-1]] = value
    frames = [model.getFrameId(tip) for tip in TIPS]

    def by_pinocchio() -> list[Any]:
        pinocchio.computeJointJacobians(model, data, their_q)
        found = []
        for frame in frames:
            pinocchio.updateFramePlacement(model, data, frame)
            found.append(pinocchio.getFrameJacobian(model, data, frame, pinocchio.WORLD))
        return found

    tips = [(robot.table_of(tip), robot.kinematics_of(tip, q)) for tip in TIPS]

    def ours() -> list[Any]:
        return [robot.kinematics_of(table, q, out) for table, out in tips]

    for theirs, found in zip(by_pinocchio(), ours(), strict=True):
        check(np.vstack([theirs[3:], theirs[:3]])[:, columns], found.twist_jacobian)
    t = medians({"ours": ours, "theirs": by_pinocchio}, 1000, rounds)
    what = f"tree of {robot.configuration_size} joints, 3 tips: poses and Jacobians"
    return [Ratio(what, t["ours"], "µs", "Pinocchio: the same frames", t["theirs"], "≤ 1.00")]


def check(theirs: Any, ours: Any) -> None:
    """Stop unless the results agree: what differs may not be timed."""
    difference = np.abs(np.asarray(theirs, dtype=np.float64) - ours).max()
    if not difference < 1e-9:
        raise SystemExit(f"results differ by {difference:g}")


def as_mjcf(arm: dqc.Robot, limited: bool = False) -> str:
    """Return the chain as bodies without shape: what MuJoCo needs for its kinematics."""
    text, closing, last = "", "", len(arm.chain) - 1
    for i, row in enumerate(arm.chain):
        place = "pos='{} {} {}' quat='{} {} {} {}'".format(*row[4:7], *row[:4])
        joint, name = "", "hand" if i == last else f"b{i}"
        if i < last:
            lower, upper = arm.limits.lower[i], arm.limits.upper[i]
            limits = f"limited='true' range='{lower} {upper}'" if limited else ""
            joint = f"<joint name='j{i}' axis='0 0 1' {limits}/>"
        text += f"<body name='{name}' {place}><inertial pos='0 0 0' mass='1' diaginertia='1 1 1'/>{joint}"
        closing += "</body>"
    return f"<mujoco><compiler angle='radian'/><worldbody>{text}{closing}</worldbody></mujoco>"


def ratios(short: bool) -> list[Ratio]:
    """Return all lines."""
    rounds = 3 if short else 15
    return (
        against_pinocchio_and_mujoco(rounds)
        + against_dq_robotics(rounds)
        + two_arms_against_dq_robotics(rounds)
        + tree_against_pinocchio(rounds)
    )

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from dqcontrol.errors import ShapeError, ValueRangeError
from dqcontrol.plants.compliant.controller_file import load_controllers
from dqcontrol.plants.compliant.elastic_model import (
    TICK,
    Actuation,
    elastic_model,
    steps_per_tick,
)
from dqcontrol.plants.mujoco.mujoco_model import mass_matrix
from dqcontrol.robots.files.load import load_robot
from dqcontrol.robots.limits import Inertia
from dqcontrol.robots.serial_arm import SerialArm

mujoco: Any = pytest.importorskip("mujoco")

SEED = 20260902
Q0 = {
    "meka-a2": np.array([0, np.pi / 5, 0, np.pi / 2, 0, np.pi / 5, 0]),
    "iiwa7": np.array([0, 0.6, 0, 1.6, 0, 0.6, 0]),
}


def parts(name, springs="default", **how):
    """Return robot, actuation, model and data of one of our arms."""
    robot = load_robot(name)
    file = load_controllers(robot)
    actuation = file.actuation(springs)
    hand = file.hand(how.pop("hand", False))
    model = elastic_model(robot, actuation, hand=hand, **how)
    return robot, actuation, model, mujoco.MjData(model)


def undamped(actuation):
    return Actuation(
        actuation.rotor_inertia,
        0 * actuation.friction,
        actuation.stiffness,
        0 * actuation.damping,
        0 * actuation.dry_friction,
    )


def pose_of_hand(data):
    r = np.empty(4)
    mujoco.mju_mat2Quat(r, data.site("hand").xmat)
    p = data.site("hand").xpos
    dual = 0.5 * np.concatenate([[-p @ r[1:]], r[0] * p + np.cross(p, r[1:])])
    return np.concatenate([r, dual])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "springs"), [("meka-a2", "default"), ("iiwa7", "default"), ("iiwa7", "elastic")]
)
def test_forward_kinematics_is_the_robots_own(name, springs):
    robot, _, model, data = parts(name, springs)
    for q in np.random.default_rng(SEED).uniform(-3, 3, (50, 7)):
        data.qpos[:7] = q
        mujoco.mj_kinematics(model, data)
        ours, theirs = robot.fkm(q), pose_of_hand(data)
        theirs *= np.sign(theirs[:4] @ ours[:4])
        assert np.abs(ours - theirs).max() < 1e-12


LINKS = {
    "meka-a2": [2.031, 0.566, 2.296, 0.223, 1.473, 0.241, 0.09],
    "iiwa7": [
        3.394011,
        4.031991,
        3.394011,
        4.031989,
        1.529239,
        2.403626,
        0.259474,
    ],  # 23.900 less the base's 4.855658
}
HANDS = {
    "H2R3": (0.838, [-0.00286004, 0.00206754, 0.06242752]),
    "ma17": (0.9, [-0.00286004, 0.00206754, 0.1]),
}


@pytest.mark.parametrize(
    ("name", "springs", "hand"),
    [
        ("meka-a2", "default", False),
        ("meka-a2", "default", "H2R3"),
        ("meka-a2", "default", "ma17"),
        ("iiwa7", "default", False),
        ("iiwa7", "elastic", False),
    ],
)
def test_mass_and_centre_are_those_of_the_data(name, springs, hand):
    robot, _, model, data = parts(name, springs, hand=hand)
    inertia = robot.inertia
    assert inertia is not None
    masses = [*LINKS[name], *([HANDS[hand][0]] if hand else [])]
    assert model.body_mass.sum() == pytest.approx(sum(masses), abs=1e-12)
    for q in np.random.default_rng(SEED).uniform(-1, 1, (5, 7)):
        data.qpos[:7] = q
        mujoco.mj_forward(model, data)
        centers = list(zip(inertia.center, robot.frames(q)[:-1], strict=True))
        if hand:
            centers.append((np.array(HANDS[hand][1]), robot.fkm(q)))
        moment = np.zeros(3)
        for mass, (center, x) in zip(masses, centers, strict=True):
            w, v, dw, dv = x[0], x[1:4], x[4], x[5:]
            p = 2 * (w * dv - dw * v - np.cross(dv, v))
            moment += mass * (p + center + 2 * np.cross(v, w * center + np.cross(v, center)))
        np.testing.assert_allclose(data.subtree_com[0], moment / sum(masses), atol=1e-11)


def test_links_have_the_inertia_matrix_of_the_rigid_arm_and_rotors_their_own():
    pinocchio: Any = pytest.importorskip("pinocchio")
    robot, actuation, model, data = parts("meka-a2")
    rigid = pinocchio.Model()
    parent, bodies = 0, robot.inertia
    assert bodies is not None
    for row, m, c, t in zip(robot.chain[:-1], bodies.mass, bodies.center, bodies.tensor, strict=True):
        place = pinocchio.SE3(pinocchio.Quaternion(*row[:4]).toRotationMatrix(), row[4:7])
        parent = rigid.addJoint(parent, pinocchio.JointModelRZ(), place, f"j{parent}")
        rigid.appendBodyToJoint(parent, pinocchio.Inertia(m, c, t), pinocchio.SE3.Identity())
    state = rigid.createData()
    for q in np.random.default_rng(SEED).uniform(-1, 1, (5, 7)):
        data.qpos[:7], data.qpos[7:] = q, np.random.default_rng(SEED).uniform(-1, 1, 7)
        mujoco.mj_forward(model, data)
        inertia = mass_matrix(model, data)
        upper = np.triu(pinocchio.crba(rigid, state, q))
        np.testing.assert_allclose(np.triu(inertia[:7, :7]), upper, atol=1e-10)
        np.testing.assert_allclose(inertia[7:, 7:], np.diag(actuation.rotor_inertia), atol=1e-10)
        assert (inertia[:7, 7:] == 0).all()


def test_springs_pull_rotors_and_links_together():
    _, actuation, model, data = parts("meka-a2", gravity=(0, 0, 0))
    stretch = np.random.default_rng(SEED).uniform(-0.1, 0.1, 7)
    data.qpos[7:] = stretch
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(data.qfrc_passive[:7], actuation.stiffness * stretch, rtol=1e-12)
    np.testing.assert_allclose(data.qfrc_passive[7:], -actuation.stiffness * stretch, rtol=1e-12)
    data.qpos[7:], data.qvel[7:] = 0, stretch
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(data.qfrc_passive[:7], actuation.damping * stretch, rtol=1e-12)


@pytest.mark.parametrize(
    ("name", "springs", "hand"),
    [
        ("meka-a2", "default", False),
        ("meka-a2", "default", True),
        ("meka-a2", "lower-bound", True),
        ("iiwa7", "default", False),
        ("iiwa7", "elastic", False),
    ],
)
def test_accurate_steps_keep_the_energy_of_free_undamped_motion(name, springs, hand):
    robot = load_robot(name)
    file = load_controllers(robot)
    actuation = undamped(file.actuation(springs))
    model = elastic_model(robot, actuation, hand=file.hand(hand), accurate=True, stops=False)
    model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    data = mujoco.MjData(model)
    data.qpos[:7] = Q0[name]
    data.qpos[7:] = Q0[name][actuation.elastic]
    mujoco.mj_forward(model, data)
    steps = steps_per_tick(mass_matrix(model, data), robot, actuation, True)
    model.opt.timestep = TICK / steps
    before, peak, drift = data.energy.sum(), 0.0, 0.0
    for _ in range(1000):
        mujoco.mj_step(model, data, 10 * steps)
        mujoco.mj_forward(model, data)
        peak = max(peak, data.energy[1])
        drift = max(drift, abs(data.energy.sum() - before))
    assert data.time == pytest.approx(10.0)
    assert peak > 1.0  # J
    assert drift < 1e-3 * peak


def test_stiff_springs_get_shorter_steps_and_too_stiff_ones_are_refused():
    robot, _, model, data = parts("meka-a2")
    actuation = load_controllers(robot).actuation("default")
    data.qpos[:7] = Q0["meka-a2"]
    mujoco.mj_forward(model, data)
    inertia = mass_matrix(model, data)
    fast = steps_per_tick(inertia, robot, actuation, False)
    stiff = replace(actuation, stiffness=16 * actuation.stiffness)
    assert steps_per_tick(inertia, robot, stiff, False) >= 3 * fast
    stiff.stiffness[6] = 1e6
    with pytest.raises(ValueRangeError, match=r"joint 7 'right_arm_j6' has 1e\+06 N·m/rad.*at most about"):
        steps_per_tick(inertia, robot, stiff, False)
    rigid = replace(actuation, stiffness=np.full(7, np.inf))
    assert steps_per_tick(inertia[:7, :7], robot, rigid, True) == 1


def test_sliding_joints_and_missing_inertias_are_named():
    five = [np.ones(1)] * 5
    inertia = Inertia(np.ones(1), np.zeros((1, 3)), np.eye(3)[None])
    fixed = [[1, 0, 0, 0, 0, 0, 0]] * 2
    with pytest.raises(ShapeError, match=r"crane has sliding ones; use mujoco"):
        elastic_model(SerialArm(fixed, ["prismatic"], inertia=inertia, name="crane"), Actuation(*five))
    with pytest.raises(ValueRangeError, match="odd has none"):
        elastic_model(SerialArm(fixed, ["revolute"], name="odd"), Actuation(*five))

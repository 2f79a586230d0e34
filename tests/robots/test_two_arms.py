"""Two arms as one: against finite differences, against products written out, and against DQ Robotics."""

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.errors import ShapeError, UnknownNameError, ValueRangeError
from dqcontrol.robots import PoseTask, SerialArm, TwoArms, WholeBody, load_robot

ROOTS = ("midpoint", "screw")
IIWA_DH = np.array(
    [
        np.zeros(7),
        [0.34, 0, 0.4, 0, 0.4, 0, 0.126],
        np.zeros(7),
        np.pi / 2 * np.array([-1, 1, 1, -1, -1, 1, 0]),
    ]
)
UR_DH = np.array(
    [
        np.zeros(6),
        [0.089, 0, 0, 0.109, 0.095, 0.082],
        [0, -0.425, -0.392, 0, 0, 0],
        np.pi / 2 * np.array([1, 0, 0, 1, -1, 0]),
    ]
)


def unit_pose(rng):
    r = rng.normal(size=4)
    return dqc.DualQuaternion.from_pose(r / np.linalg.norm(r), rng.uniform(-0.5, 0.5, 3))


def arms_of(left, right, seed=0):
    rng = np.random.default_rng(seed)
    return TwoArms(
        SerialArm.join([unit_pose(rng), load_robot(left)]),
        SerialArm.join([unit_pose(rng), load_robot(right)]),
    )


def differences(function, q, h=2e-3):
    """Return the Jacobians of a batch of configurations by central differences of sixth order."""
    steps = h * np.eye(q.shape[-1])
    at = [function(q[..., None, :] + k * steps) for k in (1, -1, 2, -2, 3, -3)]
    out = (45 * (at[0] - at[1]) - 9 * (at[2] - at[3]) + (at[4] - at[5])) / (60 * h)
    return np.swapaxes(out, -1, -2)


def worst_difference(arms, q, sign):
    """Return how far the three Jacobians are from finite differences."""
    many = np.broadcast_to(np.asarray(sign)[..., None], (*q.shape[:-1], arms.configuration_size))
    found = [np.abs(arms.relative_pose_jacobian(q) - differences(arms.relative_pose, q)).max()]
    for root in ROOTS:
        expected = differences(lambda rows, root=root: arms.absolute_pose(rows, root, many), q)
        found.append(np.abs(arms.absolute_pose_jacobian(q, root, sign) - expected).max())
    return max(found)


def configurations(arms, count, seed):
    lower, upper = np.maximum(arms.limits.lower, -3.0), np.minimum(arms.limits.upper, 3.0)
    return np.random.default_rng(seed).uniform(lower, upper, (count, len(lower)))


@pytest.mark.parametrize("count", [100, pytest.param(3400, marks=pytest.mark.slow, id="10000 pairs in all")])
@pytest.mark.parametrize(("left", "right"), [("panda", "panda"), ("panda", "ur5"), ("ur5", "ur5")])
def test_jacobians_against_finite_differences(left, right, count):
    arms = arms_of(left, right)
    q = configurations(arms, count, seed=1)
    real = arms.relative_pose(q)[..., 0]
    sign = np.where(np.arange(count) % 4, np.where(real >= 0, 1, -1), np.where(real >= -0.2, 1, -1))
    assert (sign * real < 0).any()  # the long way round
    assert worst_difference(arms, q, sign) < 1e-8


def test_jacobians_near_half_a_turn():
    rng = np.random.default_rng(3)
    panda = load_robot("panda")
    for off in (-0.3, -1e-3, -1e-9, 0.0, 1e-9, 1e-3, 0.3):
        q = configurations(TwoArms(panda, panda), 1, seed=4)[0]
        x1, x2 = (dqc.DualQuaternion(panda.fkm(part)) for part in (q[:7], q[7:]))
        axis = rng.normal(size=3)
        turn = dqc.DualQuaternion.from_axis_angle(axis / np.linalg.norm(axis), np.pi + off)
        arms = TwoArms(SerialArm.join([panda, x1.conj() * x2 * turn]), panda)
        r = arms.relative_pose(q)
        assert abs(abs(r[0]) - abs(np.sin(off / 2))) < 1e-12
        near = q + rng.normal(0, 1e-3, (20, 14))
        for sign in (1, -1):
            assert worst_difference(arms, near, np.full(20, sign)) < 1e-8


@pytest.mark.parametrize("root", ROOTS)
def test_absolute_pose_is_half_of_the_relative_one_away_from_both_hands(root):
    arms = arms_of("panda", "ur5")
    q = configurations(arms, 200, seed=5)
    x1, x2 = dqc.DualQuaternion(arms.left.fkm(q[:, :7])), dqc.DualQuaternion(arms.right.fkm(q[:, 7:]))
    xa = dqc.DualQuaternion(arms.absolute_pose(q, root))
    half = x2.conj() * xa
    square = half * half
    relative = x2.conj() * x1
    assert np.abs(relative.vec8 - arms.relative_pose(q)).max() < 1e-14
    sign = np.sign(relative.P[:, :1])
    assert np.abs(square.P - sign * relative.P).max() < 1e-14
    middle = (x1.translation + x2.translation) / 2
    if root == "midpoint":
        assert np.abs(xa.translation - middle).max() < 1e-14
    else:
        assert np.abs(square.vec8 - sign * relative.vec8).max() < 1e-13
        assert np.abs(xa.translation - middle).max() > 1e-2


def test_against_dq_robotics():
    modeling = pytest.importorskip("dqrobotics.robot_modeling")
    theirs = [modeling.DQ_SerialManipulatorDH(np.vstack([dh, 0 * dh[0]])) for dh in (IIWA_DH, UR_DH)]
    both = modeling.DQ_CooperativeDualTaskSpace(*theirs)
    arms = TwoArms(SerialArm.from_dh(*IIWA_DH), SerialArm.from_dh(*UR_DH))
    for q in np.random.default_rng(6).uniform(-2, 2, (30, 13)):
        assert np.abs(both.relative_pose(q).vec8() - arms.relative_pose(q)).max() < 1e-13
        assert np.abs(both.relative_pose_jacobian(q) - arms.relative_pose_jacobian(q)).max() < 1e-12
        # Its root takes the long way round where Re(r) < 0; its Jacobian of the absolute pose is wrong.
        assert np.abs(both.absolute_pose(q).vec8() - arms.absolute_pose(q, sign=1)).max() < 1e-12


def test_sign_has_hysteresis_and_the_absolute_pose_no_jump():
    stick = SerialArm.from_dh(theta=[0], d=[0], a=[1], alpha=[0])
    arms, sign, signs = TwoArms(stick, stick), 0, {}
    sweep = np.radians(np.concatenate([np.arange(0, 260), np.arange(260, 0, -1)]) + 0.5)
    poses = []
    for k, angle in enumerate(sweep):
        q = np.array([angle, 0.0])
        sign = arms.hands_sign(q, sign)
        signs[k] = sign
        poses.append(arms.absolute_pose(q, sign=sign))
    changes = [round(np.degrees(sweep[k])) for k in range(1, len(sweep)) if signs[k] != signs[k - 1]]
    assert changes == [204, 156]
    steps = np.abs(np.diff(poses, axis=0)).max(axis=1)
    assert (np.sort(steps)[:-2] < 0.02).all()
    jumps = [
        dqc.DualQuaternion(poses[k]).conj() * dqc.DualQuaternion(poses[k + 1]) for k in np.argsort(steps)[-2:]
    ]
    assert all(abs(jump.P[0]) < 0.01 for jump in jumps)  # by half a turn
    assert arms.hands_sign(np.zeros((4, 3, 2))).shape == (4, 3)


def test_batches_and_a_common_base():
    panda, ur5 = load_robot("panda"), load_robot("ur5")
    torso = SerialArm.from_dh([0, 0], [0.4, 0], [0, 0.1], [1.2, 0.3])
    arms = TwoArms(panda, ur5, base=torso)
    q = configurations(arms, 12, seed=7).reshape(3, 4, 15)
    left = SerialArm.join([torso, panda])
    assert np.abs(arms.fkm(q, frame="left") - left.fkm(q[..., :9])).max() < 1e-14
    twist = arms.twist_jacobian_of("left", q)
    assert np.abs(twist[..., :9] - left.twist_jacobian(q[..., :9])).max() < 1e-13
    assert (twist[..., 9:] == 0).all()
    relative = arms.relative_pose_jacobian(q)
    assert relative.shape == (3, 4, 8, 15)
    assert (relative[..., :2] == 0).all()  # a torso moves no hand relative to the other
    assert worst_difference(arms, q.reshape(12, 15), arms.hands_sign(q.reshape(12, 15))) < 1e-8
    for task in ("relative", "absolute", "left", "right"):
        chosen = arms.with_task(task)
        found = chosen.kinematics(q[0, 0])
        assert np.abs(found.pose - chosen.fkm(q[0, 0])).max() < 1e-15
        assert np.abs(found.pose_jacobian - differences(chosen.fkm, q[0, 0])).max() < 1e-8
        assert np.abs(chosen.hand_jacobian(q[0, 0])[:3] - found.twist_jacobian[:3]).max() == 0


def test_a_drive_with_two_arms():
    arm = SerialArm.from_dh([0, 0, 0], [0.2, 0, 0], [0, 0.3, 0.2], [1.57, 0, 0])
    drive = WholeBody([dqc.DifferentialDrive(0.05, 0.2), dqc.DualQuaternion.from_translation([0.1, 0, 0.3])])
    arms = TwoArms(arm, arm, base=drive)
    assert (arms.configuration_size, arms.input_size) == (9, 8)
    rng = np.random.default_rng(8)
    q, u = rng.uniform(-1, 1, 9), rng.uniform(-1, 1, 8)
    for task in ("left", "relative", "absolute"):
        chosen = arms.with_task(task)
        h = 1e-4
        rate = (chosen.fkm(chosen.integrate(q, u, h)) - chosen.fkm(chosen.integrate(q, u, -h))) / (2 * h)
        assert np.abs(chosen.pose_jacobian(q) @ u - rate).max() < 1e-7


def test_frames_of_all_joints():
    arms = arms_of("panda", "ur5")
    q = configurations(arms, 5, seed=9)
    frames = arms.frames(q)
    expected = np.concatenate(
        [arms.left.frames(q[:, :7])[:, :-1], arms.right.frames(q[:, 7:])[:, :-1]], axis=1
    )
    assert np.abs(frames[:, :13] - expected).max() < 1e-14
    assert arms.parents[:13].tolist() == [-1, *range(6), -1, *range(7, 12)]
    assert np.abs(frames[:, -1] - arms.fkm(q, frame="right")).max() < 1e-14


def test_what_is_wrong_is_named():
    stick = SerialArm.from_dh(theta=[0], d=[0], a=[1], alpha=[0])
    arms = TwoArms(stick, stick)
    with pytest.raises(ShapeError, match=r"q: expected shape \(…, 2\), got shape \(3,\)"):
        arms.relative_pose(np.zeros(3))
    with pytest.raises(ValueRangeError, match="q: must be finite"):
        arms.absolute_pose_jacobian(np.array([0, np.nan]))
    with pytest.raises(UnknownNameError, match="did you mean 'midpoint'"):
        arms.absolute_pose([0.0, 0.0], root="midpont")
    with pytest.raises(ValueRangeError, match="sign: must be 1 or -1, got 0"):
        arms.absolute_pose([0.0, 0.0], sign=0)
    with pytest.raises(ValueRangeError, match="both frames of the task are a full turn apart"):
        arms.absolute_pose(np.array([2 * np.pi, 0.0]), sign=1)
    with pytest.raises(UnknownNameError, match=r"frame: unknown name 'rihgt'; did you mean 'right'"):
        arms.with_task("rihgt")
    with pytest.raises(UnknownNameError, match="task: unknown name 'sum'"):
        TwoArms(stick, stick, task="sum")
    with pytest.raises(ShapeError, match="right: expected an arm or a whole body, got None"):
        TwoArms(stick, None)
    with pytest.raises(ShapeError, match="relative needs 2 frames, got left"):
        PoseTask("relative", ("left",))
    with pytest.raises(ShapeError, match="two different frames, got 'left' twice"):
        PoseTask("absolute", ("left", "left"))


@pytest.mark.parametrize("root", ROOTS)
def test_frames_alone_say_where_a_task_is(root):
    arms = arms_of("iiwa7", "ur5")
    rng = np.random.default_rng(3)
    for q in rng.uniform(-1.5, 1.5, (50, arms.configuration_size)):
        frames = {name: arms.fkm(q, name) for name in ("left", "right")}
        for task in (
            PoseTask("frame", ("right",)),
            PoseTask("relative", ("left", "right")),
            *(PoseTask("absolute", ("left", "right"), root, sign) for sign in (-1, 0, 1)),
        ):
            pose, wanted = task.of_frames(frames), arms.pose_of(task, q)
            np.testing.assert_allclose(pose * np.sign(pose @ wanted), wanted, atol=1e-9)
    for task in (PoseTask("center_of_mass", ()), PoseTask("frame", ("left",), point=(0.0, 0.0, 0.1))):
        with pytest.raises(ShapeError, match="do not say where"):
            task.of_frames(frames)

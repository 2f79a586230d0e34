"""Inverse kinematics: poses that can be reached, and what is said of those that cannot."""

import re

import numpy as np
import pytest
from pinocchio_oracle import ARMS

from dqcontrol import DualQuaternion
from dqcontrol.errors import ShapeError, ValueRangeError
from dqcontrol.robots import Limits, SerialArm, load_robot

SEED = 41


def within(arm, count, seed=SEED):
    return np.random.default_rng(seed).uniform(
        arm.limits.lower, arm.limits.upper, (count, len(arm.joint_names))
    )


def errors(arm, q, pose):
    """Return distance and angle between the hand at q and a pose, independently of the solver."""
    there, here = DualQuaternion(pose), DualQuaternion(arm.fkm(q))
    turn = (there.conj() * here).vec8[..., :4]
    angle = 2 * np.arctan2(np.linalg.norm(turn[..., 1:], axis=-1), np.abs(turn[..., 0]))
    return np.linalg.norm(there.translation - here.translation, axis=-1), angle


def inside(arm, q):
    return (q >= arm.limits.lower).all() and (q <= arm.limits.upper).all()


@pytest.mark.parametrize("name", ARMS)
def test_reachable_poses_are_reached_within_the_limits(name):
    arm = load_robot(name)
    poses = arm.fkm(within(arm, 300))
    found = arm.solve(poses)
    assert found.success.all()
    assert (found.reason == "").all()
    assert inside(arm, found.q)
    position, orientation = errors(arm, found.q, poses)
    assert position.max() <= 1.1e-6
    assert orientation.max() <= 1.1e-6
    np.testing.assert_allclose(found.position_error, position, atol=1e-12)
    np.testing.assert_allclose(found.orientation_error, orientation, atol=1e-12)


def test_chains_of_many_and_sliding_joints():
    rng = np.random.default_rng(SEED)
    for n, kinds in ((3, "ppp"), (6, "prprrr"), (12, "r" * 12)):
        theta, d = rng.uniform(-1, 1, (2, n))
        a, alpha = rng.uniform(-0.3, 0.3, n), rng.choice([-np.pi / 2, np.pi / 2], n)
        types = [{"r": "revolute", "p": "prismatic"}[kind] for kind in kinds]
        arm = SerialArm.from_dh(theta, d, a, alpha, types)
        poses = arm.fkm(rng.uniform(-0.9, 0.9, (50, n)))
        found = arm.solve(poses)
        assert found.success.all(), kinds
        assert max(part.max() for part in errors(arm, found.q, poses)) < 1.1e-6


def test_a_near_start_is_kept():
    arm = load_robot("iiwa7")
    for q in within(arm, 30):
        start = np.clip(q + 0.01, arm.limits.lower, arm.limits.upper)
        found = arm.solve(arm.fkm(q), start)
        assert found.success
        assert found.starts == 1
        assert np.abs(found.q - start).max() < 0.1


def test_single_starts_are_given_up_neither_early_nor_late_and_near_ones_take_newton_s_steps():
    """Without restarts: with a patience of 2 iterations 75 % succeed, with 100 times the damping near ones take 4.5."""
    arm, rng = load_robot("iiwa7"), np.random.default_rng(5)
    q, start = (rng.uniform(arm.limits.lower, arm.limits.upper, (300, 7)) for _ in range(2))
    far = arm.solve(arm.fkm(q), start, restarts=0)
    assert 0.79 < far.success.mean() < 1  # 0.82
    assert far.iterations[~far.success].mean() < 20  # 13.7
    near = np.clip(q + rng.normal(0, 0.1, q.shape), arm.limits.lower, arm.limits.upper)
    found = arm.solve(arm.fkm(q), near, restarts=0)
    assert found.success.all()
    assert found.iterations.mean() < 4  # 3.44


def test_the_other_sign_is_the_same_pose():
    arm = load_robot("ur5")
    pose = arm.fkm(within(arm, 1)[0])
    np.testing.assert_array_equal(arm.solve(pose).q, arm.solve(-pose).q)


def test_batch_equals_single_and_repeats():
    arm = load_robot("panda")
    poses = arm.fkm(within(arm, 12)).reshape(3, 4, 8)
    poses[1, 2] = DualQuaternion.from_translation([3.0, 0, 0]).vec8
    batch = arm.solve(poses)
    assert batch.q.shape == (3, 4, 7)
    for field in ("success", "position_error", "orientation_error", "iterations", "starts", "reason"):
        assert getattr(batch, field).shape == (3, 4)
    for index in np.ndindex(3, 4):
        single = arm.solve(DualQuaternion(poses[index]))
        np.testing.assert_array_equal(single.q, batch.q[index])
        assert single.reason == batch.reason[index]
        assert isinstance(single.success, bool)
        assert isinstance(single.starts, int)
    assert batch.success.sum() == 11
    assert arm.solve(np.empty((0, 8))).q.shape == (0, 7)


def test_starts_depend_on_the_seed_only():
    arm = load_robot("meka-a2")
    poses = arm.fkm(within(arm, 200))
    first, again, other = arm.solve(poses), arm.solve(poses), arm.solve(poses, seed=1)
    np.testing.assert_array_equal(first.q, again.q)
    several = first.starts > 1
    assert several.any()
    assert (first.q[several] != other.q[several]).any()
    np.testing.assert_array_equal(first.q[~several], other.q[~several])


def test_start_configurations_may_differ_within_a_batch():
    arm = load_robot("iiwa7")
    q = within(arm, 5)
    found = arm.solve(arm.fkm(q), q)
    np.testing.assert_array_equal(found.q, q)
    assert (found.iterations == 0).all()
    assert arm.solve(arm.fkm(q[0]), q).q.shape == (5, 7)


def test_only_position_or_only_orientation():
    arm = load_robot("ax18")
    target = DualQuaternion.from_translation([0.2, 0.1, 0.25])
    found = arm.solve(target, orientation_tolerance=np.inf)
    assert found.success
    position, orientation = errors(arm, found.q, target.vec8)
    assert position < 1.1e-6
    assert found.orientation_error == pytest.approx(orientation) != 0
    iiwa = load_robot("iiwa7")
    far = DualQuaternion.from_translation([9.0, 0, 0]) * DualQuaternion(iiwa.fkm([0.5] * 7))
    found = iiwa.solve(far, position_tolerance=np.inf)
    assert found.success
    assert errors(iiwa, found.q, far.vec8)[1] < 1.1e-6


def test_a_solution_counts_whatever_the_starts_before_it_missed():
    arm = load_robot("ur5")
    poses = arm.fkm(within(arm, 300))
    found = arm.solve(poses, position_tolerance=1e-2, orientation_tolerance=1e-9)
    assert found.success.all()
    position, orientation = errors(arm, found.q, poses)
    assert position.max() <= 1.01e-2
    assert orientation.max() <= 1.1e-9


def test_missing_distance():
    arm = SerialArm.from_dh([0, 0], [0, 0], [0.7, 0.4], [0, 0], name="planar")
    found = arm.solve(DualQuaternion.from_translation([1.35, 0, 0]))
    assert not found.success
    assert found.reason == "unreachable: the position is 0.25 m beyond the reach of planar"
    inner = arm.solve(DualQuaternion.from_translation([0.0, 0.1, 0]), orientation_tolerance=np.inf)
    assert inner.reason == "unreachable: the position is 0.2 m beyond the reach of planar"
    assert inner.position_error == pytest.approx(0.2, abs=1e-3)  # the search ends where it hardly improves


def test_missing_orientation():
    arm = load_robot("ax18")
    pose = DualQuaternion(arm.fkm([0.1, 0.2, 0.3, 0.4, 0.5])) * DualQuaternion.from_axis_angle([0, 1, 0], 0.2)
    found = arm.solve(pose)
    assert not found.success
    assert found.reason.startswith("unreachable: the position can be reached, but not with this orientation")
    assert "(an arm of 5 joints has few orientations anywhere)" in found.reason


def test_limits_that_forbid_a_pose_are_named():
    arm = load_robot("iiwa7")
    found = arm.solve(arm.fkm([0, 2.6, 0, 0.1, 0, 0, 0]))
    assert not found.success
    assert inside(arm, found.q)
    assert found.reason == "limits: the nearest solution found has joint_2 at 2.5 rad (upper limit 2.09)"
    rail = SerialArm.from_dh(
        [0.0],
        [0.0],
        [0.0],
        [0.0],
        ["prismatic"],
        limits=Limits(*np.array([[0.1], [0.5], [np.inf], [np.inf]])),
    )
    found = rail.solve(DualQuaternion.from_translation([0, 0, 0.05]))
    assert found.reason == "limits: the nearest solution found has joint_1 at 0.05 m (lower limit 0.1)"
    np.testing.assert_array_equal(found.q, [0.1])
    assert found.position_error == pytest.approx(0.05)
    found = rail.solve(DualQuaternion.from_translation([0, 0, 0.50004]))
    assert found.reason == "limits: the nearest solution found has joint_1 at 0.50004 m (upper limit 0.5)"


def test_a_pose_on_the_border_of_reach_is_reached():
    arm = load_robot("iiwa7")
    found = arm.solve(arm.fkm([0.1, 0.9, 0.3, 0, 0.3, 0, 0.2]), [0.3] * 7)  # stretched: singular
    assert found.success


@pytest.mark.parametrize(
    ("elbow", "text"),
    [
        (0.0, "singular: came within .* where the end effector's Jacobian has a singular value of"),
        (1.0, "tolerance: came within"),
    ],
)
def test_tolerances_that_numbers_cannot_meet(elbow, text):
    arm = load_robot("iiwa7")
    target = arm.fkm([0.1, 0.9, 0.3, elbow, 0.3, 0.4 * elbow, 0.2])
    found = arm.solve(target, [0.3] * 7, position_tolerance=1e-30, orientation_tolerance=1e-30, restarts=3)
    assert not found.success
    assert max(found.position_error, found.orientation_error) < 1e-9
    assert re.match(text, found.reason), found.reason


def test_a_start_beyond_the_limits_is_clamped():
    arm = load_robot("iiwa7")
    found = arm.solve(arm.fkm([0.3] * 7), [9.0] * 7)
    assert found.success
    assert inside(arm, found.q)


@pytest.mark.parametrize(
    ("arguments", "options", "error", "text"),
    [
        (([0.0] * 7,), {}, ShapeError, r"pose: expected shape \(…, 8\), got shape \(7,\)"),
        (("hand",), {}, ShapeError, "pose: expected real numbers, got 'hand'"),
        (
            ([2.0, 0, 0, 0, 0, 0, 0, 0],),
            {},
            ValueRangeError,
            r"pose: expected unit dual quaternions, got norm 2 \+ ε 0",
        ),
        (([1.0, 0, 0, 0, 0.5, 0, 0, 0],), {}, ValueRangeError, r"got norm 1 \+ ε 0.5"),
        (([np.nan] * 8,), {}, ValueRangeError, "pose: must be finite"),
        (([1.0, 0, 0, 0, 0, 0, 0, 0], np.zeros(6)), {}, ShapeError, r"start: expected shape \(…, 7\)"),
        (
            (np.eye(8)[[0, 0]], np.zeros((3, 7))),
            {},
            ShapeError,
            r"start: leading axes \(3,\) do not fit those of pose, \(2,\)",
        ),
        (
            ([1.0, 0, 0, 0, 0, 0, 0, 0],),
            {"position_tolerance": 0.0},
            ValueRangeError,
            "position_tolerance: must be > 0",
        ),
        (
            ([1.0, 0, 0, 0, 0, 0, 0, 0],),
            {"orientation_tolerance": np.nan},
            ValueRangeError,
            "orientation_tolerance: must be finite",
        ),
        (
            ([1.0, 0, 0, 0, 0, 0, 0, 0],),
            {"orientation_tolerance": np.inf, "position_tolerance": np.inf},
            ValueRangeError,
            "position_tolerance: must be finite if orientation_tolerance is inf",
        ),
        (
            ([1.0, 0, 0, 0, 0, 0, 0, 0],),
            {"restarts": -1},
            ValueRangeError,
            "restarts: must be a whole number ≥ 0, got -1",
        ),
        (
            ([1.0, 0, 0, 0, 0, 0, 0, 0],),
            {"seed": 0.5},
            ValueRangeError,
            "seed: must be a whole number ≥ 0, got 0.5",
        ),
    ],
)
def test_bad_arguments(arguments, options, error, text):
    with pytest.raises(error, match=text):
        load_robot("iiwa7").solve(*arguments, **options)


@pytest.mark.parametrize("far", [2e6, 1e200, 1e307])
def test_a_pose_farther_than_anything_is_refused(far):
    """Beyond 1e154 m squares overflow: what came back was memory that nobody had written."""
    arm = load_robot("iiwa7")
    pose = np.array([1.0, 0, 0, 0, 0, far / 2, 0, 0])
    for each in (pose, np.stack([pose, pose])):
        with pytest.raises(ValueRangeError, match="pose: must be within 1e"):
            arm.solve(each)

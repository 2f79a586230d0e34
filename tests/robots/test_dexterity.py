"""Manipulability, condition and singular directions."""

import numpy as np
import pytest

from dqcontrol.errors import ShapeError, ValueRangeError
from dqcontrol.robots import SerialArm, load_robot

RNG = np.random.default_rng(31)


def test_manipulability_is_the_root_of_the_determinant():
    arm = load_robot("iiwa7")
    q = RNG.uniform(-2, 2, (2, 5, 7))
    jacobian = arm.twist_jacobian(q)
    expected = np.sqrt(np.linalg.det(jacobian @ jacobian.swapaxes(-1, -2)))
    np.testing.assert_allclose(arm.manipulability(q), expected, rtol=1e-9)


def test_planar_arm_of_two_joints_in_closed_form():
    arm = SerialArm.from_dh([0, 0], [0, 0], [0.7, 0.4], [0, 0])
    for q in RNG.uniform(-3, 3, (10, 2)):
        # columns [z ; z × (p − oᵢ)]: JᵀJ has 1 + |p|², 1 + 0.4² and 1 + (p · p₂) with p₂ the second link
        second = 0.4 * np.array([np.cos(q.sum()), np.sin(q.sum())])
        hand = 0.7 * np.array([np.cos(q[0]), np.sin(q[0])]) + second
        gram = np.array([[1 + hand @ hand, 1 + hand @ second], [1 + hand @ second, 1 + 0.16]])
        assert arm.manipulability(q) == pytest.approx(np.sqrt(np.linalg.det(gram)), rel=1e-12)


def test_condition_number():
    arm = load_robot("panda")
    q = RNG.uniform(arm.limits.lower, arm.limits.upper, (4, 7))
    expected = [np.linalg.cond(jacobian) for jacobian in arm.hand_jacobian(q)]
    np.testing.assert_allclose(arm.condition_number(q), expected, rtol=1e-10)
    assert arm.condition_number(q[0]).shape == ()
    assert load_robot("iiwa7").condition_number(np.zeros(7)) > 1e12


def test_hand_jacobian_is_that_of_the_moving_point():
    arm = load_robot("ur5")
    q = RNG.uniform(-2, 2, (3, 6))
    np.testing.assert_allclose(arm.hand_jacobian(q)[..., 3:, :], arm.translation_jacobian(q), atol=1e-15)
    np.testing.assert_array_equal(arm.hand_jacobian(q)[..., :3, :], arm.twist_jacobian(q)[..., :3, :])


def test_a_stretched_arm_cannot_move_on():
    arm = load_robot("iiwa7")
    directions, values = arm.singular_directions(np.zeros(7))
    assert (values < 1e-12).all()
    assert np.abs(arm.hand_jacobian(np.zeros(7)).T @ directions.T).max() < 1e-12
    outwards = np.array([0, 0, 0, 0, 0, 1.0])
    np.testing.assert_allclose(directions.T @ (directions @ outwards), outwards, atol=1e-12)


def test_no_direction_is_singular_in_a_good_posture():
    arm = load_robot("iiwa7")
    directions, values = arm.singular_directions([0, 0.6, 0, 1.6, 0, 0.6, 0])
    assert directions.shape == (0, 6)
    assert values.shape == (0,)


def test_directions_come_smallest_first_and_are_unit():
    directions, values = load_robot("iiwa7").singular_directions(
        [0.2, 0.1, 0.3, 0.05, 0.1, 0.02, 0], threshold=1.0
    )
    assert len(values) >= 2
    assert (np.diff(values) >= 0).all()
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1)


def test_few_joints_leave_directions_everywhere():
    arm = load_robot("ax18")
    directions, values = arm.singular_directions([0.1, 0.5, 0.7, 0.3, 0.2])
    assert values[0] == 0
    np.testing.assert_allclose(arm.hand_jacobian([0.1, 0.5, 0.7, 0.3, 0.2]).T @ directions[0], 0, atol=1e-14)


def test_bad_arguments():
    arm = load_robot("iiwa7")
    with pytest.raises(ShapeError, match=r"q: expected one configuration, got shape \(2, 7\)"):
        arm.singular_directions(np.zeros((2, 7)))
    with pytest.raises(ValueRangeError, match="threshold: must be > 0, got 0"):
        arm.singular_directions(np.zeros(7), 0)
    with pytest.raises(ShapeError, match="q: expected shape"):
        arm.manipulability(np.zeros(6))

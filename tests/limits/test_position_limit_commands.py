"""Clamping and weighted least norm at single configurations, against their definitions in NumPy."""

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol import algebra
from dqcontrol.laws import HInfinity, PartialProportional, Proportional
from dqcontrol.limits import CommandLimits, ModifiedClamping, OriginalClamping, WeightedLeastNorm
from dqcontrol.robots import Limits

SEED = 20260803
T = 0.01
Q0 = np.array([0.3, 0.6, -0.2, 1.6, 0.4, 0.6, 0.1])
CLAMPINGS = {"modified": ModifiedClamping(), "original": OriginalClamping()}
LAWS = {"K": Proportional(gain=5.0), "HIR": HInfinity(orientation_gain=10.0, translation_gain=5.0)}


@pytest.fixture(scope="module")
def arm():
    return dqc.load_robot("iiwa7")


def situation(arm, law_name, q):
    """Return law and sample, and the matrix and vector that the law solves at q."""
    law, pose = LAWS[law_name], arm.fkm(Q0 + np.array([0.5, -0.4, 0.3, 0.6, -0.2, 0.4, 0.3]))
    sample = dqc.Sample(pose)
    x = arm.fkm(q)
    if law_name == "K":
        error = algebra.multiply(algebra.conjugate(x), pose)
        sign = np.sign(error[0])
        matrix = algebra.hamilton_minus(sign * pose) @ algebra.C8 @ arm.pose_jacobian(q)
        y = 5.0 * (np.eye(8)[0] - sign * error)
    else:
        relative = algebra.multiply(x, algebra.conjugate(pose))
        relative *= np.sign(relative[0])
        matrix = arm.twist_jacobian(q)
        y = np.r_[-10.0 * relative[1:4], -5.0 * algebra.translation(relative)]
    return law, sample, matrix, y


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("kind", CLAMPINGS)
def test_blocked_columns_leave_the_least_squares_of_the_others(arm, kind, name):
    q = Q0.copy()
    q[3] = arm.limits.upper[3] + (1e-9 if kind == "original" else 0)
    law, sample, matrix, y = situation(arm, name, q)
    free = np.linalg.pinv(matrix, 1e-9) @ y
    assert free[3] > 0.1, "or the joint would not be blocked"
    matrix[:, 3] = 0.0
    prepared = law.prepare(arm, None, T, CommandLimits(position=CLAMPINGS[kind]))
    u = prepared.command(q, sample, prepared.initial_state(q))
    assert u[3] == 0.0
    np.testing.assert_allclose(u, np.linalg.pinv(matrix, 1e-9) @ y, atol=1e-10)


def test_a_joint_pushed_out_by_the_second_answer_is_blocked_too():
    """A planar arm of three joints whose middle joint is at its limit: without it the last one would cross."""
    inf = np.full(3, np.inf)
    arm = dqc.SerialArm.from_dh([0, 0, 0], [0, 0, 0], [1, 1, 1], [0, 0, 0])
    rng, found = np.random.default_rng(SEED), 0
    for _ in range(400):
        q = rng.uniform(-1, 1, 3)
        jacobian = arm.translation_jacobian(q)[:2]
        y = rng.normal(size=2)
        first = np.linalg.pinv(jacobian) @ y
        without = jacobian.copy()
        without[:, 1] = 0
        second = np.linalg.pinv(without) @ y
        singular = np.linalg.svd(without, compute_uv=False)[1]
        if not (first[1] > 0 > first[2] and second[2] > 0 and singular > 0.05):
            continue
        found += 1
        upper = np.array([np.inf, q[1], q[2]])
        limited = dqc.SerialArm.from_dh(
            [0, 0, 0], [0, 0, 0], [1, 1, 1], [0, 0, 0], limits=Limits(-inf, upper, inf, inf)
        )
        goal = arm.fkm(q)
        goal[4:] += 0.5 * algebra.multiply(np.r_[0, y, 0, 0, 0, 0, 0], goal)[:4]
        law = PartialProportional(part="position", gain=1.0)
        prepared = law.prepare(limited, None, T, CommandLimits(position=ModifiedClamping()))
        u = prepared.command(q, dqc.Sample(goal), prepared.initial_state(q))
        without[:, 2] = 0
        assert (u[1:] == 0).all()
        np.testing.assert_allclose(u, np.linalg.pinv(without, 1e-9) @ y, atol=1e-9)
    assert found > 2


@pytest.mark.parametrize("name", LAWS)
def test_weighted_least_norm(arm, name):
    """On two samples: joints that go on towards a limit are weighted, those that turned back are not."""
    first = Q0 + np.array([0.9, 0.5, 1.0, 0.2, -1.2, 0.6, 1.5])
    moved = np.array([0.1, 0.05, -0.1, 0.05, 0.1, -0.1, 0.1])
    middle, half = (arm.limits.upper + arm.limits.lower) / 2, (arm.limits.upper - arm.limits.lower) / 2

    def criterion(q):
        return ((2 * half) ** 2 / (4 * (arm.limits.upper - q) * (q - arm.limits.lower))).sum()

    prepared = LAWS[name].prepare(arm, None, T, CommandLimits(position=WeightedLeastNorm()))
    state = prepared.initial_state(first)
    for q in (first, first + moved):
        _, sample, matrix, y = situation(arm, name, q)
        gradient = np.array([(criterion(q + h) - criterion(q - h)) / 2e-6 for h in 1e-6 * np.eye(7)])
        back = np.abs(q - middle) < np.abs(first - middle)
        weights = np.where(back, 1.0, 1 + np.abs(gradient))
        u = prepared.command(q, sample, state)
        root = np.diag(weights**-0.5)
        np.testing.assert_allclose(u, root @ np.linalg.pinv(matrix @ root, 1e-9) @ y, atol=1e-6)
    assert 1 <= back.sum() <= 6
    assert weights.max() > 2


def test_weighted_least_norm_keeps_the_task_and_spares_what_is_near_a_limit(arm):
    q = Q0.copy()
    q[2] = arm.limits.upper[2] - 0.05
    law, sample, matrix, y = situation(arm, "HIR", q)
    free = np.linalg.pinv(matrix) @ y
    prepared = law.prepare(arm, None, T, CommandLimits(position=WeightedLeastNorm()))
    u = prepared.command(q, sample, prepared.initial_state(q))
    np.testing.assert_allclose(matrix @ u, y, atol=1e-9)
    assert np.linalg.norm(u) > np.linalg.norm(free)
    assert abs(u[2]) < 0.1 * abs(free[2])

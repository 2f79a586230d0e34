"""The reduced gradient against its definition, and against the projection that it stands for."""

from itertools import pairwise

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol import laws
from dqcontrol.plants import Integrator
from dqcontrol_theses import variants

pytestmark = pytest.mark.usefixtures("without_growth")

T = 0.02
SEED = 11


@pytest.fixture(scope="module")
def arm():
    return dqc.load_robot("iiwa7")


def near(arm, rng):
    """Return a configuration away from singularities, and a goal near it."""
    q = np.array([0, 0.6, 0, 1.6, 0, 0.9, 0]) + rng.uniform(-0.4, 0.4, 7)
    return q, dqc.Sample(arm.fkm(q + rng.uniform(-0.2, 0.2, 7)))


def commands(robot, q, goal, null_space):
    found = [
        law(gain=2.0, null_space=null_space).command(robot, q, goal, T)
        for law in (variants.ReducedGradient, laws.Proportional)
    ]
    return found, robot.twist_jacobian(q)


def test_it_keeps_the_task_and_spends_the_freedom_along_the_gradient(arm):
    """J u = y, and where the task asks for nothing u = Z Zᵀ z: z projected, 1 + |A|² times as fast."""
    rng = np.random.default_rng(SEED)
    centring = laws.JointCentring(gain=1.0)
    for _ in range(20):
        q, goal = near(arm, rng)
        (reduced, projected), jacobian = commands(arm, q, goal, centring)
        np.testing.assert_allclose(jacobian @ reduced, jacobian @ projected, atol=1e-9)
        (reduced, projected), jacobian = commands(arm, q, dqc.Sample(arm.fkm(q)), centring)
        null = np.linalg.svd(jacobian)[2][-1] + 1e-12
        np.testing.assert_allclose(reduced, (reduced @ null) * null, atol=1e-9)
        factor = (reduced @ null) / (projected @ null)
        shares = 1 / null**2  # 1 + |A|² where input i is the one to spare
        assert np.abs(shares / factor - 1).min() < 1e-6
        assert 1 <= factor <= 4 * shares.min()  # pivots in use count double


def test_with_several_inputs_to_spare_it_is_the_definition():
    """A Panda on a drive: nine inputs, of which three are u_b, by NumPy."""
    body = dqc.WholeBody(
        [
            dqc.DifferentialDrive(0.1, 0.2),
            dqc.DualQuaternion.from_translation([0.1, 0, 0.4]),
            dqc.load_robot("panda"),
        ]
    )
    q = np.array([0, 0, 0, 0, -0.4, 0, -2, 0, 1.6, 0.8])
    law = variants.ReducedGradient(gain=2.0, null_space=laws.JointCentring(gain=1.0)).prepare(body, None, T)
    state, goal = law.initial_state(q), dqc.Sample(body.fkm(q + 0.1))
    u = law.command(q, goal, state)
    used = state[1:] == 1
    assert used.sum() == 6
    rest = variants.ReducedGradient(gain=2.0).command(body, q, goal, T)
    np.testing.assert_array_equal(rest[~used], 0)
    jacobian = body.twist_jacobian(q)
    share = np.linalg.solve(jacobian[:, used], jacobian[:, ~used])
    assert np.abs(share).max() < 20
    plain = laws.Proportional(gain=2.0, null_space=laws.JointCentring(gain=1.0))
    projected = plain.command(body, q, dqc.Sample(body.fkm(q)), T)  # (I − J⁺J) z, of the same Zᵀ as z
    free = projected[~used] - share.T @ projected[used]
    expected = rest.copy()
    expected[~used] += free
    expected[used] -= share @ free
    np.testing.assert_allclose(u, expected, atol=1e-8)


def test_both_descend_and_it_descends_faster(arm):
    """Joints' mean squared distance from their middles, hand at rest, the same α."""
    q = np.array([0.8, 0.6, 0.9, 1.6, -0.7, 0.9, 0])
    goal, middle = dqc.references.SetPoint(arm.fkm(q)), (arm.limits.lower + arm.limits.upper) / 2
    width = arm.limits.upper - arm.limits.lower
    left = []
    for law in (variants.ReducedGradient, laws.Proportional):
        law = law(gain=5.0, null_space=laws.JointCentring(gain=1.0))
        run = dqc.simulate(arm, goal, law, Integrator(), q, T, 1.0)
        assert run.error.max() < 1e-3
        left.append(float(((2 * (run.q - middle) / width) ** 2).mean(axis=1)[-1]))
    start = float(((2 * (q - middle) / width) ** 2).mean())
    assert left[0] < left[1] < start


def test_the_partition_is_kept_until_another_is_clearly_better(arm):
    q = np.array([0, 0.6, 0, 1.6, 0, 0.9, 0])
    goal = dqc.references.SetPoint(arm.fkm(q + 0.3))
    law = variants.ReducedGradient(gain=1.0)
    prepared, samples = law.prepare(arm, None, T), goal.samples(np.arange(200) * T)
    state, used = prepared.initial_state(q), []
    for row in samples:
        q = arm.integrate(q, prepared.command(q, dqc.Sample(row[:8]), state), T)
        used.append(tuple(state[1:]))
    changes = sum(a != b for a, b in pairwise(used))
    assert changes <= 2

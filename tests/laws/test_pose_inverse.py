"""The damped inverse of eight rows against S17's (4.19) and (4.46) as they are printed, in NumPy."""

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol import algebra
from dqcontrol.errors import ShapeError, ValueRangeError
from dqcontrol.laws import DampedInverse, DampedPoseInverse, FeedbackLinearization, HInfinity, Proportional
from dqcontrol_theses.variants import Cascade, ClassicWholeBody, PublishedLinearization

SEED, T, LEVELS = 20171201, 0.05, (0.02, 0.1)
PURE = np.zeros((8, 6))
PURE[1:4, :3] = PURE[5:8, 3:] = np.eye(3)


def damped(matrix, level):
    """Return Jᵀ(JJᵀ + λ²I)⁻¹ of eight rows, as printed below (4.19)."""
    return matrix.T @ np.linalg.inv(matrix @ matrix.T + level**2 * np.eye(8))


def feasible(robot, q, rates):
    """Return v, ω and the joints' rates of [ẋ ẏ φ̇ θ̇]: C⁻¹B of (4.24)."""
    if not len(robot.drives) or robot.form == "unconstrained":
        return rates
    d, c, s = robot.drives[0][1], np.cos(q[2]), np.sin(q[2])
    rest = np.array([[1, 0, -d * s], [0, 1, d * c]]) @ rates[:3]
    return np.r_[np.linalg.inv([[c, -d * s], [s, d * c]]) @ rest, rates[3:]]


def free(robot):
    return robot.in_form("unconstrained") if len(robot.drives) else robot


ROBOTS = {
    "arm of 5": lambda: dqc.load_robot("ax18"),
    "arm of 7": lambda: dqc.load_robot("iiwa7"),
    "little-john": lambda: dqc.load_robot("little-john"),
    "unconstrained": lambda: dqc.load_robot("little-john").in_form("unconstrained"),
}


def states(robot, number=10):
    """Return random configurations, the base up to five metres from the origin, and goals beside them."""
    rng = np.random.default_rng(SEED)
    n = robot.configuration_size
    for _ in range(number):
        q = rng.uniform(-1.2, 1.2, n)
        if len(robot.drives):
            q[:2] = rng.uniform(-5, 5, 2)
        yield q, robot.fkm(q + rng.uniform(-0.5, 0.5, n))


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("name", ROBOTS)
def test_feedback_linearisation_is_as_printed(name, level):
    """u = F J⁺ vec8(½ x u_ξ), u_ξ = T U + 2 x* J q̇ with the q̇ that was asked for. [S17 4.14–4.27]"""
    robot = ROBOTS[name]()
    stiffness, damping = 0.6, 0.5
    law = PublishedLinearization(
        stiffness=stiffness,
        damping=damping,
        inverse=DampedPoseInverse(damping=level),
    ).prepare(robot, None, T)
    for q, goal in states(robot):
        state, rates = law.initial_state(q), np.zeros(q.size)
        for _ in range(3):
            x, jacobian = robot.fkm(q), free(robot).pose_jacobian(q)
            error = algebra.short(algebra.multiply(algebra.conjugate(goal), x))
            twist = (2 * algebra.multiply(algebra.conjugate(x), jacobian @ rates))[[1, 2, 3, 5, 6, 7]]
            wanted = twist - T * (0.5 * stiffness * algebra.log_body(error) + damping * twist)
            rates = damped(jacobian, level) @ algebra.multiply(0.5 * x, PURE @ wanted)
            expected = feasible(robot, q, rates)
            np.testing.assert_allclose(law.command(q, dqc.Sample(goal), state), expected, rtol=0, atol=1e-12)
            q = robot.integrate(q, expected, T)


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("name", ROBOTS)
def test_the_classic_law_is_as_printed(name, level):
    """u = F N⁺ K vec8(1 − x*x_d), N = H⁻(x_d) C8 J. [S17 4.46]"""
    robot = ROBOTS[name]()
    gain = np.linspace(0.3, 1.0, 8)
    law = ClassicWholeBody(gain=gain.tolist(), inverse=DampedPoseInverse(damping=level))
    for q, goal in states(robot):
        x = robot.fkm(q)
        error = algebra.multiply(algebra.conjugate(x), goal)
        sign = np.sign(error[0])
        matrix = algebra.hamilton_minus(sign * goal) @ algebra.C8 @ free(robot).pose_jacobian(q)
        rates = damped(matrix, level) @ (gain * (np.eye(8)[0] - sign * error))
        np.testing.assert_allclose(
            law.command(robot, q, dqc.Sample(goal), T), feasible(robot, q, rates), rtol=0, atol=1e-12
        )


def test_near_the_goal_it_is_damping_of_twice_that_at_the_hand():
    """N weighs the goal's own frame: ¼ |[ω ; ṗ]|², wherever the base frame is."""
    robot = dqc.load_robot("iiwa7")
    for q, _ in states(robot, 3):
        near = dqc.Sample(robot.fkm(q + 1e-9))
        one, other = (
            ClassicWholeBody(gain=1e6, inverse=inverse).command(robot, q, near, T)
            for inverse in (
                DampedPoseInverse(damping=0.05),
                DampedInverse(damping=0.1, characteristic_length=1.0),
            )
        )
        np.testing.assert_allclose(one, other, rtol=1e-6)


def test_it_depends_on_where_the_base_frame_is():
    robot = dqc.load_robot("little-john")
    q = np.array([0, 0, 0, 0.3, -0.9, 0.9, 0.9, 0])
    law = FeedbackLinearization(
        stiffness=0.6, damping=0.5, null_space=None, inverse=DampedPoseInverse(damping=0.05)
    )
    here, there = (
        law.command(robot, q + shift, dqc.Sample(robot.fkm(q + shift + [0.3, 0.2, 0, 0, 0, 0, 0, 0])), T)
        for shift in (np.zeros(8), np.r_[10.0, np.zeros(7)])
    )
    assert np.abs(here - there).max() > 0.01 * np.abs(here).max()


def test_interpreted_and_compiled_are_equal():
    robot = dqc.load_robot("little-john")
    q = np.array([0, 0, 0, 0, -0.9, 0.9, 0.9, 0])
    goal = dqc.references.SetPoint(robot.fkm(q + np.array([0.3, 0.1, 0.2, 0, 0.1, 0, 0, 0])))
    inverse = DampedPoseInverse(damping=0.05)
    for law in (
        FeedbackLinearization(stiffness=1.0, damping=1.0, inverse=inverse),
        Cascade(stiffness=1.0, damping=1.0, inverse=inverse),
        ClassicWholeBody(gain=0.5, inverse=inverse),
    ):
        compiled, interpreted = (
            dqc.simulate(robot, goal, law, dqc.plants.Integrator(), q, T, duration=2.0, interpreted=how)
            for how in (False, True)
        )
        np.testing.assert_array_equal(compiled.q, interpreted.q)


@pytest.mark.parametrize(
    ("law", "gains"),
    [(Proportional, {"gain": 1.0}), (HInfinity, {"orientation_gain": 1.0, "translation_gain": 1.0})],
)
def test_other_laws_refuse_it(law, gains):
    with pytest.raises(ShapeError, match=r"inverse: expected .*, got DampedPoseInverse"):
        law(**gains, inverse=DampedPoseInverse(damping=0.1))


def test_bad_damping():
    with pytest.raises(ValueRangeError, match=r"inverse.damping: must be > 0"):
        DampedPoseInverse(damping=0.0)

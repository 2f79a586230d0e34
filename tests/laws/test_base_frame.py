"""Commands do not depend on where the base frame is, also where rank is lost or the goal cannot be reached."""

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol import algebra, laws
from dqcontrol.limits import CommandLimits, ModifiedClamping
from dqcontrol.references import Sample
from dqcontrol.robots.limits import symmetric_limits

T, SEED = 0.01, 20261122
DAMPED = laws.DampedInverse(damping=0.05)
GAINS = {"orientation_gain": 10.0, "translation_gain": 5.0, "form": "left"}
LAWS = {
    "K": laws.Proportional(gain=5.0),
    "K, damped": laws.Proportional(gain=5.0, inverse=DAMPED),
    "K+FF": laws.ProportionalFeedforward(gain=5.0, integral_gain=5.0),
    "decoupled": laws.DecoupledProportional(gain=5.0),
    "position": laws.PartialProportional(part="position", gain=5.0),
    "rotation": laws.PartialProportional(part="rotation", gain=5.0),
    "axis": laws.PartialProportional(part="axis", gain=5.0),
    "HIR, left": laws.HInfinity(**GAINS),
    "HIRT, left": laws.HInfinityTracking(**GAINS),
    "HIR, left, damped": laws.HInfinity(**GAINS, inverse=DAMPED),
    "LQR-R8": laws.LinearQuadraticR8(error_weight=25.0, control_weight=1.0),
    "LQR-DQ, left": laws.LinearQuadraticDQ(error_weight=25.0, control_weight=1.0, error="left"),
    "feedback linearisation": laws.FeedbackLinearization(stiffness=4.0, damping=4.0),
}


HALF = np.pi / 2
SHAPES = {  # d, a, α
    7: ([0.34, 0, 0.4, 0, 0.4, 0, 0.126], [0] * 7, [-HALF, HALF, HALF, -HALF, -HALF, HALF, 0]),
    6: ([0.089, 0, 0, 0.109, 0.095, 0.082], [0, -0.425, -0.392, 0, 0, 0], [HALF, 0, 0, HALF, -HALF, 0]),
    5: ([0.089, 0, 0, 0.109, 0.095], [0, -0.425, -0.392, 0, 0], [HALF, 0, 0, HALF, -HALF]),
}


def standing(n, base):
    """Return an arm of n joints whose base is somewhere."""
    d, a, alpha = SHAPES[n]
    limits = symmetric_limits(np.full(n, 2.9), np.full(n, 2.0), np.full(n, np.inf))
    return dqc.SerialArm.from_dh([0] * n, d, a, alpha, base=base, limits=limits)


@pytest.mark.parametrize("n", list(SHAPES))
@pytest.mark.parametrize("name", LAWS)
def test_moving_the_base_and_the_goal_moves_no_joint(n, name):
    rng, origin = np.random.default_rng(SEED), np.eye(8)[0]
    arm = standing(n, origin)
    stretched = np.zeros(n)  # rank is lost there
    for q in (stretched, rng.uniform(-1, 1, n)):
        goal = algebra.multiply(arm.fkm(q), algebra.exp_screw(rng.uniform(-1, 1, 6)))  # mostly out of reach
        twist = rng.normal(size=6)
        base = algebra.pose(algebra.exp_screw(rng.uniform(-1, 1, 6))[:4], [5.0, -4.0, 1.0])
        limits = CommandLimits(position=ModifiedClamping(tolerance=0.5))
        commands = []
        for robot, desired, motion in (
            (arm, goal, twist),
            (standing(n, base), algebra.multiply(base, goal), algebra.adjoint_twist(base, twist)),
        ):
            prepared = LAWS[name].prepare(robot, None, T, limits)
            state = prepared.initial_state(q)
            prepared.command(q, Sample(desired, motion), state)
            commands.append(prepared.command(q, Sample(desired, motion), state).copy())
        np.testing.assert_allclose(
            commands[1], commands[0], rtol=0, atol=1e-9 * (1 + np.abs(commands[0]).max())
        )


@pytest.mark.parametrize(
    "law",
    [LAWS["K"], LAWS["HIR, left"], LAWS["LQR-DQ, left"], LAWS["decoupled"], LAWS["LQR-R8"]],
    ids=["K", "HIR", "LQR-DQ", "decoupled", "LQR-R8"],
)
def test_a_gantry_reaches_the_position_under_an_orientation_that_it_cannot_have(law):
    """Three sliding joints far from the origin, a goal turned by 60°: HIR's left form rested 4.25 m off, LQR-DQ 6 m."""
    gantry = dqc.SerialArm.from_dh(
        [0, HALF, 0], [0, 0, 0], [0, 0, 0], [-HALF, -HALF, 0], joint_types=["prismatic"] * 3,
    )  # fmt: skip
    q = np.array([4.0, -4.0, 1.0])
    here = gantry.fkm(q)
    turn = algebra.pose([np.cos(np.pi / 6), 0, 0, np.sin(np.pi / 6)], [0, 0, 0])
    goal = algebra.multiply(here, turn)
    goal = algebra.pose(goal[:4], algebra.translation(here) + np.array([0.3, 0.2, -0.1]))
    record = dqc.simulate(gantry, dqc.references.SetPoint(goal), law, dqc.plants.Integrator(), q, T, 4.0)
    assert record.position_error[-1] < 1e-3


def test_a_radian_counts_as_much_as_the_characteristic_length():
    """A hand that one joint turns and carries rests where |[ℓθ ; p]| is least, for all laws of the whole pose."""
    arm = dqc.SerialArm.from_dh([0], [0], [0.5], [0])
    goal = algebra.multiply(arm.fkm([0.4]), algebra.pose([1, 0, 0, 0], [0.0, 0.0, 0.0]))
    goal = algebra.multiply(
        goal, algebra.pose([np.cos(0.1), 0, 0, np.sin(0.1)], [0, 0, 0])
    )  # turned by 0.2 more
    for length in (0.1, 0.3, 1.0):
        inverse = laws.FilteredInverse(characteristic_length=length)
        for law in (laws.Proportional(gain=5.0, inverse=inverse), laws.HInfinity(**GAINS, inverse=inverse)):
            record = dqc.simulate(
                arm, dqc.references.SetPoint(goal), law, dqc.plants.Integrator(), [0.0], T, 8.0
            )
            angle = 0.2 * length**2 / (length**2 + 0.25)  # of 0.2
            assert record.q[-1, 0] - 0.4 == pytest.approx(angle, abs=2e-3)

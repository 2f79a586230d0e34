"""Feedback linearisation against its definition, its closed forms and its limits."""

import numpy as np
import pytest
from body_twists import body_jacobian, wanted_twist
from scipy.integrate import solve_ivp

import dqcontrol as dqc
from dqcontrol import algebra
from dqcontrol.errors import Error
from dqcontrol.laws import FeedbackLinearization
from dqcontrol.plants import Integrator
from dqcontrol.robots import SerialArm
from dqcontrol_theses.variants import ClassicWholeBody

pytestmark = pytest.mark.usefixtures("without_growth")

SEED = 20170401
T = 0.05


def holonomic(arm="iiwa7"):
    return dqc.WholeBody([dqc.robots.HolonomicBase(), dqc.load_robot(arm)])


ROBOTS = {
    "arm of 7": lambda: dqc.load_robot("iiwa7"),
    "arm of 5": lambda: dqc.load_robot("ax18"),
    "little-john": lambda: dqc.load_robot("little-john"),
    "youbot": lambda: dqc.load_robot("youbot"),
    "holonomic": holonomic,
    "unconstrained": lambda: dqc.load_robot("little-john").in_form("unconstrained"),
    "base on an arm": lambda: dqc.WholeBody(
        [dqc.load_robot("ur5"), dqc.DifferentialDrive(0.05, 0.1), dqc.load_robot("ax18")]
    ),
}


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("sign", [1, -1])
def test_command_is_the_definition(name, sign):
    robot, rng = ROBOTS[name](), np.random.default_rng([SEED, len(name)])
    n, stiffness, damping = robot.configuration_size, 0.8, 1.3
    law = FeedbackLinearization(stiffness=stiffness, damping=damping, null_space=None).prepare(robot, None, T)
    q = rng.uniform(0.2, 0.9, n)
    state, twist = law.initial_state(q), np.zeros(6)
    for _ in range(4):
        q = q + 0.1 * rng.standard_normal(n)
        sample = dqc.Sample(
            sign * robot.fkm(q + 0.3 * rng.standard_normal(n)),
            rng.standard_normal(6),
            rng.standard_normal(6),
        )
        jacobian = body_jacobian(robot, q)
        u = law.command(q, sample, state)
        wanted = wanted_twist(robot, q, sample, twist, stiffness, damping, T)
        np.testing.assert_allclose(u, np.linalg.pinv(jacobian) @ wanted, atol=1e-9)  # in V's own measure
        twist = jacobian @ u


def turning():
    """Return one revolute joint with the hand on its axis."""
    return SerialArm.from_dh([0], [0.2], [0], [0])


@pytest.mark.parametrize("damping", [0.5, 1.2, 3.0])
@pytest.mark.parametrize("joint", ["slide", "turn"])
def test_fixed_axis_is_a_damped_spring(joint, damping, slide):
    """θ̈ + k_v θ̇ + k̄/4 θ = 0, against the differential equation."""
    arm, stiffness, period = slide if joint == "slide" else turning(), 1.44, 1e-3
    law = FeedbackLinearization(stiffness=stiffness, damping=damping)
    start = 0.9
    record = dqc.simulate(
        arm, dqc.references.SetPoint(arm.fkm([0.0])), law, Integrator(), [start], period, duration=6.0
    )
    truth = solve_ivp(
        lambda _, y: [y[1], -damping * y[1] - stiffness / 4 * y[0]],
        (0, 6.0),
        [start, 0.0],
        t_eval=record.time,
        rtol=1e-10,
        atol=1e-12,
    )
    np.testing.assert_allclose(record.q[:, 0], truth.y[0], atol=5e-4)  # first order in T


@pytest.mark.parametrize(("product", "factor"), [(0.3, 0.97), (0.3, 1.03), (1.5, 0.97), (1.5, 1.03)])
def test_stability_limit_of_the_stiffness(slide, product, factor):
    """(k̄/4) T² < 4 − 2 k_v T."""
    stiffness = factor * 4 * (4 - 2 * product) / T**2
    law = FeedbackLinearization(stiffness=stiffness, damping=product / T)
    record = dqc.simulate(
        slide, dqc.references.SetPoint(slide.fkm([0.0])), law, Integrator(), [1e-3], T, duration=400 * T
    )
    assert (np.abs(record.q[-50:]).max() < 1e-3) == (factor < 1)


@pytest.mark.parametrize("factor", [0.97, 1.03])
def test_stability_limit_of_the_damping(slide, factor):
    """k_v T < 2, with next to no stiffness."""
    law = FeedbackLinearization(stiffness=1e-6, damping=factor * 2 / T)
    moving = dqc.references.ViaPoints(
        [0, 100 * T], slide.fkm([[0.0], [1.0]])
    )  # jumps to a speed, to be caught up
    record = dqc.simulate(slide, moving, law, Integrator(), [0.0], T, duration=99 * T)
    wrong = np.abs(np.diff(record.command[:, 0]))
    assert (wrong[-5:].max() < wrong[:5].max()) == (factor < 1)


def test_ratio_of_the_gain_is_one_half():
    """A₁/A₂ = ⟨L, L̇⟩/⟨L, ξ̃⟩ = 1/2 for the body logarithm, L̇ by finite differences along dx̃/dt = ½x̃ξ̃."""
    rng, h = np.random.default_rng([SEED, 2]), 1e-5
    for _ in range(200):
        x = algebra.exp_screw(rng.uniform(-0.8, 0.8, 6))
        twist = rng.standard_normal(6)
        ahead, behind = (algebra.multiply(x, algebra.exp_screw(s * h * twist / 2)) for s in (1, -1))
        log = algebra.log_body(x)
        rate = (algebra.log_body(ahead) - algebra.log_body(behind)) / (2 * h)
        assert log @ rate == pytest.approx(0.5 * log @ twist, abs=1e-9)


@pytest.mark.slow
def test_lyapunov_function_falls():
    """V̇ = −2 k_v |ξ̃|²."""
    arm, rng, period = dqc.load_robot("iiwa7"), np.random.default_rng([SEED, 3]), 1e-3
    stiffness, damping = 3.0, 2.0
    law = FeedbackLinearization(stiffness=stiffness, damping=damping)
    for _ in range(8):
        q = np.array([0, 0.7, 0, 1.5, 0, 0.7, 0]) + rng.uniform(-0.3, 0.3, 7)
        target = dqc.references.SetPoint(arm.fkm(q + rng.uniform(-0.4, 0.4, 7)))
        record = dqc.simulate(arm, target, law, Integrator(), q, period, duration=1.5)
        error = algebra.short(algebra.multiply(algebra.conjugate(record.desired_pose), record.pose))
        log = algebra.log_body(error)
        twist = np.stack(
            [body_jacobian(arm, p) @ u for p, u in zip(record.q, record.command, strict=True)][:-1]
        )
        twist = np.vstack([np.zeros(6), twist])
        kinetic = (twist**2).sum(axis=1)
        value = kinetic + stiffness * (log**2).sum(axis=1)
        rate = np.diff(value) / period
        np.testing.assert_allclose(rate, -2 * damping * kinetic[:-1], atol=0.02 * value[0])


def test_moving_targets_are_followed_without_lag():
    arm = dqc.load_robot("iiwa7")
    q = np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])
    turns = q + np.array([0, 1, -1, 0.5])[:, None] * np.array([0.2, 0.15, -0.2, 0.1, 0.2, -0.3, 0.4])
    path = dqc.references.StartRamp(dqc.references.ViaPoints([0, 1.5, 3.0, 4.5], arm.fkm(turns)), 1.0)
    law = FeedbackLinearization(stiffness=16.0, damping=4.0)
    errors = [dqc.simulate(arm, path, law, Integrator(), q, period).error.max() for period in (0.01, 0.005)]
    assert errors[0] < 4e-3
    assert errors[1] == pytest.approx(errors[0] / 2, rel=0.05), "first order in T"


def test_first_command_is_a_tenth_of_the_classic_one():
    robot, rng = dqc.load_robot("little-john"), np.random.default_rng([SEED, 4])
    q = np.array([0, 0, 0, 0, -0.9, 0.9, 0.9, 0])
    for _ in range(20):
        goal = dqc.Sample(
            robot.fkm(q + np.r_[rng.uniform(-0.5, 0.5, 2), rng.uniform(-0.7, 0.7), np.zeros(5)])
        )
        smooth = FeedbackLinearization(stiffness=0.6, damping=0.5).command(robot, q, goal, T)
        classic = ClassicWholeBody(gain=0.5).command(robot, q, goal, T)
        assert np.linalg.norm(robot.wheel_speeds(smooth)) <= 0.1 * np.linalg.norm(robot.wheel_speeds(classic))


def test_interpreted_and_compiled_are_equal():
    robot = dqc.load_robot("little-john")
    q = np.array([0, 0, 0, 0, -0.9, 0.9, 0.9, 0])
    goal = dqc.references.SetPoint(robot.fkm(q + np.array([0.3, 0.1, 0.2, 0, 0.1, 0, 0, 0])))
    for law in (FeedbackLinearization(stiffness=1.0, damping=1.0), ClassicWholeBody(gain=0.5)):
        compiled, interpreted = (
            dqc.simulate(robot, goal, law, Integrator(), q, T, duration=5.0, interpreted=how)
            for how in (False, True)
        )
        np.testing.assert_array_equal(compiled.q, interpreted.q)


def test_blocked_joints_are_forgotten():
    """A joint at its limit is not remembered as moving, and comes back when the goal does. [S17 5.2.3]"""
    arm = dqc.load_robot("iiwa7")
    q, beyond = np.array([0, 0.6, 0, 1.6, 0, 0.6, 0]), np.array([0, 0.6, 0, 2.5, 0, 0.6, 0])
    limits = dqc.limits.CommandLimits(position=dqc.limits.ModifiedClamping())
    law = FeedbackLinearization(stiffness=4.0, damping=2.0).prepare(arm, None, 0.01, limits)
    state = law.initial_state(q)
    for goal, seconds in ((beyond, 8.0), (q, 16.0)):
        sample, highest = dqc.Sample(arm.fkm(goal)), -np.inf
        for _ in range(round(seconds / 0.01)):
            q = q + 0.01 * law.command(q, sample, state)
            highest = max(highest, q[3])
        assert highest <= arm.limits.upper[3]
    np.testing.assert_allclose(arm.fkm(q), sample.pose, atol=1e-5)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"stiffness": 0.0}, "stiffness: must be > 0, got 0"),
        ({"damping": -1.0}, "damping: must be > 0, got -1"),
        ({"damping": float("nan")}, "damping: must be finite"),
        ({"hysteresis": 1.0}, "hysteresis: must be < 1, got 1"),
    ],
)
def test_bad_parameters(changes, message):
    with pytest.raises(Error, match=message):
        FeedbackLinearization(**{"stiffness": 1.0, "damping": 1.0} | changes)

"""The cascade against its equations, and against the law that replaced it."""

import math

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol import algebra
from dqcontrol.errors import Error
from dqcontrol.plants import Integrator
from dqcontrol_theses.variants import Cascade, ClassicCascade, ClassicProportional, PublishedLinearization

pytestmark = pytest.mark.usefixtures("without_growth")

T = 0.05
Q = np.array([0.3, -0.2, 0.4, 0.3, -0.8, 1.2, 0.6, 0.4])
GAINS = {"stiffness": 0.6, "damping": 0.5}


@pytest.fixture(scope="module")
def robot():
    return dqc.load_robot("little-john")


def test_command_is_the_definition(robot):
    """Outer: ξ_b + T U and the pseudoinverse of the holonomic Jacobian. Inner: C⁻¹ (ẏ_r + κ (y_r − y))."""
    free, d, gain = robot.in_form("unconstrained"), robot.drives[0, 1], 3.0
    goal = dqc.Sample(robot.fkm(Q + 0.2 * np.array([1, -1, 1, 1, -1, 1, 0.5, -1])))
    law = Cascade(**GAINS, inner_gain=gain).prepare(robot, None, T)
    q, virtual, rates, state = Q.copy(), Q[:3].copy(), np.zeros(8), law.initial_state(Q)
    for _ in range(40):
        x = robot.fkm(q)
        jacobian = algebra.adjoint_twist(algebra.conjugate(x), free.twist_jacobian(q).T).T
        error = algebra.short(algebra.multiply(algebra.conjugate(goal.pose), x))
        twist = jacobian @ rates
        wanted = twist - T * (0.3 * algebra.log_body(error) + 0.5 * twist)
        rates = np.linalg.pinv(jacobian) @ wanted

        ahead, own = (d * np.array([math.cos(a), math.sin(a)]) for a in (virtual[2], q[2]))
        speed = rates[:2] + rates[2] * np.array([-ahead[1], ahead[0]])
        c = np.column_stack([own / d, [-own[1], own[0]]])
        v_omega = np.linalg.solve(c, speed + gain * (virtual[:2] + ahead - q[:2] - own))
        u = law.command(q, goal, state)
        np.testing.assert_allclose(u, np.r_[v_omega, rates[3:]], atol=1e-9)
        virtual += T * rates[:3]
        q = robot.integrate(q, u, T)


def test_the_inner_loop_follows_the_virtual_base(robot):
    """|y − y_r| stays of the order of T, because its error decays at κ: halved with T."""
    goal = dqc.Sample(robot.fkm(Q + np.array([0.4, 0.3, 0.3, 0, 0, 0, 0, 0])))
    farthest = []
    for period in (0.02, 0.01):
        law = Cascade(**GAINS).prepare(robot, None, period)
        q, state, far = Q.copy(), law.initial_state(Q), 0.0
        for _ in range(round(4 / period)):
            q = robot.integrate(q, law.command(q, goal, state), period)
            virtual = state[-3:]
            points = [p[:2] + 0.1 * np.array([math.cos(p[2]), math.sin(p[2])]) for p in (virtual, q)]
            far = max(far, float(np.linalg.norm(points[0] - points[1])))
        farthest.append(far)
    assert farthest[0] < 5e-3
    assert farthest[1] == pytest.approx(farthest[0] / 2, rel=0.2)


def test_without_drives_it_is_feedback_linearisation():
    arm = dqc.load_robot("iiwa7")
    q = np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])
    goal = dqc.references.SetPoint(arm.fkm(q + 0.1))
    laws = Cascade(**GAINS), PublishedLinearization(**GAINS)
    runs = [dqc.simulate(arm, goal, law, Integrator(), q, T, 3.0) for law in laws]
    np.testing.assert_allclose(runs[0].q, runs[1].q, atol=1e-12)


def test_compiled_and_interpreted_are_equal(robot):
    goal = dqc.references.SetPoint(robot.fkm(Q + 0.1))
    runs = [
        dqc.simulate(robot, goal, Cascade(**GAINS), Integrator(), Q, T, 3.0, interpreted=how)
        for how in (False, True)
    ]
    np.testing.assert_array_equal(runs[0].q, runs[1].q)


def test_the_state_starts_at_the_configuration_and_refuses_another_robot_s(robot):
    law = Cascade(**GAINS).prepare(robot, None, T)
    np.testing.assert_array_equal(law.initial_state(Q)[-3:], Q[:3])
    with pytest.raises(Error, match=r"q: expected shape \(…, 8\), got shape \(7,\)"):
        law.initial_state(np.zeros(7))


def test_bad_input(robot):
    with pytest.raises(Error, match="inner_gain: must be > 0, got 0"):
        Cascade(**GAINS, inner_gain=0).prepare(robot, None, T)
    with pytest.raises(Error, match="law: cascade is for the constrained form of little-john"):
        Cascade(**GAINS).prepare(robot.in_form("unconstrained"), None, T)


def test_the_classic_outer_loop_is_the_definition(robot):
    """Outer: J⁺ K vec8(x_d − x) of the holonomic Jacobian. Inner: as that of the other cascade. [S17 footnote 11]"""
    free, d, gain = robot.in_form("unconstrained"), robot.drives[0, 1], 3.0
    goal = dqc.Sample(robot.fkm(Q + 0.2 * np.array([1, -1, 1, 1, -1, 1, 0.5, -1])))
    law = ClassicCascade(gain=0.5, inner_gain=gain).prepare(robot, None, T)
    q, virtual, state = Q.copy(), Q[:3].copy(), law.initial_state(Q)
    for _ in range(40):
        x = robot.fkm(q)
        wanted = goal.pose * np.sign(goal.pose[:4] @ x[:4])
        rates = np.linalg.pinv(free.pose_jacobian(q)) @ (0.5 * (wanted - x))
        ahead, own = (d * np.array([math.cos(a), math.sin(a)]) for a in (virtual[2], q[2]))
        speed = rates[:2] + rates[2] * np.array([-ahead[1], ahead[0]])
        c = np.column_stack([own / d, [-own[1], own[0]]])
        v_omega = np.linalg.solve(c, speed + gain * (virtual[:2] + ahead - q[:2] - own))
        u = law.command(q, goal, state)
        np.testing.assert_allclose(u, np.r_[v_omega, rates[3:]], atol=1e-9)
        virtual += T * rates[:3]
        q = robot.integrate(q, u, T)


def test_without_drives_the_classic_cascade_is_the_classic_law():
    arm = dqc.load_robot("iiwa7")
    q = np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])
    goal = dqc.Sample(arm.fkm(q + 0.1))
    commands = [law(gain=0.5).command(arm, q, goal, T) for law in (ClassicCascade, ClassicProportional)]
    np.testing.assert_allclose(*commands, atol=1e-12)


def test_bad_input_of_the_classic_cascade(robot):
    with pytest.raises(Error, match="inner_gain: must be > 0, got 0"):
        ClassicCascade(gain=1.0, inner_gain=0).prepare(robot, None, T)
    with pytest.raises(Error, match="law: classic-cascade is for the constrained form of little-john"):
        ClassicCascade(gain=1.0).prepare(robot.in_form("unconstrained"), None, T)

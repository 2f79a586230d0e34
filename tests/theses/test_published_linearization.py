"""S17's law to the letter: its definition, what its logarithms leave of the proof, its choices."""

import numpy as np
import pytest
from body_twists import body_jacobian, wanted_twist

import dqcontrol as dqc
from dqcontrol import algebra
from dqcontrol.errors import Error
from dqcontrol_theses.variants import PublishedLinearization
from dqcontrol_theses.variants.published_linearization import INERTIAL, LOGARITHMS, spring

pytestmark = pytest.mark.usefixtures("without_growth")

SEED = 20170401
T = 0.05


@pytest.mark.parametrize("velocity_state", ["commanded", "realised"])
def test_command_is_the_definition(velocity_state):
    """u_f = F J_wb⁺ ξ with the holonomic Jacobian, ẋ, ẏ and φ̇ fed back as commanded or as realised. [S17 4.17–4.27]"""
    robot, rng = dqc.load_robot("little-john"), np.random.default_rng([SEED, 1])
    free = robot.in_form("unconstrained")
    law = PublishedLinearization(stiffness=0.6, damping=0.5, velocity_state=velocity_state).prepare(
        robot, None, T
    )
    q = np.r_[0.3, -0.2, 0.4, 0.3, -0.8, 1.2, 0.6, 0.4]
    sample = dqc.Sample(robot.fkm(q + 0.2 * rng.standard_normal(8)))
    state, rates = law.initial_state(q), np.zeros(8)
    for _ in range(30):
        jacobian = body_jacobian(free, q)
        twist = wanted_twist(robot, q, sample, jacobian @ rates, 0.6, 0.5, T)
        rates = np.linalg.pinv(jacobian) @ twist
        u = law.command(q, sample, state)
        np.testing.assert_allclose(u, robot.feasible_inputs(q, rates), atol=1e-9)
        q = robot.integrate(q, u, T)
        if velocity_state == "realised":
            rates = np.r_[u[0] * np.cos(q[2]), u[0] * np.sin(q[2]), u[1:]]


def test_projection_is_for_the_constrained_form():
    law = PublishedLinearization(stiffness=1.0, damping=1.0, velocity_state="realised")
    with pytest.raises(Error, match="is for the constrained form of little-john"):
        law.prepare(dqc.load_robot("little-john").in_form("unconstrained"), None, 0.01)


@pytest.mark.parametrize("logarithm", LOGARITHMS)
def test_the_spring_lets_the_lyapunov_function_fall(logarithm):
    """V̇ = 2 (k̄ A₁ − ⟨k_p L, ξ̃⟩) − 2 k_v |ξ̃|², A₁ = ½⟨L_b, ξ̃⟩: −2 k_v |ξ̃|² but for the guarded one, half of it."""
    rng, stiffness, damping = np.random.default_rng([SEED, 7]), 3.0, 0.1
    rates = []
    for _ in range(300):
        turn = rng.standard_normal(4)
        turn *= np.copysign(1.0, turn[0]) / np.linalg.norm(turn)
        relative, twist = algebra.pose(turn, rng.uniform(-2, 2, 3)), rng.standard_normal(6)
        out, square = np.zeros(6), twist @ twist
        spring(relative, twist, stiffness, damping, LOGARITHMS.index(logarithm), out)
        power = stiffness * 0.5 * algebra.log_body(relative) @ twist
        rates.append((2 * (power - out @ twist) - 2 * damping * square) / (damping * square))
    if logarithm == "inertial":
        assert max(rates) < -1.0 + 1e-9
        assert max(rates) > -1.0 - 1e-9  # the guard is at work
        assert min(rates) < -3.0  # and elsewhere it falls faster
    else:
        np.testing.assert_allclose(rates, -2.0, atol=1e-6)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"velocity_state": "real"}, "velocity_state: unknown name 'real'"),
        ({"logarithm": "screw"}, "logarithm: unknown name 'screw'"),
    ],
)
def test_bad_parameters(changes, message):
    with pytest.raises(Error, match=message):
        PublishedLinearization(stiffness=1.0, damping=1.0, **changes)


@pytest.mark.parametrize("wanted", [0.6, 3.9, 4.1])
def test_the_inertial_logarithm_gives_up_half_of_the_decrease_and_stays_within_its_window(wanted):
    """k_p A₂ = k̄ A₁ − ½ k_v |ξ̃|² where k̄/2 would not do, and the body logarithm where that takes k_p > 4 k̄."""
    rng, stiffness, damping, out, found = np.random.default_rng([SEED, 3]), 1.3, 0.7, np.zeros(6), 0
    while found < 20:
        x, twist = algebra.exp_screw(rng.uniform(-0.8, 0.8, 6)), rng.standard_normal(6)
        body, inertial = algebra.log_body(x), algebra.log_inertial(x)
        first, second = 0.5 * body @ twist, inertial @ twist
        speed = (stiffness * first - wanted * stiffness * second) / (0.5 * damping * twist @ twist)
        if second <= 1e-3 or speed <= 0:
            continue  # no speed along this twist takes a k_p of `wanted` k̄
        found += 1
        spring(x, speed * twist, stiffness, damping, INERTIAL, out)
        expected = wanted * stiffness * inertial if wanted < 4 else 0.5 * stiffness * body
        np.testing.assert_allclose(out, expected, atol=1e-9)

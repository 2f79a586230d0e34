"""Preferred motions of whole bodies: gradients against finite differences along the inputs, what they do."""

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.errors import ShapeError
from dqcontrol.laws import JointCentring, LimitAvoidance, ManipulabilityAscent, Posture, Proportional
from dqcontrol.robots.robot import base_coordinates

SEED = 20261121
REST = np.array([0.3, -0.4, 0.2, 0.1, -0.5, 0.6, 0.3, -0.2])


def bodies():
    """Return bodies with one drive, with none, and with two drives and a slide between them."""
    drive = dqc.DifferentialDrive(wheel_radius=0.05, half_track=0.15)
    slide = dqc.SerialArm.from_dh([0.2], [0.1], [0.3], [0.4], ["prismatic"])
    ridden = dqc.WholeBody([slide, drive, dqc.load_robot("ax18"), drive, slide], name="two drives")
    little = dqc.load_robot("little-john")
    return [little, dqc.load_robot("youbot"), ridden, little.in_form("unconstrained")]


def preferred(body, null_space, q):
    """Return z at q."""
    law = Proportional(gain=1.0, null_space=null_space).prepare(body, None, 0.01)
    law.command(q, dqc.Sample(body.fkm(q)), law.initial_state(q))
    return law.preferred.copy()


def gradient(body, criterion, q, h=1e-5):
    """Return the derivative of a criterion along each input; unconstrained ones move coordinates as if they could."""
    if body.input_size == body.configuration_size:
        moved = [q + step for step in h * np.eye(len(q))], [q - step for step in h * np.eye(len(q))]
    else:
        inputs = np.eye(body.input_size)
        moved = [body.integrate(q, u, h) for u in inputs], [body.integrate(q, u, -h) for u in inputs]
    return np.array([(criterion(a) - criterion(b)) / (2 * h) for a, b in zip(*moved, strict=True)])


@pytest.mark.parametrize("body", bodies(), ids=["drive", "holonomic", "two drives", "unconstrained"])
def test_preferences_are_gradients_along_the_inputs(body):
    print("seed", SEED)
    rng = np.random.default_rng(SEED)
    n = body.configuration_size
    rest = rng.uniform(-1, 1, n)
    lower, upper = body.limits.lower, body.limits.upper
    limited = np.isfinite(lower) & np.isfinite(upper)
    half, middle = (upper[limited] - lower[limited]) / 2, (upper[limited] + lower[limited]) / 2

    def manipulability(q):
        jacobian = body.twist_jacobian(q)
        return np.sqrt(np.linalg.det(jacobian @ jacobian.T))

    def posture(q):
        return -0.5 * ((q - rest) ** 2).sum()

    def centre(q):
        return -(((q[limited] - middle) / half) ** 2).sum() / n

    def avoidance(q):
        return -(2 * half / ((middle + half - q[limited]) * (q[limited] - middle + half))).sum()

    criteria = [
        (ManipulabilityAscent(gain=1.0), manipulability),
        (Posture(gain=1.0, rest=rest.tolist()), posture),
        (JointCentring(gain=1.0), centre),
        (LimitAvoidance(gain=1.0, fastest=1e9), avoidance),
    ]
    for _ in range(5):
        q = rng.uniform(np.maximum(lower, -2) + 0.2, np.minimum(upper, 2) - 0.2)
        for null_space, criterion in criteria:
            np.testing.assert_allclose(
                preferred(body, null_space, q), gradient(body, criterion, q), rtol=1e-6, atol=1e-8
            )


def test_without_a_rest_configuration_bases_are_left_alone():
    little, youbot, ridden, _ = bodies()
    assert np.flatnonzero(base_coordinates(ridden)).tolist() == [1, 2, 3, 9, 10, 11]
    assert np.flatnonzero(base_coordinates(youbot)).tolist() == [0, 1, 2]
    assert not base_coordinates(dqc.load_robot("panda")).any()
    q = np.full(8, 0.4)
    assert preferred(little, Posture(gain=2.0), q) == pytest.approx([0, 0, *[-0.8] * 5])
    middle = (youbot.limits.upper[3:] + youbot.limits.lower[3:]) / 2
    assert preferred(youbot, Posture(gain=2.0), q) == pytest.approx([0, 0, 0, *(2 * (middle - 0.4))])


@pytest.mark.parametrize("name", ["little-john", "youbot"])
def test_in_the_null_space_a_body_comes_nearer_to_its_rest_and_the_hand_rests(name):
    body = dqc.load_robot(name)
    q = np.array([0.1, -0.2, 0.4, 0.1, 0.4, -0.9, 0.8, 0.2])
    law = Proportional(gain=20.0, null_space=Posture(gain=0.5, rest=REST.tolist()))
    target = dqc.references.SetPoint(body.fkm(q))
    record = dqc.simulate(body, target, law, dqc.plants.Integrator(), q, period=0.01, duration=4.0)
    distance = np.linalg.norm(record.q - REST, axis=1)
    assert record.position_error.max() < 1e-3
    assert distance[-1] < distance[0] - 0.004
    assert (np.diff(distance) < 1e-9).all()


def test_a_rest_configuration_of_the_inputs_is_refused():
    with pytest.raises(ShapeError, match=r"null_space\.rest"):
        preferred(dqc.load_robot("little-john"), Posture(gain=1.0, rest=[0.0] * 7), REST)

"""H-infinity laws against their definitions, their exact rates and their bounds."""

import numpy as np
import pytest
from hand_twist import command, inertial_from_hand

import dqcontrol as dqc
from dqcontrol import algebra
from dqcontrol.errors import Error
from dqcontrol.laws import DampedInverse, HInfinity, HInfinityTracking, Schedule
from dqcontrol.laws.inverses import inverse_parameters
from dqcontrol.plants import Integrator

FIRST = inverse_parameters.size() + 1  # of a law's own parameters: behind the inverse's and the hysteresis

pytestmark = pytest.mark.usefixtures("without_growth")

START = np.array([0.1, 0.6, 0.2, 1.6, -0.1, 0.6, 0.3])
ORIENTATION, TRANSLATION = 4.0, 3.0
GAINS = {"orientation_gain": ORIENTATION, "translation_gain": TRANSLATION}


def relative_error(x, xd, form):
    """Return Im r_e and p_e (right) or Im r_l and the body position (left), taking the short way."""
    e = (
        algebra.multiply(x, algebra.conjugate(xd))
        if form == "right"
        else algebra.multiply(algebra.conjugate(xd), x)
    )
    e = algebra.short(e)
    return e[..., 1:4], algebra.translation(e)


@pytest.mark.parametrize("robot", ["iiwa7", "ax18"])
@pytest.mark.parametrize("form", ["right", "left"])
@pytest.mark.parametrize("law", [HInfinity, HInfinityTracking])
@pytest.mark.parametrize("sign", [1, -1])
def test_command_is_the_definition(robot, form, law, sign):
    arm = dqc.load_robot(robot)
    rng = np.random.default_rng(5)
    n = arm.configuration_size
    q = rng.uniform(0.2, 0.9, n)
    x, xd = arm.fkm(q), arm.fkm(q + 0.3 * rng.standard_normal(n))
    twist = rng.standard_normal(6)
    imaginary, position = relative_error(x, xd, form)
    if form == "left":
        position = algebra.translation(algebra.multiply(algebra.conjugate(xd), x))
        body = algebra.body_translation(algebra.multiply(algebra.conjugate(xd), x))
        wanted = algebra.adjoint_twist(x, np.r_[-ORIENTATION * imaginary, -TRANSLATION * body])
        feed = twist
    else:
        wanted = np.r_[-ORIENTATION * imaginary, -TRANSLATION * position]
        feed = algebra.adjoint_twist(algebra.multiply(x, algebra.conjugate(xd)), twist)
    if law is HInfinityTracking:
        wanted = wanted + feed
    u = law(**GAINS, form=form).command(arm, q, dqc.Sample(sign * xd, twist), period=0.01)
    twist = np.linalg.inv(inertial_from_hand(arm, q)) @ wanted
    np.testing.assert_allclose(u, command(arm, q, twist), atol=1e-10)


def test_damped_inverse_acts_on_the_hand_s_twist():
    arm = dqc.load_robot("iiwa7")
    sample = dqc.Sample(arm.fkm(START + 0.2))
    imaginary, position = relative_error(arm.fkm(START), sample.pose, "right")
    wanted = np.r_[-ORIENTATION * imaginary, -TRANSLATION * position]
    inverse, twist = DampedInverse(damping=0.1), np.linalg.inv(inertial_from_hand(arm, START)) @ wanted
    u = HInfinity(**GAINS, inverse=inverse).command(arm, START, sample, period=0.01)
    np.testing.assert_allclose(u, command(arm, START, twist, inverse))


@pytest.mark.parametrize("form", ["right", "left"])
def test_rates(form):
    """|p_e| decays at k_T, tan(θ/4) at k_O/2; T = 1 ms turns k into −ln(1 − kT)/T."""
    arm, period = dqc.load_robot("iiwa7"), 1e-3
    target = dqc.references.SetPoint(arm.fkm(START + 0.1 * np.array([1, -1, 1, 1, -1, 1, 1])))
    record = dqc.simulate(
        arm, target, HInfinity(**GAINS, form=form), Integrator(), START, period, duration=1.0
    )
    imaginary, position = relative_error(record.pose, record.desired_pose, form)
    distance = np.linalg.norm(position, axis=1)
    angle = 2 * np.arcsin(np.linalg.norm(imaginary, axis=1))
    for value, rate in ((distance, TRANSLATION), (np.tan(angle / 4), ORIENTATION / 2)):
        measured = -np.log(value[-1] / value[0]) / record.time[-1]
        assert measured == pytest.approx(rate, rel=5e-3)


@pytest.mark.parametrize("form", ["right", "left"])
def test_tracking_does_not_lag(form):
    arm = dqc.load_robot("iiwa7")
    circle = dqc.references.Circle(arm.fkm(START), radius=0.07, duration=5.0)
    errors = {}
    for law in (HInfinity, HInfinityTracking):
        record = dqc.simulate(arm, circle, law(**GAINS, form=form), Integrator(), START, 0.01)
        errors[law] = record.position_error.max()
    assert errors[HInfinityTracking] < 2e-3
    assert errors[HInfinity] > 20e-3


def test_gains_from_gamma_and_schedules():
    arm, times = dqc.load_robot("iiwa7"), np.array([0.0])
    rows = HInfinity(orientation_gamma=0.5, translation_gamma=0.25).parameter_rows(arm, times)
    assert rows[0, FIRST] * 0.5 == pytest.approx(2.0)
    assert rows[0, FIRST + 1] * 0.25 == pytest.approx(np.sqrt(2))
    ramp = Schedule([0, 2], [1.0, 3.0])
    prepared = HInfinity(orientation_gain=ramp, translation_gain=2.0).prepare(arm, None, 0.5)
    np.testing.assert_allclose(prepared.parameters[:, FIRST], [1, 1.5, 2, 2.5, 3])
    np.testing.assert_allclose(prepared.parameters[:, FIRST + 1], 2.0)


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({}, "orientation_gain: give either orientation_gain or orientation_gamma"),
        ({**GAINS, "translation_gamma": 1.0}, "translation_gain: give either"),
        ({"orientation_gain": 0.0, "translation_gain": 1.0}, "orientation_gain: must be > 0, got 0"),
        ({"orientation_gamma": -1.0, "translation_gain": 1.0}, "orientation_gamma: must be > 0, got -1"),
        ({**GAINS, "form": "middle"}, "form: unknown name 'middle'"),
        ({**GAINS, "hysteresis": 1.0}, "hysteresis: must be < 1, got 1"),
    ],
)
def test_bad_parameters(parameters, message):
    with pytest.raises(Error, match=message):
        HInfinity(**parameters).prepare(dqc.load_robot("iiwa7"), None, 0.01)

"""Whole bodies in the closed loop: compiled and interpreted alike, with every law."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import dqcontrol as dqc
from dqcontrol import laws
from dqcontrol.errors import ShapeError
from dqcontrol.plants import ConstantTwist, Disturbance, Integrator
from dqcontrol_theses import variants

T = 0.01
STARTS = {
    "little-john": np.array([0.1, -0.2, 0.4, 0.1, 0.4, -0.9, 0.6, 0.2]),
    "youbot": np.array([0.1, -0.2, 0.4, 0.1, 0.4, -0.9, 0.8, 0.2]),
}
LAWS = [
    laws.Proportional(gain=4.0),
    laws.ProportionalFeedforward(gain=4.0),
    variants.ClassicProportional(gain=4.0),
    laws.DecoupledProportional(gain=4.0),
    laws.HInfinity(orientation_gain=4.0, translation_gain=4.0),
    laws.HInfinityTracking(orientation_gain=4.0, translation_gain=4.0),
    laws.LinearQuadraticR8(error_weight=16.0, control_weight=1.0),
    laws.LinearQuadraticDQ(error_weight=16.0, control_weight=1.0),
]


def near_target(body):
    """Return a set-point that the body's own inputs lead to."""
    inputs = 0.4 * np.cos(np.arange(body.input_size))
    return dqc.references.SetPoint(body.fkm(body.integrate(STARTS[body.name], inputs, 0.5)))


@pytest.mark.parametrize("name", STARTS)
@pytest.mark.parametrize("law", LAWS, ids=lambda law: type(law).__name__)
def test_every_law_brings_whole_bodies_to_a_set_point_compiled_as_interpreted(name, law):
    body = dqc.load_robot(name)
    run = [body, near_target(body), law, Integrator(), STARTS[name], T]
    fast = dqc.simulate(*run, duration=4.0)
    slow = dqc.simulate(*run, duration=4.0, interpreted=True)
    assert fast.error[0] > 0.1
    assert fast.error[-1] < 1e-3
    assert fast.q.shape == (401, 8)
    assert fast.command.shape == (401, body.input_size)
    assert fast.joint_names == body.joint_names
    assert fast.input_names == body.input_names
    for field in ("q", "measured", "command", "pose"):
        assert np.array_equal(getattr(fast, field), getattr(slow, field)), field


def test_a_drive_moves_as_the_unicycle_between_samples():
    body = dqc.load_robot("little-john")
    record = dqc.simulate(body, near_target(body), LAWS[0], Integrator(), STARTS["little-john"], T, 0.5)

    def rate(time, q):
        v, omega, *joints = record.command[min(int(time / T), len(record) - 1)]
        return [v * np.cos(q[2]), v * np.sin(q[2]), omega, *joints]

    q = record.q[0]
    for k in range(len(record) - 1):
        span = k * T + np.array([1e-9, T * (1 - 1e-9)])
        q = solve_ivp(rate, span, q, rtol=1e-10, atol=1e-12).y[:, -1]
    assert np.abs(record.q[-1] - record.q[0])[:3].min() > 0.01
    assert record.q[-1] == pytest.approx(q, abs=1e-7)


def test_unconstrained_rates_move_a_drive_as_its_feasible_inputs_do():
    body = dqc.load_robot("little-john").in_form("unconstrained")
    q0, rates = STARTS["little-john"], np.array([0.2, 0.3, -0.4, 0.1, 0, 0, 0, 0.5])
    plant = Integrator().start(body, q0, T, 50, 0)
    q = q0
    for _ in range(50):
        plant.step(rates)
        q = body.in_form("constrained").integrate(q, body.feasible_inputs(q, rates), T)
    assert plant.q == pytest.approx(q, abs=1e-12)
    assert np.abs(plant.q - q0 - 0.5 * rates)[:3].max() > 0.02, "a drive does not move sideways"


def test_the_bias_of_a_drive_is_one_of_v_and_omega():
    body = dqc.load_robot("little-john")
    plant = Integrator(bias=[0.3, 0.6, 0, 0, 0, 0, 0]).start(body, np.zeros(8), T, 100, 0)
    for _ in range(100):
        plant.step(np.zeros(7))
    radius = 0.3 / 0.6
    arc = [radius * np.sin(0.6), radius * (1 - np.cos(0.6)), 0.6]
    assert plant.q == pytest.approx([*arc, 0, 0, 0, 0, 0], abs=1e-12)


@pytest.mark.parametrize("count", [2, 3, 6, 8])
def test_inputs_that_do_not_fit_a_body_are_refused(count):
    body = dqc.load_robot("little-john")
    plant = Integrator().start(body, STARTS["little-john"], T, 1, 0)
    with pytest.raises(ShapeError, match=r"command: does not fit the robot, got shape"):
        plant.step(np.zeros(count))
    assert np.array_equal(plant.q, STARTS["little-john"])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"start": [0.0] * 7}, r"start: expected shape \(…, 8\), got shape \(7,\)"),
        ({"plant": Integrator(bias=[0.0] * 8)}, "plant.bias: expected one number or 7"),
        ({"robot": dqc.DifferentialDrive(0.05, 0.1)}, "robot: expected a Robot, got DifferentialDrive"),
    ],
)
def test_a_run_that_does_not_fit_a_body_is_refused(change, message):
    body = dqc.load_robot("little-john")
    run = {"robot": body, "plant": Integrator(), "start": STARTS["little-john"]} | change
    with pytest.raises(ShapeError, match=message):
        dqc.simulate(reference=near_target(body), law=LAWS[0], period=T, duration=0.1, **run)


PUSH = Disturbance(twist=ConstantTwist(value=(0, 0, 0, 0.02, 0, -0.01)))


@pytest.mark.parametrize("name", STARTS)
def test_a_constant_push_holds_the_hand_of_a_body_off_by_its_speed_over_the_gain(name):
    """At the fixed point the law undoes the disturbance's step, arcs of drives too."""
    body, start = dqc.load_robot(name), STARTS[name]
    here = dqc.references.SetPoint(body.fkm(start))
    run = [body, here, LAWS[0], Integrator(), start, T]
    fast = dqc.simulate(*run, duration=6.0, disturbance=PUSH)
    slow = dqc.simulate(*run, duration=6.0, disturbance=PUSH, interpreted=True)
    assert fast.position[-1] - fast.desired_position[-1] == pytest.approx([0.02 / 4, 0, -0.01 / 4], abs=1e-9)
    assert fast.orientation_error[-1] < 1e-9
    assert fast.disturbance is not None
    assert fast.disturbance[-1] == pytest.approx([0, 0, 0, 0.02, 0, -0.01], abs=1e-12)
    for field in ("q", "command", "disturbance"):
        assert np.array_equal(getattr(fast, field), getattr(slow, field)), field


def test_drives_that_could_move_sideways_are_not_disturbed():
    body = dqc.load_robot("little-john").in_form("unconstrained")
    with pytest.raises(ShapeError, match="disturbance: needs the constrained form of little-john"):
        PUSH.start(body, T, 10, 0)

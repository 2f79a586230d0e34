"""Servos on bodies with mobile bases: joints as on an arm, bases against closed forms and an ODE solver."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import dqcontrol as dqc
from dqcontrol.errors import ShapeError, ValueRangeError
from dqcontrol.laws import Proportional
from dqcontrol.plants import Camera, Servo
from dqcontrol.robots.robot import base_coordinates

SEED = 20261123
T = 0.01
Q0 = np.array([0.1, -0.2, 0.4, 0.1, 0.4, -0.9, 0.6, 0.2])


@pytest.fixture(scope="module")
def body():
    return dqc.load_robot("little-john")


def drive(plant, robot, q0, commands, seed=0, period=T):
    """Return true and measured configurations after each command."""
    live = plant.start(robot, q0, period, len(commands), seed)
    q, measured = [], []
    for u in commands:
        live.step(np.array(u, dtype=float))
        q.append(live.q.copy())
        measured.append(live.measured.copy())
    return np.array(q), np.array(measured)


def random_commands(count, size, scale=0.3):
    return scale * np.random.default_rng(SEED).normal(size=(count, size))


@pytest.mark.parametrize("mode", ["integrated", "measured"])
def test_joints_follow_as_on_their_arm_and_bases_as_commanded(body, mode):
    servo = Servo(
        command_mode=mode, delay=2 * T, encoder_noise=1e-3, encoder_resolution=1e-4, rate_limit=False
    )
    commands = random_commands(100, 7)
    q, measured = drive(servo, body, Q0, commands, seed=5)
    arm_q, arm_measured = drive(servo, dqc.load_robot("ax18"), Q0[3:], commands[:, 2:], seed=5)
    assert np.array_equal(q[:, 3:], arm_q)
    assert np.array_equal(measured[:, 3:], arm_measured)
    wanted = Q0
    for u in commands[:-2]:  # the delay is of two periods
        wanted = body.integrate(wanted, [*u[:2], 0, 0, 0, 0, 0], T)
    assert q[-1, :3] == pytest.approx(wanted[:3], abs=1e-13)
    assert np.array_equal(measured[:, :3], q[:, :3])


@pytest.mark.parametrize("form", ["constrained", "unconstrained"])
def test_two_arms_on_a_drive_move_as_drive_and_arms_alone(form):
    drive_part = dqc.DifferentialDrive(0.1, 0.3, 0.1, rim_speed=1.0, acceleration=0.5)
    base, arm = dqc.WholeBody([drive_part], form=form), dqc.load_robot("iiwa7")
    servo, m = Servo(delay=2 * T), base.input_size
    q0 = np.array([0.1, -0.2, 0.4, *[0.3] * 14])
    commands = random_commands(100, m + 14)
    q, _ = drive(servo, dqc.TwoArms(arm, arm, base=base), q0, commands)
    assert np.array_equal(q[:, :3], drive(servo, base, q0[:3], commands[:, :m])[0])
    assert np.array_equal(q[:, 3:10], drive(servo, arm, q0[3:10], commands[:, m : m + 7])[0])
    assert np.array_equal(q[:, 10:], drive(servo, arm, q0[10:], commands[:, m + 7 :])[0])


def test_parts_in_any_order_move_each_as_its_own():
    drive_part = dqc.DifferentialDrive(wheel_radius=0.05, half_track=0.15)
    slide = dqc.SerialArm.from_dh([0.2], [0.1], [0.3], [0.4], ["prismatic"])
    arm = dqc.load_robot("ax18")
    body = dqc.WholeBody([slide, drive_part, arm, dqc.HolonomicBase(), slide])
    bases, q0, commands = base_coordinates(body), np.linspace(-0.5, 0.5, 13), random_commands(60, 12)
    q, _ = drive(Servo(), body, q0, commands)
    joints, _ = drive(
        Servo(), dqc.SerialArm.join([slide, arm, slide]), q0[~bases], commands[:, [0, *range(3, 8), 11]]
    )
    assert np.array_equal(q[:, ~bases], joints)
    wanted = q0
    for u in commands:
        wanted = body.integrate(wanted, u, T)
    assert q[-1, bases] == pytest.approx(wanted[bases], abs=1e-13)


def test_a_body_without_arm_drives():
    base = dqc.WholeBody([dqc.DifferentialDrive(wheel_radius=0.05, half_track=0.15)])
    q, _ = drive(Servo(), base, np.zeros(3), [[0.5, 1.0]] * 100)
    assert q[-1] == pytest.approx([0.5 * np.sin(1), 0.5 * (1 - np.cos(1)), 1.0], abs=1e-12)


@pytest.mark.parametrize("tau", [0.02, 0.3])
def test_lagging_speeds_in_closed_form(body, tau):
    """x = v (t − τ (1 − exp(−t/τ))) straight ahead, and φ the same of ω."""
    t = T * np.arange(1, 201)
    way = t - tau * (1 - np.exp(-t / tau))
    for command, coordinate in (([0.4, 0, 0, 0, 0, 0, 0], 0), ([0, 0.7, 0, 0, 0, 0, 0], 2)):
        q, _ = drive(Servo(base_time_constant=tau), body, np.zeros(8), [command] * 200)
        assert q[:, coordinate] == pytest.approx(max(command) * way, abs=1e-13)


def test_lagging_drives_follow_the_differential_equation_to_second_order(body):
    """The arc of the period's mean speeds: an eighth of the error, or less, at a third of the period."""
    tau, changes = 0.15, [(0.4, -0.5), (-0.1, 1.2), (0.3, 0.2)]

    def rate(_, s, v, omega):
        phi, speed, turning = s[2:]
        return [speed * np.cos(phi), speed * np.sin(phi), turning, (v - speed) / tau, (omega - turning) / tau]

    s = np.zeros(5)
    for v, omega in changes:
        s = solve_ivp(rate, (0, 0.3), s, args=(v, omega), rtol=1e-11, atol=1e-12).y[:, -1]
    errors = []
    for period in (0.03, 0.01):
        count = round(0.3 / period)
        commands = np.repeat([[v, omega, 0, 0, 0, 0, 0] for v, omega in changes], count, axis=0)
        q, _ = drive(Servo(base_time_constant=tau), body, np.zeros(8), commands, period=period)
        assert q[-1, 2] == pytest.approx(s[2], abs=1e-9)
        errors.append(np.abs(q[-1, :2] - s[:2]).max())
    assert errors[0] < 1e-4
    assert errors[1] < errors[0] / 8


def test_wheels_turn_no_faster_than_they_can(body):
    command = [0.5, 4.0, 0, 0, 0, 0, 0]  # rims at 0.5 + 0.13 · 4 = 1.02 m/s of 0.5
    q, _ = drive(Servo(), body, np.zeros(8), [command] * 10)
    share = 0.5 / 1.02
    wanted = body.integrate(np.zeros(8), share * np.array(command), 0.1)
    assert q[-1] == pytest.approx(wanted, abs=1e-12)
    q, _ = drive(Servo(rate_limit=False), body, np.zeros(8), [command] * 10)
    assert q[-1] == pytest.approx(body.integrate(np.zeros(8), command, 0.1), abs=1e-12)


def test_unconstrained_rates_become_wheel_speeds_by_the_measured_heading(body):
    free = body.in_form("unconstrained")
    rates = np.array([0.1, 0.05, -0.2, 0, 0, 0, 0, 0])
    seldom = Servo(camera=Camera(rate=3.0))
    live = seldom.start(free, Q0, T, 30, 0)
    q = Q0
    for _ in range(30):
        u = body.feasible_inputs(live.measured, rates)
        live.step(rates)
        q = body.integrate(q, u, T)
        assert live.q == pytest.approx(q, abs=1e-13)


@pytest.mark.parametrize("name", ["little-john", "youbot"])
def test_bodies_on_servos_reach_a_set_point_compiled_as_interpreted(name):
    body = dqc.load_robot(name)
    target = body.integrate(Q0, 0.4 * np.cos(np.arange(body.input_size)), 0.5)
    servo = Servo(
        time_constant=0.03,
        base_time_constant=0.05,
        delay=T,
        encoder_noise=1e-5,
        camera=Camera(rate=25.0, delay=2 * T, position_noise=1e-4, angle_noise=1e-4, filter_time=0.05),
    )
    run = [body, dqc.references.SetPoint(body.fkm(target)), Proportional(gain=1.5), servo, Q0, T]
    fast = dqc.simulate(*run, duration=5.0, seed=3)
    slow = dqc.simulate(*run, duration=5.0, seed=3, interpreted=True)
    assert fast.position_error[0] > 0.1
    assert fast.position_error[-1] < 2e-3
    for field in ("q", "measured", "command"):
        assert np.array_equal(getattr(fast, field), getattr(slow, field)), field
    for signal in fast.readings:
        assert np.array_equal(fast.readings[signal].values, slow.readings[signal].values), signal


def test_commands_that_do_not_fit_are_refused(body):
    for robot, sizes in ((body, (2, 3, 8)), (body.in_form("unconstrained"), (3, 7))):
        live = Servo().start(robot, Q0, T, 1, 0)
        for size in sizes:
            with pytest.raises(ShapeError, match="command: does not fit the robot"):
                live.step(np.zeros(size))
        assert np.array_equal(live.q, Q0)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"sag": 1.0}, r"^inertia: little-john has none"),
        ({"stiffness": [1.0] * 8}, r"^plant\.stiffness: expected one number or 5, got shape \(8,\)$"),
        ({"base_time_constant": -1.0}, r"^plant\.base_time_constant: must be ≥ 0, got -1$"),
    ],
)
def test_bad_parameters(body, options, message):
    with pytest.raises((ShapeError, ValueRangeError), match=message):
        Servo(**options).start(body, Q0, T, 1, 0)


@pytest.mark.parametrize("options", [{"base_time_constant": 0.1}, {"camera": Camera()}])
def test_arms_have_no_base(options):
    with pytest.raises(ValueRangeError, match=f"plant.{next(iter(options))}: iiwa7 has no mobile base"):
        Servo(**options).start(dqc.load_robot("iiwa7"), np.zeros(7), T, 1, 0)

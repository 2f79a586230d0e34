"""Limits of whole bodies: joints in configurations that hold more than the inputs, wheels that turn no faster."""

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.laws import Proportional
from dqcontrol.limits import CommandLimits, ModifiedClamping, WeightedLeastNorm
from dqcontrol.supervisor import Supervisor
from dqcontrol.supervisor.interventions import IMPOSSIBLE
from dqcontrol.supervisor.supervisor_layout import GO, RESET, STOP
from dqcontrol_theses import variants
from dqcontrol_theses.variants import OriginalClamping

SEED = 20261122
RIM = 0.8  # m/s
T = 0.01
START = np.array([0.1, -0.2, 0.4, 0.1, 0.4, -0.9, 0.6, 2.5])


def scaled(body, q, command):
    """Return what velocity limits leave of a command."""
    kernel, parameters = CommandLimits(velocity=True).prepare(body)
    out = np.array(command, dtype=float)
    kernel(np.asarray(q, dtype=float), parameters, out)
    return out


def loads(body, u):
    """Return each input's speed over its limit, then each drive's rim speed over its own."""
    inputs = np.abs(u) / body.limits.velocity
    rims = []
    for k, (first, _, radius, *_) in enumerate(body.drives):
        j = int(first) - k
        wheels = body.wheel_speeds(u)[j : j + 2]
        rims.append(radius * np.abs(wheels).max() / body.limits.velocity[j])
    return np.array([*inputs, *rims])


def test_commands_keep_their_direction_and_the_fastest_of_joints_and_rims_is_at_its_limit():
    print("seed", SEED)
    rng = np.random.default_rng(SEED)
    slow = dqc.DifferentialDrive(wheel_radius=0.05, half_track=0.2, rim_speed=0.3)
    fast = dqc.DifferentialDrive(wheel_radius=0.08, half_track=0.1, rim_speed=0.9)
    body = dqc.WholeBody([slow, dqc.load_robot("ax18"), fast])
    by_wheel = by_joint = 0
    for _ in range(200):
        u = rng.uniform(-1, 1, body.input_size) * rng.choice([0.1, 1, 3])
        u[2:-2] *= rng.choice([1, 10, 30])
        out = scaled(body, np.zeros(body.configuration_size), u)
        share = loads(body, u).max()
        assert out == pytest.approx(u / max(share, 1.0), rel=1e-12)
        assert loads(body, out).max() <= 1 + 1e-12
        by_wheel += share > 1 and loads(body, u).argmax() >= body.input_size
        by_joint += share > 1 and loads(body, u).argmax() < body.input_size
    assert min(by_wheel, by_joint) > 30


def test_the_fastest_rim_of_four_wheels_on_rollers_is_at_its_limit():
    """|vx| + |vy| + (half track + half wheelbase) |ω| of one of them, whatever the signs."""
    body = dqc.WholeBody(
        [dqc.MecanumBase(wheel_radius=0.05, half_track=0.15, half_wheelbase=0.24, rim_speed=RIM)]
    )
    by_rim = 0
    for u in np.random.default_rng(SEED).uniform(-2, 2, (50, 3)):
        rim, inputs = np.abs(u) @ [1.0, 1.0, 0.39] / RIM, np.abs(u) / body.limits.velocity
        by_rim += rim > max(1.0, inputs.max())
        assert scaled(body, [0.3, -0.2, 0.0], u) == pytest.approx(u / max(1.0, rim, inputs.max()))
    assert by_rim > 20


def test_a_car_turns_no_sharper_than_its_wheels_are_steered():
    body = dqc.WholeBody([dqc.CarLikeBase(0.05, 0.15, wheelbase=0.4, steering_limit=0.6, rim_speed=0.8)])
    radius = 0.4 / np.tan(0.6)
    assert scaled(body, np.zeros(3), np.array([0.1, 9.0]))[1] == pytest.approx(
        scaled(body, np.zeros(3), np.array([0.1, 9.0]))[0] / radius
    )
    assert scaled(body, np.zeros(3), np.array([0.1, 0.1])) == pytest.approx([0.1, 0.1])


def test_unconstrained_rates_are_scaled_by_the_wheels_that_follow_them():
    body = dqc.load_robot("little-john").in_form("unconstrained")
    q, u = np.array([0, 0, np.pi / 2, 0, 0, 0, 0, 0]), np.array([-0.1, 0.4, 0, 0, 0, 0, 0, 0])
    # The heading is y: v = 0.4 m/s; the displaced point, 0.1 m ahead, moves by 0.1 m/s to its left: ω = 1 rad/s.
    assert scaled(body, q, u) == pytest.approx(u * 0.5 / (0.4 + 0.13 * 1.0), rel=1e-12)
    assert scaled(body, q, 0.9 * u) == pytest.approx(0.9 * u, rel=1e-12)


@pytest.mark.parametrize("kind", [ModifiedClamping(), OriginalClamping(), WeightedLeastNorm()])
def test_position_limits_are_those_of_the_coordinate_that_an_input_moves(kind):
    """The last joint, input 6 and coordinate 7, starts 0.1 rad from its limit and is driven beyond it."""
    body = dqc.load_robot("little-john")
    beyond = START + np.array([0.2, 0, 0, 0, 0, 0, 0, 1.0])
    target, law = dqc.references.SetPoint(body.fkm(beyond)), Proportional(gain=5.0)
    run = [body, target, law, dqc.plants.Integrator(), START, T]
    free = dqc.simulate(*run, duration=3.0)
    assert free.q[:, 7].max() > body.limits.upper[7] + 0.05
    kept = dqc.simulate(*run, duration=3.0, limits=CommandLimits(position=kind))
    over = (kept.q - body.limits.upper).max()
    if isinstance(kind, ModifiedClamping):
        assert over <= 0
        assert kept.q[:, 7].max() == pytest.approx(body.limits.upper[7], abs=1e-6)
    else:
        assert over < (free.q[:, 7] - body.limits.upper[7]).max() / 2


@pytest.mark.parametrize("runs", [150, pytest.param(1000, marks=pytest.mark.slow)])
def test_random_runs_of_bodies_never_leave_the_limits(runs):
    """And with K a sample in which no joint would cross its limit is commanded as if there were no limits."""
    print("seed", SEED)
    rng = np.random.default_rng(SEED + 1)
    drive, arm = dqc.DifferentialDrive(0.05, 0.2, rim_speed=0.5), dqc.load_robot("ax18")
    bodies = [dqc.load_robot("little-john"), dqc.load_robot("youbot"), dqc.WholeBody([arm, drive, arm])]
    laws = [
        Proportional(gain=5.0, null_space=dqc.laws.BestHeading()),
        dqc.laws.FeedbackLinearization(stiffness=16.0, damping=4.0),
        variants.Cascade(stiffness=16.0, damping=4.0),
        variants.ClassicWholeBody(gain=5.0),
    ]
    limited = released = 0
    for k in range(runs):
        body, law = bodies[k % 3], laws[rng.integers(4)]
        lower, upper, moved = body.limits.lower, body.limits.upper, body.input_coordinates
        start = rng.uniform(np.maximum(lower, -3), np.minimum(upper, 3))
        goal = dqc.references.SetPoint(body.fkm(start + rng.uniform(-1.5, 1.5, len(start))))
        limits = CommandLimits(position=ModifiedClamping(), velocity=k % 2 == 1)
        run = dqc.simulate(body, goal, law, dqc.plants.Integrator(), start, T, 1.0, limits=limits)
        assert len(run) == 101, run.stopped
        assert np.maximum(run.q - upper, lower - run.q).max() <= 0.0
        if law is not laws[0] or k % 2 == 1 or k > 200:
            continue
        free = law.prepare(body, None, T)
        state = free.initial_state(start)
        for q, u in zip(run.q, run.command, strict=True):
            wanted = free.command(q, goal.at(0.0), state)
            outwards = ((q >= upper - 1e-6)[moved] & (wanted > 0)) | (
                (q <= lower + 1e-6)[moved] & (wanted < 0)
            )
            limited += outwards.any()
            crossing = (wanted < ((lower - q) / T)[moved]) | (wanted > ((upper - q) / T)[moved])
            if not (outwards | crossing).any():
                released += limited > 0
                assert u == pytest.approx(wanted, rel=1e-9)
            else:
                assert (u[outwards] == 0).all()
    assert limited > 50
    assert released > 50


def test_the_whole_run_of_a_body_keeps_its_rims():
    body = dqc.load_robot("little-john")
    far = body.integrate(START, [0.5, 0.8, 0, 0, 0, 0, 0], 2.0)
    run = [
        body,
        dqc.references.SetPoint(body.fkm(far)),
        Proportional(gain=5.0),
        dqc.plants.Integrator(),
        START,
        T,
    ]
    free = dqc.simulate(*run, duration=2.0)
    kept = dqc.simulate(*run, duration=2.0, limits=CommandLimits(velocity=True))
    rims = [np.abs(body.wheel_speeds(each.command)[:, :2]).max() * 0.065 for each in (free, kept)]
    assert rims[0] > 1.0
    assert rims[1] == pytest.approx(0.5, rel=1e-12)


def mecanum_rims(v_x, v_y, omega):
    """Return the speed of the fastest rim, of wheels 0.15 m and 0.24 m beside the middle, m/s."""
    return abs(v_x) + abs(v_y) + 0.39 * abs(omega)


def omni_rims(v_x, v_y, omega):
    """Return the same of three wheels 0.2 m from the middle, at 60°, 180° and 300°."""
    angles = np.radians([60.0, 180.0, 300.0])
    return np.abs(-np.sin(angles) * v_x + np.cos(angles) * v_y + 0.2 * omega).max()


@pytest.mark.parametrize(
    ("base", "fastest_rim"),
    [
        (
            dqc.MecanumBase(wheel_radius=0.05, half_track=0.15, half_wheelbase=0.24, rim_speed=RIM),
            mecanum_rims,
        ),
        (dqc.OmniBase(wheel_radius=0.05, wheel_distance=0.2, rim_speed=RIM), omni_rims),
    ],
)
@pytest.mark.parametrize("acceleration", [0.8, 10.0])
def test_the_supervisor_keeps_the_rims_of_wheels_with_rollers(base, fastest_rim, acceleration):
    """While a base turns on its way, brakes and is stopped, and within its acceleration."""
    given = Supervisor(acceleration=acceleration, ramp=0.1, slow_below=0.0, hold_below=0.0)
    body, rng = dqc.WholeBody([base]), np.random.default_rng(SEED)
    prepared, q, last, rims, asked = given.prepare(body, 2 * T), np.zeros(3), np.zeros(3), [], []
    state, wanted = prepared.start(q), np.zeros(3)
    for k in range(1500):
        if k % 30 == 0:
            wanted = rng.uniform(-1, 1, 3) * body.limits.velocity * rng.choice([0.3, 1.0, 1.0], 3)
        u = prepared.command(q, wanted, state, request={500: STOP, 600: RESET}.get(k, GO)).copy()
        c, s = np.cos(q[2]), np.sin(q[2])
        for rates, kept in ((u, rims), (wanted, asked)):
            kept.append(fastest_rim(c * rates[0] + s * rates[1], c * rates[1] - s * rates[0], rates[2]))
        assert np.abs(u - last).max() <= acceleration * 2 * T * (1 + 1e-9)
        assert not prepared.code(state) & IMPOSSIBLE
        q, last = body.integrate(q, u, 2 * T), u
    assert max(asked) > 1.2 * RIM
    assert max(rims) <= RIM * (1 + 1e-9)
    assert sum(rim > 0.999 * RIM for rim in rims) > 20


@pytest.mark.parametrize("jerk", [None, 10.0])
def test_a_car_that_reverses_in_a_curve_keeps_its_accelerations(jerk):
    """Its ω follows v there: braking at v's own limit would turn it 1.8 times as hard as it may."""
    base = dqc.robots.CarLikeBase(0.1, 0.2, wheelbase=0.5, steering_limit=0.5, rim_speed=2.0)
    car, rng = dqc.WholeBody([base]).in_form("constrained"), np.random.default_rng(5)
    most, period = np.array([1.0, 0.6]), 0.01
    supervisor = dqc.supervisor.Supervisor(acceleration=most.tolist(), jerk=jerk).prepare(car, period)
    q, before, change = np.zeros(3), np.zeros(2), np.zeros(2)
    state, wanted, fastest = supervisor.start(q), np.zeros(2), 0.0
    for k in range(3000):
        if k % 100 == 0:
            wanted = rng.uniform(-2, 2, 2)
        u = supervisor.command(q, wanted, state)
        assert (np.abs(u - before) <= most * period * (1 + 1e-9)).all(), k
        if jerk:
            assert np.abs(u - before - change).max() <= jerk * period**2 * (1 + 1e-9), k
        q, change, before = car.integrate(q, u, period), u - before, u
        fastest = max(fastest, float(abs(u[1])))
    assert fastest > 0.5, "it turns"

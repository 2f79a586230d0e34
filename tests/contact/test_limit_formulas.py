"""What a contact loop bears, against closed forms, on oblique walls, and at the speed at which it may be approached."""

import cmath
import itertools

import numpy as np
import pytest
from scipy.linalg import expm

import dqcontrol as dqc
from dqcontrol import algebra
from dqcontrol.contact import Admittance, Compliance, ForceSensor, WantedWrench, contact_limits
from dqcontrol.contact.limits import _environment
from dqcontrol.plants import Servo, Wrist
from dqcontrol.references import Guarded, SetPoint, Straight

ARM, START = dqc.load_robot("iiwa7"), np.array([0, 0.6, 0, -1.6, 0, 0.9, 0])
HAND = ARM.fkm(START)
PLACE = algebra.translation(HAND)


def limit_of(admittance, servo, period, gain=1.0, environment=1e4):
    law = dqc.laws.ProportionalFeedforward(gain=gain).prepare(ARM, None, period)
    return contact_limits(admittance, law, servo, START, environment)


@pytest.mark.parametrize("seed", range(12))
def test_the_limit_of_one_axis_is_that_of_its_phase(seed):
    """K at which arg L = −180°, L = K H / ((1 + s t_f)(M s² + D s + K_a)).

    H = (k + s) G/(s + k G), G = e^(−sd)/(1 + sτ).
    """
    rng = np.random.default_rng(seed)
    tau, delay, lag = rng.uniform(0.01, 0.06), rng.uniform(0.0, 0.03), rng.uniform(0.001, 0.02)
    damping, gain = rng.uniform(50, 500), float(rng.choice([0.5, 1.0, 3.0]))
    mass, spring = (
        float(rng.choice([0.0, rng.uniform(0.2, 3)])),
        float(rng.choice([0.0, rng.uniform(10, 300)])),
    )
    contact = Admittance(
        axes="base",
        translation=Compliance(mass=mass, damping=damping, stiffness=["rigid", "rigid", spring]),
        sensor=ForceSensor(filter=lag),
    )
    found = limit_of(contact, Servo(time_constant=tau, delay=delay), 0.002, gain).stiffness

    def loop(omega):
        s = 1j * omega
        g = cmath.exp(-s * delay) / (1 + s * tau)
        return (gain + s) * g / (s + gain * g) / ((1 + s * lag) * (mass * s * s + damping * s + spring))

    omega = np.geomspace(0.5, 1e3, 20_000)
    values = np.array([loop(each) for each in omega])
    crossed = np.flatnonzero(np.diff(np.sign(values.imag)) * (values.real[:-1] < 0))
    expected = min(-1.0 / values.real[k] for k in crossed)
    assert found == pytest.approx(expected, rel=0.1)


@pytest.mark.parametrize("seed", range(6))
def test_the_rule_by_heart_is_on_the_safe_side(seed):
    """D ≥ K (τ + d + t_f + M/D) is borne, with a factor to spare."""
    rng = np.random.default_rng(seed)
    tau, delay, lag, damping = rng.uniform(0.01, 0.06), rng.uniform(0, 0.03), rng.uniform(0.001, 0.02), 200.0
    mass = float(rng.uniform(0, 4))
    translation = Compliance(mass=mass, damping=damping, stiffness=["rigid", "rigid", 0.0])
    contact = Admittance(axes="base", translation=translation, sensor=ForceSensor(filter=lag))
    rule = damping / (tau + delay + lag + mass / damping)
    found = limit_of(contact, Servo(time_constant=tau, delay=delay), 0.002).stiffness
    assert 1.3 < found / rule < 6


def test_turning_axes_have_a_limit_too():
    """A moment on a spring that turns is the same loop as a force on one that is pressed."""
    turning = Admittance(axes="base", rotation=Compliance(damping=5.0, stiffness=["rigid", "rigid", 0.0]))
    pressing = Admittance(axes="base", translation=Compliance(damping=5.0, stiffness=["rigid", "rigid", 0.0]))
    servo = Servo(time_constant=0.04, delay=0.012)
    about, along = limit_of(turning, servo, 0.004), limit_of(pressing, servo, 0.004)
    assert about.axis == "mz"
    assert about.stiffness == pytest.approx(along.stiffness, rel=1e-3)


def late_force(stiffness, damping, seconds=6.0):
    """Return by how much the force still moves in the last second, on a wall that x and z meet at 45°, N."""
    push, turn = 2.0 / np.sqrt(2), np.radians(45)
    normal = np.array([np.sin(turn), 0.0, np.cos(turn)])
    middle = PLACE - (0.0005 + 0.02) * normal
    wall = dqc.world.Body(
        box=(0.6, 0.6, 0.04), position=tuple(middle), rpy=(0, float(turn), 0), stiffness=stiffness
    )
    plant = Servo(time_constant=0.04, delay=0.01, wrist=Wrist()).in_world(dqc.World(bodies={"wall": wall}))
    contact = Admittance(
        axes="base",
        translation=Compliance(damping=damping, stiffness=[0.0, "rigid", 0.0]),
        force=WantedWrench(x=push, z=push),
        ramp=0.0,
    )
    law = dqc.laws.ProportionalFeedforward(gain=1.0, contact=contact)
    record = dqc.simulate(ARM, SetPoint(HAND), law, plant, START, 0.004, seconds)
    force = record.readings["touch_force"].values[record.time > seconds - 1.0] @ normal
    return float(np.ptp(force))


def test_two_axes_that_a_wall_couples_bear_what_each_does():
    """Quiet at the least limit of the two, so on the safe side, and growing 20 % above it where both are alike."""
    servo, damping = Servo(time_constant=0.04, delay=0.01), [200.0, 0.0, 200.0]
    contact = Admittance(
        axes="base", translation=Compliance(damping=damping, stiffness=[0.0, "rigid", 0.0]), ramp=0.0
    )
    limit = limit_of(contact, servo, 0.004).stiffness
    assert late_force(0.95 * limit, damping, 12.0) < 0.1
    assert late_force(1.2 * limit, damping) > 1.0
    uneven = [200.0, 0.0, 800.0]
    contact = Admittance(
        axes="base", translation=Compliance(damping=uneven, stiffness=[0.0, "rigid", 0.0]), ramp=0.0
    )
    least = limit_of(contact, servo, 0.004).stiffness
    assert least == pytest.approx(limit, rel=1e-6)
    assert late_force(least, uneven) < 0.1


@pytest.mark.parametrize("stiffness", [1e4, 1e5])
@pytest.mark.parametrize(
    ("tau", "delay", "lag", "period"), [(0.04, 0.01, 0.005, 0.008), (0.01, 0.002, 0.002, 0.001)]
)
def test_a_contact_at_the_approach_speed_peaks_at_three_times_the_wanted_force(
    stiffness, tau, delay, lag, period
):
    """At most, and no less than 20 % below: the reference runs into the wall and stops where it feels a newton."""
    wanted, gap, way = 10.0, 0.01, 0.025
    wall = dqc.world.Body(
        box=(0.6, 0.6, 0.04), position=(PLACE[0], PLACE[1], PLACE[2] - gap - 0.02), stiffness=stiffness
    )
    servo = Servo(time_constant=tau, delay=delay, wrist=Wrist(filter=lag))
    contact = Admittance(
        axes="base",
        translation=Compliance(
            damping=2 * stiffness * (tau + delay + lag), stiffness=["rigid", "rigid", 0.0]
        ),
        force=WantedWrench(z=wanted),
        sensor=ForceSensor(filter=lag),
        ramp=0.0,
    )
    speed = limit_of(contact, servo, period, environment=stiffness).approach_speed
    down = Guarded(Straight(HAND, way=(0, 0, -way), duration=way / speed, steady=True), force=1.0)
    law = dqc.laws.ProportionalFeedforward(gain=1.0, contact=contact)
    plant = servo.in_world(dqc.World(bodies={"wall": wall}))
    record = dqc.simulate(ARM, down, law, plant, START, period, duration=min(way, gap + 0.3 * speed) / speed)
    peak = record.readings["touch_force"].values[:, 2].max()
    assert 0.8 * 3 * wanted < peak <= 3 * wanted


@pytest.mark.parametrize("mass", [0.0, 0.1, 100.0])
@pytest.mark.parametrize("lag", [0.0, 1e-4, 0.05])
def test_filter_and_loose_part_over_a_period_are_those_of_the_matrix_exponential(mass, lag):
    for stiffness, period in itertools.product(np.geomspace(10, 1e8, 8), (0.001, 0.033)):
        inner, by_begin, by_end, force, direct = _environment(stiffness, mass, lag, period)
        states, x = len(inner), len(inner) - 2
        rates = np.zeros((states + 2, states + 2))
        rates[states, states + 1] = 1.0
        if mass:
            frequency = np.sqrt(stiffness / mass)
            rates[x, x + 1], rates[x + 1, x], rates[x + 1, states] = frequency, -frequency, frequency
        if lag:
            rates[0, 0] = rates[0, states] = -1 / lag
            if mass:
                rates[0, x] = 1 / lag
        moved = expm(rates * period)[:states]
        assert inner == pytest.approx(moved[:, :states], abs=1e-10)
        assert by_end == pytest.approx(moved[:, states + 1] / period, abs=1e-10)
        assert by_begin + by_end == pytest.approx(moved[:, states], abs=1e-10)
        assert direct == (0 if lag else -stiffness)
        assert force == pytest.approx(stiffness * np.eye(states)[0 if lag else x] if states else np.zeros(0))

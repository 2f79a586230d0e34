"""What a step with an admittance costs, and how it presses beside two published ones in the same simulation.

The step from Python is that of K+FF on an iiwa7, with and without ``contact`` (≤ 1.15 wanted), in turns.

Each admittance is the stage before the same law on the same servos (40 ms lag, 12 ms delay, sensor filter 5 ms,
T = 4 ms): 2 N wanted on a wall 2 mm below. Only how y and its rate go on differs:

* ours: exact step, no mass, damping twice the least that `contact_limits` says for the wall;
* constant gain: the same step with 200 N·s/m, whatever the wall;
* ros2_control's admittance controller: v ← v + T (w − D v − K y)/M, y ← y + T v, D = 2 ζ √(M K), with M = 3 kg,
  K = 50 N/m and ζ = 2.83. As it has no damping where K is 0, a spring stays in the force axis.

Printed are the force's mean and standard deviation in the last 2 of 20 s, and its peak.
"""

from __future__ import annotations

import math
from functools import partial
from unittest.mock import patch

import numpy as np
from measure import medians

import dqcontrol as dqc
from dqcontrol import algebra
from dqcontrol.contact import Admittance, Compliance, ForceSensor, WantedWrench, contact_limits
from dqcontrol.plants import Servo, Wrist
from dqcontrol.tables import Column, Table

ARM, START, PERIOD = dqc.load_robot("iiwa7"), np.array([0, 0.6, 0, -1.6, 0, 0.9, 0]), 0.004
HAND = ARM.fkm(START)
SERVO = Servo(time_constant=0.04, delay=0.012)
WANTED, GAP, SECONDS = 2.0, 2e-3, 20.0  # N, m, s
MASS, STIFFNESS, RATIO = 3.0, 50.0, 2.83
WALLS = 1e3, 5e3, 2e4, 1e5  # N/m


def euler_step(mass: float, damping: float, stiffness: float, period: float) -> np.ndarray:
    """Return what y and v become by y, v and force, six numbers: v ← v + T a, y ← y + T v."""
    if mass == 0.0:  # a rigid axis
        return np.zeros(6)
    rate = np.array([-period * stiffness / mass, 1.0 - period * damping / mass, period / mass])
    return np.array([*(np.array([1.0, 0.0, 0.0]) + period * rate), *rate])


def pressing(stiffness: float = 0.0, **axis: float) -> Admittance:
    """Return an admittance that presses along z with the given M, D and K."""
    return Admittance(
        axes="base",
        translation=Compliance(stiffness=["rigid", "rigid", stiffness], **axis),
        force=WantedWrench(z=WANTED),
        sensor=ForceSensor(filter=0.005),
        ramp=0.0,
    )


def pressed(contact: Admittance, stiffness: float) -> list[float]:
    """Return mean and standard deviation of the force at the end, and its peak, N."""
    x, y, z = algebra.translation(HAND)
    board = dqc.world.Body(box=(0.4, 0.4, 0.04), position=(x, y, z - GAP - 0.02), stiffness=stiffness)
    plant = Servo(time_constant=0.04, delay=0.012, wrist=Wrist(filter=0.005)).in_world(
        dqc.World(bodies={"board": board})
    )
    law = dqc.laws.ProportionalFeedforward(gain=1.0, contact=contact)
    record = dqc.simulate(ARM, dqc.references.SetPoint(HAND), law, plant, START, PERIOD, SECONDS)
    force = record.readings["touch_force"].values[:, 2]
    end = force[record.time > record.time[-1] - 2.0]
    return [float(end.mean()), float(end.std()), float(force.max())]


def damping_for(stiffness: float) -> float:
    """Return twice the least damping for a wall, N·s/m."""
    law = dqc.laws.ProportionalFeedforward(gain=1.0).prepare(ARM, None, PERIOD)
    asked = contact_limits(pressing(damping=200.0), law, SERVO, START, stiffness)
    return 2 * asked.least_damping


def walls() -> Table:
    """Return how each presses on each wall."""
    columns = [Column("admittance"), Column("wall", "kN/m", "g"), Column("damping", "N·s/m", ".0f")]
    columns += [Column(name, "N", ".3g") for name in ("mean", "sd", "peak")]
    euler = 2 * RATIO * math.sqrt(MASS * STIFFNESS)
    rows: list[list[object]] = []
    for stiffness in WALLS:
        own = damping_for(stiffness)
        rows.append(["ours, by check", stiffness / 1e3, own, *pressed(pressing(damping=own), stiffness)])
        rows.append(["constant gain", stiffness / 1e3, 200.0, *pressed(pressing(damping=200.0), stiffness)])
        with patch("dqcontrol.contact.admittance.exact_step", euler_step):
            found = pressed(pressing(STIFFNESS, mass=MASS, damping=euler), stiffness)
        rows.append(["ros2_control's", stiffness / 1e3, euler, *found])
    return Table(columns, rows, f"2 N wanted on a wall {1e3 * GAP:g} mm below")


def step_cost() -> float:
    """Return a step of K+FF with an admittance over one without, called from Python."""
    calls = {}
    for name, contact in (("without", None), ("with", pressing(damping=200.0))):
        law = dqc.laws.ProportionalFeedforward(gain=1.0, contact=contact)
        circle = dqc.references.Circle(HAND, radius=0.05, duration=8.0)
        ready = law.prepare(ARM, circle, PERIOD)
        if contact is not None:
            ready.wrench[:] = 0.0
        state, out = ready.initial_state(START), np.empty(7)
        calls[name] = partial(ready.command, START, circle.at(4.0), state, out)
    times = medians(calls, 3000)
    print(f"a step of K+FF: {times['without']:.2f} µs, with an admittance {times['with']:.2f} µs")
    return times["with"] / times["without"]


def main() -> None:
    """Print both."""
    print(walls().markdown())
    print(f"ratio {step_cost():.2f}  (≤ 1.15 wanted)")


if __name__ == "__main__":
    main()

"""How near a hand comes to circles that ask for more than an arm's limits allow, against the best that each sample has.

Random circles (seeded; 8 to 20 cm, 1.5 to 4 s, any of three planes) from random configurations; kept are those that
K+FF at 20/s with ideal joints, T = 5 ms, follows to 2 cm without limits, and that go beyond a limit of velocity or
position. "best sample": in each sample the joint speeds within the limits that leave the least |[ℓω ; ṗ]| of what the
law asks for, an exact quadratic program (SciPy's bounded least squares): what Pink's or DQ Robotics' solvers find,
given the same weights. "slower": the same circle in as much more time as velocity limits ask for. Position errors'
maxima along the circles, mm: quartiles.

python benchmarks/path_limits.py           # quartiles of several arms
python benchmarks/path_limits.py --each    # every circle of them
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import lsq_linear

import dqcontrol as dqc
from dqcontrol import algebra
from dqcontrol.laws import ProportionalFeedforward
from dqcontrol.limits import CommandLimits, ModifiedClamping
from dqcontrol.loop import Record
from dqcontrol.plants import Integrator
from dqcontrol.robots import Robot
from dqcontrol.tables import Column, Table

Array = np.ndarray
ROBOTS, COUNT, SEED = ("panda", "iiwa7", "ur5"), 124, 3
PERIOD, GAIN = 0.005, 20.0
FOLLOWED, REGULAR, WIDEST = 0.02, 0.1, 3.1  # m; least singular value at the start; rad
LAW = ProportionalFeedforward(gain=GAIN)
SHARPER = ProportionalFeedforward(gain=GAIN, inverse=dqc.laws.FilteredInverse(threshold=0.01, damping=0.005))
WEIGHT = np.diag([LAW.inverse.characteristic_length] * 3 + [1.0] * 3)
BOTH = CommandLimits(position=ModifiedClamping(), velocity=True)
TITLES = ("scaled", "clamped and held", "the same, ε = 0.01", "best sample", "slower")


@dataclass(frozen=True)
class Circle:
    """A circle beyond the limits: where it starts, its motion, and the share of a velocity limit that it asks for."""

    number: int
    start: Array
    arguments: dict[str, Any]
    share: float
    beyond: float

    def reference(self, arm: Robot, slower: float = 1.0) -> dqc.references.Circle:
        """Return the motion, in more time."""
        given = self.arguments | {"duration": slower * self.arguments["duration"]}
        return dqc.references.Circle(arm.fkm(self.start), **given)


def follow(
    arm: Robot, circle: Circle, law: dqc.laws.Law, limits: CommandLimits | None, slower: float = 1.0
) -> Record:
    """Return a run along a circle."""
    reference = circle.reference(arm, slower)
    return dqc.simulate(arm, reference, law, Integrator(), circle.start, PERIOD, limits=limits)


def circles(arm: Robot) -> list[Circle]:
    """Return those that can be followed without limits and go beyond them."""
    lower, upper, rng = arm.limits.lower, arm.limits.upper, np.random.default_rng(SEED)
    found = []
    for number in range(COUNT):
        start = rng.uniform(0.9 * np.maximum(lower, -WIDEST), 0.9 * np.minimum(upper, WIDEST))
        if np.linalg.svd(arm.hand_jacobian(start), compute_uv=False)[-1] < REGULAR:
            continue
        arguments: dict[str, Any] = {"radius": rng.uniform(0.08, 0.2), "duration": rng.uniform(1.5, 4.0)}
        arguments["plane"] = str(rng.choice(["xz", "yz", "xy"]))
        circle = Circle(number, start, arguments, 0.0, 0.0)
        free = follow(arm, circle, LAW, None)
        share = float((np.abs(free.command) / arm.limits.velocity).max())
        beyond = float(np.maximum(free.q - upper, lower - free.q).max())
        if free.position_error.max() < FOLLOWED and (share > 1 or beyond > 0):
            found.append(Circle(number, start, arguments, share, beyond))
    return found


def asked(arm: Robot, q: Array, sample: dqc.Sample) -> Array:
    """Return the hand's [ω ; ṗ] that feed-forward and 1/s of the way to the desired pose ask for."""
    pose = arm.fkm(q)
    back = algebra.conjugate(pose)
    error = algebra.short(algebra.multiply(back, sample.pose))
    body = 2 * GAIN * algebra.log_body(error) + algebra.adjoint_twist(back, sample.twist)
    return algebra.adjoint_twist(np.concatenate([pose[:4], np.zeros(4)]), body)


def best_samples(arm: Robot, circle: Circle) -> float:
    """Return the largest position error where each sample's command is the best within the limits, m."""
    reference, q, worst, n = circle.reference(arm), circle.start.copy(), 0.0, arm.input_size
    lower, upper, fastest = arm.limits.lower, arm.limits.upper, arm.limits.velocity
    for time in np.arange(0, reference.duration, PERIOD):
        sample = reference.at(time)
        way = algebra.translation(arm.fkm(q)) - algebra.translation(sample.pose)
        worst = max(worst, float(np.linalg.norm(way)))
        matrix = np.vstack([WEIGHT @ arm.hand_jacobian(q), 1e-4 * np.eye(n)])  # of many the shortest
        wanted = np.concatenate([WEIGHT @ asked(arm, q, sample), np.zeros(n)])
        least = np.maximum(-fastest, np.minimum((lower - q) / PERIOD, 0.0)) - 1e-12
        most = np.minimum(fastest, np.maximum((upper - q) / PERIOD, 0.0)) + 1e-12
        u = np.linalg.lstsq(matrix, wanted, rcond=None)[0]
        if ((u < least) | (u > most)).any():
            u = lsq_linear(matrix, wanted, (least, most), method="bvls").x
        q = q + PERIOD * u
    return worst


def errors(arm: Robot, circle: Circle) -> list[float]:
    """Return the largest position error in each way of keeping the limits, mm; NaN where slower does not help."""
    runs = (
        follow(arm, circle, LAW, CommandLimits(velocity=True, position=None)),
        follow(arm, circle, LAW, BOTH),
        follow(arm, circle, SHARPER, BOTH),
    )
    found = [float(run.position_error.max()) for run in runs] + [best_samples(arm, circle)]
    if circle.share > 1 and circle.beyond <= 0:
        found.append(float(follow(arm, circle, LAW, BOTH, 1.01 * circle.share).position_error.max()))
    else:
        found.append(float("nan"))
    return [1e3 * error for error in found]


def main() -> None:
    """Print tables."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--each", action="store_true", help="every circle")
    each, rows = parser.parse_args().each, []
    for name in ROBOTS:
        arm = dqc.load_robot(name)
        found = [(circle, errors(arm, circle)) for circle in circles(arm)]
        if each:
            columns = [
                Column("circle"),
                Column("speed", "of its limit", ".2f"),
                Column("beyond", "rad", ".2f"),
            ]
            columns += [Column(title, "mm", ".2f") for title in TITLES]
            lines = [[c.number, c.share, max(c.beyond, 0.0), *values] for c, values in found]
            print(f"{name}\n\n{Table(columns, lines).markdown()}")
        values = np.array([values for _, values in found])
        quartiles = np.nanquantile(values, [0.25, 0.5, 0.75], axis=0)
        texts = [" · ".join(f"{value:.2f}" for value in column) for column in quartiles.T]
        rows.append([name, len(found), *texts])
    columns = [Column("robot"), Column("circles"), *(Column(title, "mm") for title in TITLES)]
    print(Table(columns, rows).markdown())


if __name__ == "__main__":
    main()

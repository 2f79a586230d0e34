"""A law that keeps constraints: time of a step and of its parts.

    python benchmarks/constraints.py [--runs 100]

Runs: the worst distance below what was asked, with 20 instants a period, of random scenes with things that move.
"""

from __future__ import annotations

import argparse
import sys
import time
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from measure import Ratio, medians, table

import dqcontrol as dqc
from dqcontrol.geometry import Capsule, distance
from dqcontrol.geometry import distance_kernels as geometry
from dqcontrol.laws.constrained.prepared_constraints import PreparedConstraints

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "laws"))

PERIOD = 0.01
HOME = np.array([0.0, -0.3, 0.0, -2.0, 0.0, 1.8, 0.7])


def fenced(arm: dqc.Robot, balls: np.ndarray, **options: Any) -> dqc.laws.Constraints:
    """Return constraints with balls of 60 mm at these centres."""
    obstacles: dict[str, Any] = {
        f"ball {i}": dqc.laws.SphereObstacle(center=tuple(ball), radius=0.06) for i, ball in enumerate(balls)
    }
    return dqc.laws.Constraints(obstacles=obstacles, **options)


def around(arm: dqc.Robot, rng: np.random.Generator, count: int) -> np.ndarray:
    """Return random centres around the arm."""
    return rng.uniform([-0.1, -0.7, 0.2], [0.8, 0.7, 1.0], (count, 3))


def step_ratios(short: bool) -> list[Ratio]:
    """Return a step with all limits and 51 pairs against one of Mink, and without constraints."""
    arm = dqc.load_robot("panda")
    rng = np.random.default_rng(1)
    hand = dqc.DualQuaternion(arm.fkm(HOME)).translation
    while True:
        balls = around(arm, rng, 6)
        given = fenced(arm, balls, acceleration=10.0)
        law = dqc.laws.Proportional(gain=3.0, constraints=given).prepare(arm, None, PERIOD)
        kept = PreparedConstraints(given, arm, PERIOD, "measured")
        room = kept.values(HOME[None], [0.0])[0]
        if 0.02 < room.min() < 0.08 and np.linalg.norm(balls - hand, axis=1).min() < 0.3:
            break
    free = dqc.laws.Proportional(gain=3.0).prepare(arm, None, PERIOD)
    sample = dqc.Sample(arm.fkm(HOME + 0.3))
    state, plain = law.initial_state(HOME), free.initial_state(HOME)
    out = np.empty(7)

    def step() -> None:
        law.sent(state, out * 0.0)
        law.command(HOME, sample, state, out)

    functions = {"ours": step, "without": lambda: free.command(HOME, sample, plain, out)}
    t = medians(functions, 500, 3 if short else 15)
    times = np.empty(2000 if short else 100_000)
    for i in range(len(times)):
        begin = time.perf_counter()
        step()
        times[i] = time.perf_counter() - begin
    pairs = len(kept.labels)
    print(
        f"step, 7 joints, all limits, {pairs} pairs: {t['ours']:.2f} µs (without constraints {t['without']:.2f}), "
        f"single steps: median {1e6 * np.median(times):.2f}, p99.9 {1e6 * np.quantile(times, 0.999):.2f} µs; "
        f"{law.report[0]:.0f} rows active, {law.report[1]:.0f} programs"
    )
    found = [Ratio(f"step, {pairs} pairs", t["ours"], "µs", "the same law without", t["without"], "≤ 20")]
    if find_spec("mink"):
        from quadratic_programs import by_mink

        goal = np.asarray(dqc.DualQuaternion(arm.fkm(HOME + 0.3)).matrix())
        mink = medians({"mink": by_mink(goal, arm)}, 500, 3 if short else 15)["mink"]
        found.append(
            Ratio(f"step, {pairs} pairs", t["ours"], "µs", "Mink without collisions", mink, "≤ 0.05")
        )
    return found


def capsule_time() -> float:
    """Return ns of a pair of capsules in a compiled loop."""
    rng = np.random.default_rng(2)
    ends = rng.normal(size=(2, 10_000, 2, 3))
    a, b = (np.array([Capsule(start, end, 0.1).row for start, end in each]) for each in ends)
    out = np.empty((len(a), geometry.FOUND))
    t = medians({"pairs": lambda: geometry.distances(a, b, out)}, 10, 9)
    return 1e3 * t["pairs"] / len(a)


def capsule_ratio() -> list[Ratio]:
    """Return a pair of capsules in a compiled loop against Coal from Python, distances compared."""
    ours = capsule_time()
    print(f"capsule and capsule in a loop: {ours:.0f} ns")
    if not find_spec("coal"):
        return []
    import coal

    rng = np.random.default_rng(2)
    first, second = coal.Capsule(0.1, 1.0), coal.Capsule(0.1, 0.7)
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    places = [(coal.Transform3s(), coal.Transform3s()) for _ in range(100)]
    for a, b in places:
        a.setTranslation(rng.normal(size=3))
        b.setTranslation(rng.normal(size=3) + 1.5)
        for each in (a, b):
            turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
            each.setRotation(turn * np.sign(np.linalg.det(turn)))

    def capsule(shape: Any, place: Any) -> Capsule:
        half = shape.halfLength * place.getRotation()[:, 2]
        return Capsule(place.getTranslation() - half, place.getTranslation() + half, shape.radius)

    def theirs() -> None:
        for a, b in places:
            result.clear()
            coal.distance(first, a, second, b, request, result)

    for a, b in places:
        result.clear()
        found = distance(capsule(first, a), capsule(second, b)).distance
        if not abs(coal.distance(first, a, second, b, request, result) - found) < 1e-9:
            raise SystemExit("capsules: differs from Coal")
    t = medians({"coal": theirs}, 10, 9)["coal"] / len(places)
    return [Ratio("capsule and capsule in a loop", 1e-3 * ours, "µs", "Coal, from Python", t, "≤ 0.07")]


def runs(count: int) -> None:
    """Print the worst distance below what was asked of random runs."""
    from constraint_scenes import least_room, random_constraints, random_goal

    arm, rng, worst = dqc.load_robot("panda"), np.random.default_rng(5), np.inf
    excess = -np.inf
    for _ in range(count):
        period, acceleration = float(rng.uniform(0.001, 0.01)), float(rng.uniform(5, 20))
        law = dqc.laws.Proportional(
            gain=3.0, constraints=random_constraints(rng, arm, HOME, acceleration=acceleration)
        )
        goal = random_goal(rng, arm)
        record = dqc.simulate(arm, goal, law, dqc.plants.Integrator(), HOME, period, 1.5)
        worst = min(worst, least_room(law.prepare(arm, goal, period), record, period))
        excess = max(excess, float(record.readings["kept_effect"].values[:, 3].max()))
    print(
        f"{count} runs, 20 instants a period: worst shortfall {max(-worst, 0.0):.3g} m, "
        f"largest excess of acceleration {max(excess, 0.0):.3g} of its limit"
    )


def ratios(short: bool) -> list[Ratio]:
    """Return a pair of capsules and a step."""
    return [*capsule_ratio(), *step_ratios(short)]


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--runs", type=int, default=100)
    options = parser.parse_args()
    print(table(ratios(short=False), "Constraints").markdown())
    runs(options.runs)

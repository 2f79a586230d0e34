"""A law that keeps constraints: time of a step and of its parts.

    python benchmarks/constraints.py [--runs 100]

Runs: the worst distance below what was asked, with 20 instants a period, of random scenes with things that move, and
beside Mink (where installed; as shipped and corrected as `reactive_scenes.py` says) of the same scenes standing still.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from measure import Ratio, medians, table
from msgspec import structs

import dqcontrol as dqc
from dqcontrol.constraints.prepared_constraints import PreparedConstraints
from dqcontrol.geometry import Capsule, distance_kernels as geometry

sys.path[:0] = [
    str(Path(__file__).parents[1] / "tests" / "constraints"),
    str(Path(__file__).parents[1] / "tests"),
]

PERIOD = 0.01
LASTING = 1.5  # s of a random run
ROUNDING = 1e-9  # m
HOME = np.array([0.0, -0.3, 0.0, -2.0, 0.0, 1.8, 0.7])


def fenced(arm: dqc.Robot, balls: np.ndarray, **options: Any) -> dqc.constraints.Constraints:
    """Return constraints with balls of 60 mm at these centres."""
    bodies = {f"ball {i}": dqc.world.Body(sphere=0.06, position=tuple(ball)) for i, ball in enumerate(balls)}
    return dqc.constraints.Constraints(world=dqc.World(bodies=bodies), clear_of="all", **options)


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
    times, same = np.empty((2, 2000 if short else 100_000))
    fixed = _fixed_work(1e-6 * t["ours"])
    for i in range(len(times)):
        times[i], same[i] = _thread_time(step), _thread_time(fixed)
    pairs = len(kept.labels)
    print(
        f"step, 7 joints, all limits, {pairs} pairs: {t['ours']:.2f} µs (without constraints {t['without']:.2f}), "
        f"single steps: median {1e6 * np.median(times):.2f}, p99.9 {1e6 * np.quantile(times, 0.999):.2f} µs; "
        f"{law.report[0]:.0f} rows active, {law.report[1]:.0f} programs"
    )
    found = [Ratio(f"step, {pairs} pairs", t["ours"], "µs", "the same law without", t["without"], "≤ 20")]
    tail, machine = (float(np.quantile(each, 0.999) / np.median(each)) for each in (times, same))
    found.append(Ratio("step, p99.9 of single ones", tail, "× the median", "", 1.0, "≤ 3"))
    found.append(Ratio("the same", tail, "× the median", "as much fixed work, in turns", machine, "≤ 1.2"))
    if find_spec("mink"):
        from constraint_peers import by_mink, correct

        theirs = by_mink(arm, fenced(arm, balls), arm.fkm(HOME + 0.3), correct(PERIOD))
        unhurried = dqc.laws.Proportional(gain=3.0, constraints=fenced(arm, balls))
        _check_direction(unhurried.command(arm, HOME, sample, period=PERIOD), theirs(HOME))
        mink = medians({"mink": lambda: theirs(HOME)}, 500, 3 if short else 15)["mink"]
        found.append(Ratio(f"step, {pairs} pairs", t["ours"], "µs", "Mink, same pairs", mink, "≤ 0.05"))
    return found


def _thread_time(function: Callable[[], object]) -> float:
    """Return the thread's own time of a call, s: what other processes take of the core is not in it."""
    begin = time.thread_time_ns()
    function()
    return 1e-9 * (time.thread_time_ns() - begin)


def _fixed_work(seconds: float) -> Callable[[], object]:
    """Return what takes about so long each time: what its tail is beyond the median is the machine's."""
    rng = np.random.default_rng(3)
    ends = rng.normal(size=(2, max(1, round(seconds / (1e-9 * capsule_time()))), 2, 3))
    a, b = (np.array([Capsule(start, end, 0.1).row for start, end in each]) for each in ends)
    out = np.empty((len(a), geometry.FOUND))
    return lambda: geometry.distances(a, b, out)


def _check_direction(ours: np.ndarray, theirs: np.ndarray) -> None:
    """Stop where commands without limits of acceleration, which Mink does not have, go another way."""
    cosine = float(ours @ theirs / (np.linalg.norm(ours) * np.linalg.norm(theirs)))
    print(f"direction of the command against that of Mink: cosine {cosine:.3f}")
    if not cosine > 0.9:
        raise SystemExit("step: goes another way than Mink's")


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
    places = [(coal.Transform3s(), coal.Transform3s()) for _ in range(100_000)]
    for a, b in places:
        a.setTranslation(rng.normal(size=3))
        b.setTranslation(rng.normal(size=3) + 1.5)
        for each in (a, b):
            turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
            each.setRotation(turn * np.sign(np.linalg.det(turn)))

    def row(shape: Any, place: Any) -> np.ndarray:
        half = shape.halfLength * place.getRotation()[:, 2]
        return Capsule(place.getTranslation() - half, place.getTranslation() + half, shape.radius).row

    def coal_distance(a: Any, b: Any) -> float:
        result.clear()
        return float(coal.distance(first, a, second, b, request, result))

    found = np.empty((len(places), geometry.FOUND))
    geometry.distances(
        np.array([row(first, a) for a, _ in places]), np.array([row(second, b) for _, b in places]), found
    )
    apart = np.abs(found[:, geometry.DISTANCE] - [coal_distance(a, b) for a, b in places])
    print(f"capsules: {len(places)} pairs differ from Coal by {apart.max():.2g} m at most")
    if not apart.max() < 1e-9:
        raise SystemExit(f"capsules: {(apart >= 1e-9).sum()} pairs differ from Coal by more than 1e-9 m")
    some = places[:100]

    def theirs() -> None:
        for a, b in some:
            coal_distance(a, b)

    t = medians({"coal": theirs}, 10, 9)["coal"] / len(some)
    return [
        Ratio("capsule and capsule in a loop", 1e-3 * ours, "µs", "Coal, from Python", t, "≤ 0.07"),
        Ratio("capsule and capsule in a loop", ours, "ns", "", 1.0, "≤ 50"),
    ]


class Run(NamedTuple):
    """A random run: what is kept, where the hand shall go and how long a period is, s."""

    given: dqc.constraints.Constraints
    goal: dqc.references.SetPoint
    period: float


def random_runs(arm: dqc.Robot, count: int) -> Iterator[Run]:
    """Yield random runs, always the same."""
    from constraint_scenes import random_constraints, random_goal

    rng = np.random.default_rng(5)
    for _ in range(count):
        period, acceleration = float(rng.uniform(0.001, 0.01)), float(rng.uniform(5, 20))
        given = random_constraints(rng, arm, HOME, acceleration=acceleration)
        yield Run(given, random_goal(rng, arm), period)


def runs(count: int) -> None:
    """Print the worst distance below what was asked of random runs."""
    from constraint_scenes import least_room

    arm, worst, excesses = dqc.load_robot("panda"), np.inf, []
    for given, goal, period in random_runs(arm, count):
        law = dqc.laws.Proportional(gain=3.0, constraints=given)
        record = dqc.simulate(arm, goal, law, dqc.plants.Integrator(), HOME, period, LASTING)
        worst = min(worst, least_room(law.prepare(arm, goal, period), record, period))
        excesses.append(float(record.readings["constraint_effect"].values[:, 3].max()))
    exceeded = sum(each > ROUNDING for each in excesses)
    print(
        f"{count} runs, 20 instants a period: worst shortfall {max(-worst, 0.0):.3g} m, "
        f"limits of acceleration exceeded in {exceeded} runs, by {max(0.0, *excesses):.3g} of themselves at most"
    )


class Driven(NamedTuple):
    """What of a record tells how much room was left."""

    time: np.ndarray
    q: np.ndarray
    command: np.ndarray


def runs_beside_mink(count: int) -> None:
    """Print the worst distance below what was asked of the same runs without what Mink does not have."""
    from constraint_peers import AS_SHIPPED, by_mink, correct, driven
    from constraint_scenes import least_room

    arm = dqc.load_robot("panda")
    rooms: dict[str, list[float]] = {"ours": [], "Mink, corrected": [], "Mink, as shipped": []}
    for given, goal, period in random_runs(arm, count):
        plain = as_mink_has_it(given, arm)
        law = dqc.laws.Proportional(gain=3.0, constraints=plain)
        record = dqc.simulate(arm, goal, law, dqc.plants.Integrator(), HOME, period, LASTING)
        judge = law.prepare(arm, goal, period)
        rooms["ours"].append(least_room(judge, record, period))
        pose = np.asarray(goal.pose)
        for name, approach in (("Mink, corrected", correct(period)), ("Mink, as shipped", AS_SHIPPED)):
            step = by_mink(arm, plain, pose, approach, gain=3.0, period=period)
            q = driven(step, HOME, period, len(record.time) - 1)
            path = Driven(record.time, q, np.diff(q, axis=0, append=q[-1:]) / period)
            rooms[name].append(least_room(judge, path, period))
    shortfalls = {name: np.maximum(0.0, -np.array(each)) for name, each in rooms.items()}
    found = "; ".join(
        f"{name} {1e3 * each.max():.3g} mm ({(each > ROUNDING).sum()} runs below)"
        for name, each in shortfalls.items()
    )
    print(
        f"worst shortfall, {count} runs, 20 instants a period, "
        f"things still, links from the second on, no limits of acceleration: {found}"
    )


def as_mink_has_it(given: dqc.constraints.Constraints, arm: dqc.Robot) -> dqc.constraints.Constraints:
    """Return constraints without what Mink lacks: things that move, limits of acceleration, the first link's pairs."""
    assert arm.shapes is not None
    links = [each.name for each in arm.shapes.shapes if each.frame > 1]
    assert given.world is not None
    still = {name: structs.replace(body, moves=None) for name, body in given.world.bodies.items()}
    clear_of = {
        name: structs.replace(each.clear, links=each.clear.links or links)
        for name, each in given.obstacles.items()
    }
    return structs.replace(given, world=dqc.World(bodies=still), clear_of=clear_of, acceleration=None)


def ratios(short: bool) -> list[Ratio]:
    """Return a pair of capsules and a step."""
    return [*capsule_ratio(), *step_ratios(short)]


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--runs", type=int, default=100)
    options = parser.parse_args()
    print(table(ratios(short=False), "Constraints").markdown())
    runs(options.runs)
    if find_spec("mink"):
        runs_beside_mink(options.runs)

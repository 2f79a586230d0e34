"""Reactive scenes: how often a Panda reaches a pose among balls, by our law, Mink and NEO, and what became of the rest.

    python benchmarks/reactive_scenes.py [--scenes 200] [--jobs 2]

NEO's own scenes are published in no package, so these are made: three balls of 60 mm, start and goal at random and
clear of them by 30 mm, the straight way of the joints not clear, and a way over one or no random configuration that is
clear: every scene can be solved. Everybody gets the same capsules and balls, joints that do what they are told, 10 ms a
step, 15 s, 2/s of gain, 10 mm to keep, and the limits of the joints; ours also an acceleration of 10 rad/s².

* ours: K with constraints and their escape (a hand that is held goes aside, or the joints go to another posture), and
  without it;
* escape: plan: where the hand is held, a way is planned from there;
* planned: the way is planned and proved before (`dqc.planning`), and followed by a law that keeps the same constraints;
* Mink: its collision limit bounds a step, m, by gain (d − d_min)/T, m/s; as shipped (gain 0.85), and corrected to
  gain = η T², which bounds the speed of approach by η (d − d_min), η = 10/s;
* NEO (Haviland and Corke 2021), the quadratic program of the paper with slack, manipulability and dampers, written here
  with the signs that finite differences confirm (`robots toolbox` has 54 % of the rows wrong), solved by DAQP.

Distances are measured by `geometry` at every sample, for all alike. Ends: reached (10 mm and 0.05 rad), collision (a
distance below 0 at any sample), limit (a joint beyond its range, or a joint at it while nothing moves), deadlock (the
hand moved less than 5 mm in the last 2 s), timeout.
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from importlib.util import find_spec
from typing import Literal

import numpy as np
from constraint_peers import (
    AS_SHIPPED,
    GAIN,
    PERIOD,
    Neo,
    by_mink,
    check_neo,
    correct,
    driven,
    rotation_vector,
)
from constraints import around, fenced

import dqcontrol as dqc
from dqcontrol import algebra
from dqcontrol.constraints.prepared_constraints import PreparedConstraints

MOST = 15.0  # s
POSITION, ANGLE = 0.01, 0.05  # m and rad: reached
STILL = 0.005  # m in the last 2 s
ESCAPE = 2.0  # m/s: about as fast as the gain starts the hand
KINDS = ("reached", "collision", "limit", "deadlock", "timeout")
SEED = 4


def scene(rng: np.random.Generator, arm: dqc.Robot) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return balls, start and goal of a scene that has a way."""
    low, high = np.maximum(arm.limits.lower, -2.0), np.minimum(arm.limits.upper, 2.8)
    steps = np.linspace(0, 1, 60)[:, None]
    while True:
        balls = around(arm, rng, 3)
        kept = PreparedConstraints(fenced(arm, balls), arm, PERIOD, "measured")

        def clear(q: np.ndarray, kept: PreparedConstraints = kept) -> bool:
            return bool(kept.values(q, np.zeros(len(q))).min() > 0.03)

        def straight(a: np.ndarray, b: np.ndarray) -> np.ndarray:
            return a + steps * (b - a)

        start, goal = rng.uniform(low, high, (2, 7))
        if not clear(np.vstack([start, goal])) or clear(straight(start, goal)):
            continue
        for _ in range(30):
            via = rng.uniform(low, high)
            if clear(straight(start, via)) and clear(straight(via, goal)):
                return balls, start, goal


def by_ours(
    arm: dqc.Robot,
    balls: np.ndarray,
    goal: np.ndarray,
    start: np.ndarray,
    escape: float | Literal["plan"] | None,
) -> np.ndarray:
    """Return the configurations that our law drives through, shape (N, n), rad."""
    law = dqc.laws.Proportional(gain=GAIN, constraints=fenced(arm, balls, acceleration=10.0, escape=escape))
    target = dqc.references.SetPoint(goal)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", dqc.errors.NoteWarning)  # of plans
        return dqc.simulate(arm, target, law, dqc.plants.Integrator(), start, PERIOD, MOST).q


def by_plan(arm: dqc.Robot, balls: np.ndarray, goal: np.ndarray, start: np.ndarray) -> np.ndarray:
    """Return the configurations of a planned way that our law follows, (N, n), rad; the start if there is none."""
    given = fenced(arm, balls, acceleration=10.0)
    try:
        found = dqc.planning.plan(arm, PreparedConstraints(given, arm, PERIOD, "measured"), start, goal)
    except dqc.errors.PlanError:
        return start[None]
    law = dqc.laws.GuidedProportional(gain=GAIN, pull=5.0, constraints=given)
    way = dqc.planning.PlanTo(found)
    return dqc.simulate(
        arm, way, law, dqc.plants.Integrator(), start, PERIOD, min(way.duration + 1.0, MOST)
    ).q


def end_of(
    arm: dqc.Robot, kept: PreparedConstraints, goal: np.ndarray, path: np.ndarray
) -> tuple[str, float]:
    """Return how a way ended, and its least distance, m."""
    least = float(kept.values(path, np.zeros(len(path))).min())
    hand = arm.fkm(path)
    places = algebra.translation(hand)
    last = np.asarray(dqc.DualQuaternion(hand[-1]).matrix())
    wanted = np.asarray(dqc.DualQuaternion(goal).matrix())
    away = float(np.linalg.norm(wanted[:3, 3] - last[:3, 3]))
    turned = float(np.linalg.norm(rotation_vector(wanted[:3, :3] @ last[:3, :3].T)))
    room = np.minimum(path - arm.limits.lower, arm.limits.upper - path)
    if least < 0:
        return "collision", least
    if room.min() < -1e-6:
        return "limit", least
    if away < POSITION and turned < ANGLE:
        return "reached", least
    if np.ptp(places[-round(2.0 / PERIOD) :], axis=0).max() < STILL:
        return "limit" if room[-1].min() < 0.01 else "deadlock", least
    return "timeout", least


def ways_of(
    arm: dqc.Robot, balls: np.ndarray, goal: np.ndarray, start: np.ndarray
) -> dict[str, Callable[[], np.ndarray]]:
    """Return what drives through a scene by each method that is installed."""
    ways: dict[str, Callable[[], np.ndarray]] = {
        "ours": partial(by_ours, arm, balls, goal, start, ESCAPE),
        "ours, without escape": partial(by_ours, arm, balls, goal, start, None),
    }
    if find_spec("ompl") and find_spec("toppra"):
        ways["ours, escape: plan"] = partial(by_ours, arm, balls, goal, start, "plan")
        ways["ours, planned"] = partial(by_plan, arm, balls, goal, start)
    if find_spec("mink"):
        for name, approach in (("Mink, corrected", correct(PERIOD)), ("Mink, as shipped", AS_SHIPPED)):
            step = by_mink(arm, fenced(arm, balls), goal, approach)
            ways[name] = partial(driven, step, start, PERIOD, round(MOST / PERIOD))
    if find_spec("daqp"):
        ways["NEO, corrected"] = partial(
            driven, Neo(arm, balls, goal).step, start, PERIOD, round(MOST / PERIOD)
        )
    return ways


def ends_of_scene(number: int) -> dict[str, tuple[str, float, float]]:
    """Return of each method how a scene ends, its least distance, m, and what it took, s of processor."""
    arm = dqc.load_robot("panda")
    balls, start, at_goal = scene(np.random.default_rng([SEED, number]), arm)
    goal = arm.fkm(at_goal)
    kept = PreparedConstraints(fenced(arm, balls), arm, PERIOD, "measured")
    found = {}
    for name, way in ways_of(arm, balls, goal, start).items():
        begin = time.thread_time()
        path = way()
        spent = time.thread_time() - begin
        found[name] = (*end_of(arm, kept, goal, path), spent)
    return found


def main(count: int, jobs: int) -> None:
    if find_spec("daqp"):
        check_neo(dqc.load_robot("panda"))
    ends_of_scene(0)  # kernels are compiled once, before processes share them
    with ProcessPoolExecutor(jobs) as pool:
        scenes = list(pool.map(ends_of_scene, range(count)))
    print(f"| {count} scenes | " + " | ".join(KINDS) + " | least distance [mm] | s of processor |")
    print("|---" * (len(KINDS) + 3) + "|")
    for name in scenes[0]:
        ends, least, spent = zip(*(each[name] for each in scenes), strict=True)
        numbers = [str(ends.count(kind)) for kind in KINDS]
        print(f"| {name} | {' | '.join(numbers)} | {1e3 * min(least):.2f} | {sum(spent):.0f} |")


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--scenes", type=int, default=200)
    parser.add_argument("--jobs", type=int, default=1)
    options = parser.parse_args()
    main(options.scenes, options.jobs)

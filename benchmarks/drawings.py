"""Random drawings of arms: how many go through from the posture that is chosen, and what stops the others.

    python benchmarks/drawings.py [--ur5 60] [--panda 24] [--iiwa7 20]

A drawing is a circle or a line there and back of 30 to 120 mm about the pose of a random configuration, in the hand's
own orientation, above a table, among three balls of 50 to 100 mm near it, none of them nearer to its poses than 60 mm;
margins of 10 mm. It is complete if each pose has a configuration within the limits, with σ ≥ 0.02, and if all edges
between them are certified. Postures: the first that inverse kinematics gives from the middle of the joints' ranges, the
best of `robots.postures`, and the one of `planning.branch_along`. Drawings that do not go through are closed if they
have a pose at which none of the postures that 300 random starts give is clear and has σ ≥ 0.02: no law completes these.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

import dqcontrol as dqc
from dqcontrol import algebra
from dqcontrol.errors import PlanError, ReachError
from dqcontrol.planning import CertifiedEdges, branch_along
from dqcontrol.planning.followed_path import SINGULAR, continued

POSES, RUNGS, STARTS = 100, 25, 300
Body = dqc.world.Body


def drawing(arm: dqc.Robot, rng: np.random.Generator) -> tuple[np.ndarray, dqc.constraints.Constraints]:
    """Return poses of a drawing, shape (N, 8), and what is kept around it."""
    low, high = np.maximum(arm.limits.lower, -2.8), np.minimum(arm.limits.upper, 2.8)
    while True:
        hand = arm.fkm(rng.uniform(low, high))
        place = algebra.translation(hand)
        if place[2] < 0.1 or np.linalg.norm(place[:2]) < 0.25:
            continue
        size = rng.uniform(0.03, 0.12)
        if rng.uniform() < 0.5:
            shape: dqc.references.Reference = dqc.references.Circle(hand, radius=size, duration=10.0)
            poses = shape.samples(np.linspace(0.0, 10.0, POSES))[:, :8]
        else:
            along = rng.normal(size=3)
            shares = 1.0 - np.abs(np.linspace(-1.0, 1.0, POSES))
            ends = place + size * shares[:, None] * along / np.linalg.norm(along)
            poses = algebra.pose(np.tile(hand[:4], (POSES, 1)), ends)
        points = algebra.translation(poses)
        if points[:, 2].min() < 0.05:
            continue
        balls: dict[str, Body] = {}
        while len(balls) < 3:
            away = rng.normal(size=3)
            middle = place + rng.uniform(0.12, 0.4) * away / np.linalg.norm(away)
            radius = rng.uniform(0.05, 0.1)
            if (
                np.linalg.norm(points - middle, axis=1).min() > radius + 0.06
                and np.linalg.norm(middle) > 0.35
            ):
                x, y, z = middle.tolist()
                balls[f"ball {len(balls)}"] = Body(sphere=radius, position=(x, y, z))
        table = {"table": Body(box=[3.0, 3.0, 0.04], position=(0, 0, -0.06))}
        return poses, dqc.constraints.Constraints(world=dqc.World(bodies=table | balls), clear_of="all")


def closed(edges: CertifiedEdges, poses: np.ndarray, stop: int) -> bool:
    """Return whether a pose, that where a drawing stops or one of 25, has no posture that may be."""
    arm = edges.robot
    for k in (stop, *np.linspace(0, len(poses) - 1, RUNGS).astype(int)):
        try:
            q = np.array([each.q for each in dqc.robots.postures(arm, poses[k], starts=STARTS)])
        except ReachError:
            return True
        sigma = np.linalg.svd(arm.hand_jacobian(q), compute_uv=False)[:, -1]
        if not ((edges.room_at(q)[0] >= 0) & (sigma >= SINGULAR)).any():
            return True
    return False


def drawings(name: str, count: int) -> None:
    arm, rng = dqc.load_robot(name), np.random.default_rng([5, len(name)])
    first = best = through = shut = named = 0
    spent, why = 0.0, {}
    for _ in range(count):
        poses, given = drawing(arm, rng)
        edges = CertifiedEdges(arm, given)
        lower = np.where(np.isfinite(arm.limits.lower), arm.limits.lower, -np.pi)
        upper = np.where(np.isfinite(arm.limits.upper), arm.limits.upper, np.pi)
        solved = arm.solve(poses[0], 0.5 * (lower + upper))
        first += solved.success and not continued(edges, solved.q, poses).why
        found = dqc.robots.postures(arm, poses[0])
        best += not continued(edges, found[0].q, poses).why
        begin, stop = time.process_time(), None
        try:
            branch_along(arm, given, poses)
            through += 1
        except PlanError as error:
            stop = error.sample
            named += f"sample {stop} of" in str(error)
            kind = (
                error.pair.partition(":")[0].rstrip(" 0123456789")
                or str(error).rpartition(": ")[2].split(" (")[0]
            )
            why[kind] = why.get(kind, 0) + 1
        spent += time.process_time() - begin
        shut += stop is not None and closed(edges, poses, stop)
    stops = ", ".join(f"{number} {kind}" for kind, number in sorted(why.items(), key=lambda each: -each[1]))
    print(
        f"| {name} | {count} | {first} | {best} | {through} | {shut} | {named} of {count - through}: {stops} "
        f"| {1e3 * spent / count:.0f} |",
        flush=True,
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    for name, count in (("ur5", 60), ("panda", 24), ("iiwa7", 20)):
        parser.add_argument(f"--{name}", type=int, default=count)
    options = vars(parser.parse_args())
    print(
        "| robot | drawings | from the first solution | from the best posture | of branch_along | closed | "
        "sample named where none goes through | time of processor [ms] |"
    )
    print("|---" * 8 + "|")
    for name, count in options.items():
        drawings(name, count)

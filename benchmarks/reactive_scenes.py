"""Reactive scenes: how often a Panda reaches a pose among balls, by our law, Mink and NEO, and what became of the rest.

    python benchmarks/reactive_scenes.py [--scenes 200]

NEO's own scenes are published in no package, so these are made: three balls of 60 mm, start and goal at random and
clear of them by 30 mm, the straight way of the joints not clear, and a way over one or no random configuration that is
clear: every scene can be solved. Everybody gets the same capsules and balls, joints that do what they are told, 10 ms a
step, 15 s, 2/s of gain, 10 mm to keep, and the limits of the joints; ours also an acceleration of 10 rad/s².

* ours: K, with constraints and their escape;
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
from collections import Counter
from collections.abc import Callable
from functools import partial
from importlib.util import find_spec
from typing import Any

import numpy as np
from constraints import fenced, scene

import dqcontrol as dqc
from dqcontrol import algebra
from dqcontrol.geometry import Sphere
from dqcontrol.geometry import distance_kernels as geometry
from dqcontrol.laws.constrained.prepared_constraints import PreparedConstraints
from dqcontrol.plants.mujoco.mujoco_model import skeleton

PERIOD, MOST = 0.01, 15.0  # s
GAIN, RATE = 2.0, 10.0  # 1/s: of the hand's error, and of distances
KEPT, SEEN = 0.01, 0.3  # m: distance to keep, and from where rows are made
POSITION, ANGLE = 0.01, 0.05  # m and rad: reached
STILL = 0.005  # m in the last 2 s
BALL = 0.06  # m

Step = Callable[[np.ndarray], np.ndarray]


def by_mink(arm: dqc.Robot, balls: np.ndarray, goal: np.ndarray, gain: float) -> Step:
    """Return Mink's joint speeds towards a pose, among the same shapes and pairs."""
    import mink
    import mujoco

    assert arm.shapes is not None
    spec = skeleton(arm)
    for each in arm.shapes.shapes:
        body = spec.body(f"link_{each.frame}") if each.frame else spec.worldbody
        geom = body.add_geom(
            name=each.name, type=mujoco.mjtGeom.mjGEOM_CAPSULE, size=[each.shape.radius, 0, 0]
        )
        geom.fromto = [*each.shape.start, *each.shape.end]
    for i, ball in enumerate(balls):
        spec.worldbody.add_geom(
            name=f"ball {i}", type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[BALL, 0, 0], pos=ball
        )
    model = spec.compile()
    names = arm.shapes.names
    pairs = [([names[a]], [names[b]]) for a, b in arm.shapes.pairs]
    links = [each.name for each in arm.shapes.shapes if each.frame > 1]
    pairs.append((links, [f"ball {i}" for i in range(len(balls))]))
    configuration = mink.Configuration(model)
    task = mink.FrameTask("hand", "site", position_cost=1.0, orientation_cost=1.0, gain=GAIN * PERIOD)
    task.set_target(mink.SE3.from_matrix(np.asarray(dqc.DualQuaternion(goal).matrix())))
    speeds = dict(zip(arm.joint_names, arm.limits.velocity, strict=True))
    limits = [
        mink.ConfigurationLimit(model),
        mink.VelocityLimit(model, speeds),
        mink.CollisionAvoidanceLimit(
            model, pairs, gain=gain, minimum_distance_from_collisions=KEPT, collision_detection_distance=SEEN
        ),
    ]

    def step(q: np.ndarray) -> np.ndarray:
        configuration.update(q)
        try:
            return mink.solve_ik(configuration, [task], PERIOD, solver="daqp", damping=1e-6, limits=limits)
        except mink.NoSolutionFound:
            return np.zeros(len(q))

    return step


class Neo:
    """NEO's quadratic program among balls: speeds and slack of the hand, limits of joints and distances as dampers."""

    def __init__(self, arm: dqc.Robot, balls: np.ndarray, goal: np.ndarray) -> None:
        assert arm.shapes is not None
        self._arm, self._goal = arm, np.asarray(dqc.DualQuaternion(goal).matrix())
        self._shapes = arm.shapes.shapes
        solids = [Sphere(ball, BALL).row for ball in balls]
        links = [i for i, each in enumerate(self._shapes) if each.frame > 1]
        self._pairs = [(i, None, k) for i in links for k in range(len(balls))]
        self._pairs += [(a, b, 0) for a, b in arm.shapes.pairs]
        self._solids = solids
        self._found = np.empty((len(self._pairs), geometry.FOUND))

    def rows(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return all distances, shape (m,), and their derivatives by the joints, shape (m, n)."""
        frames = self._arm.frames(q)
        moved = [
            (each.shape.moved(frames[each.frame - 1]) if each.frame else each.shape).row
            for each in self._shapes
        ]
        first = np.array([moved[a] for a, _, _ in self._pairs])
        second = np.array([self._solids[k] if b is None else moved[b] for _, b, k in self._pairs])
        geometry.distances(first, second, self._found)
        places = algebra.matrix_from_pose(frames[:-1])
        axes, origins = places[:, :3, 2], places[:, :3, 3]
        normal = self._found[:, geometry.DIRECTION : geometry.DIRECTION + 3]
        at = self._found[:, geometry.ON_A : geometry.ON_A + 3]
        lever = np.cross(axes[None], at[:, None] - origins[None])
        rate = np.einsum("mnk,mk->mn", lever, normal)
        joints = np.arange(1, len(q) + 1)
        by_a = np.array([joints <= self._shapes[a].frame for a, _, _ in self._pairs])
        by_b = np.array([joints <= (0 if b is None else self._shapes[b].frame) for _, b, _ in self._pairs])
        return self._found[:, geometry.DISTANCE].copy(), rate * (by_a.astype(float) - by_b)

    def step(self, q: np.ndarray) -> np.ndarray:
        """Return the joints' speeds."""
        import daqp

        arm, n = self._arm, len(q)
        frames = arm.frames(q)
        places = algebra.matrix_from_pose(frames)
        hand, axes, origins = places[-1], places[:-1, :3, 2], places[:-1, :3, 3]
        jacobian = np.vstack([np.cross(axes, hand[:3, 3] - origins).T, axes.T])
        error = np.concatenate(
            [self._goal[:3, 3] - hand[:3, 3], rotation_vector(self._goal[:3, :3] @ hand[:3, :3].T)]
        )
        away = max(float(np.abs(error).sum()), 1e-3)
        hessian = np.diag(np.concatenate([np.full(n, 0.01), np.full(6, 1.0 / away)]))
        gradient = np.concatenate([-manipulability_gradient(axes, origins, jacobian), np.zeros(6)])
        distances, rates = self.rows(q)
        near = distances < SEEN
        lower, upper = arm.limits.lower, arm.limits.upper
        most = np.minimum(arm.limits.velocity, np.maximum(upper - q - 0.05, 0) / (0.9 - 0.05) * RATE)
        least = np.maximum(-arm.limits.velocity, np.minimum(lower - q + 0.05, 0) / (0.9 - 0.05) * RATE)
        task = np.hstack([jacobian, np.eye(6)])
        kept = np.hstack([-rates[near], np.zeros((int(near.sum()), 6))])
        bound = RATE * (distances[near] - KEPT)
        high = np.concatenate([most, np.full(6, 1e2), GAIN * error, bound])
        low = np.concatenate([least, np.full(6, -1e2), GAIN * error, np.full(len(bound), -1e30)])
        sense = np.zeros(len(high), np.int32)
        sense[n + 6 : n + 12] = 5  # equalities
        x, _, flag, _ = daqp.solve(
            hessian, gradient, np.ascontiguousarray(np.vstack([task, kept])), high, low, sense
        )
        return x[:n] if flag > 0 else np.zeros(n)


def rotation_vector(turn: np.ndarray) -> np.ndarray:
    """Return axis times angle of a rotation matrix, by its quaternion."""
    r = algebra.rotation_from_matrix(turn)
    r = r if r[0] >= 0 else -r
    sine = float(np.linalg.norm(r[1:4]))
    return r[1:4] * (2 * np.arctan2(sine, r[0]) / sine if sine > 1e-12 else 2.0)


def manipulability_gradient(axes: np.ndarray, origins: np.ndarray, jacobian: np.ndarray) -> np.ndarray:
    """Return the derivative of √det(J Jᵀ) by the joints, from that of J: m tr(J⁺ ∂J/∂q)."""
    n = len(axes)
    square = jacobian @ jacobian.T
    size = float(np.sqrt(max(np.linalg.det(square), 0.0)))
    inverse = jacobian.T @ np.linalg.inv(square + 1e-12 * np.eye(6))
    found = np.empty(n)
    for k in range(n):
        change = np.zeros((6, n))
        for j in range(n):
            change[:3, j] = np.cross(axes[min(j, k)], jacobian[:3, max(j, k)])
            if k < j:
                change[3:, j] = np.cross(axes[k], axes[j])
        found[k] = size * np.trace(inverse @ change)
    return found


def by_ours(arm: dqc.Robot, balls: np.ndarray, goal: np.ndarray, start: np.ndarray) -> np.ndarray:
    """Return the configurations that our law drives through, shape (N, n), rad."""
    law = dqc.laws.Proportional(gain=GAIN, constraints=fenced(arm, balls, acceleration=10.0, escape=0.2))
    target = dqc.references.SetPoint(goal)
    return dqc.simulate(arm, target, law, dqc.plants.Integrator(), start, PERIOD, MOST).q


def driven(step: Step, start: np.ndarray) -> np.ndarray:
    """Return the configurations that speeds drive through, shape (N, n), rad."""
    path = np.empty((round(MOST / PERIOD) + 1, len(start)))
    path[0] = start
    for k in range(len(path) - 1):
        path[k + 1] = path[k] + PERIOD * step(path[k])
    return path


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


def check_neo(arm: dqc.Robot) -> None:
    """Compare the rows with finite differences, that nobody says NEO lost by a wrong sign."""
    rng = np.random.default_rng(8)
    worst = 0.0
    for _ in range(20):
        balls = rng.uniform([-0.1, -0.7, 0.2], [0.8, 0.7, 1.0], (3, 3))
        neo, q = Neo(arm, balls, arm.fkm(np.zeros(7))), rng.uniform(-1.5, 1.5, 7)
        _, rates = neo.rows(q)
        for k in range(7):
            move = np.eye(7)[k] * 1e-6
            change = (neo.rows(q + move)[0] - neo.rows(q - move)[0]) / 2e-6
            worst = max(worst, float(np.median(np.abs(change - rates[:, k]))))
    if worst > 1e-6:
        raise SystemExit(f"NEO: its rows differ from finite differences by {worst:.2g}")


def main(count: int) -> None:
    arm, rng = dqc.load_robot("panda"), np.random.default_rng(4)
    ends: dict[str, Counter[str]] = {}
    least: dict[str, float] = {}
    spent: Counter[str] = Counter()
    has_mink, has_daqp = find_spec("mink") is not None, find_spec("daqp") is not None
    if has_daqp:
        check_neo(arm)
    for k in range(count):
        balls, start, at_goal = scene(rng, arm)
        goal = arm.fkm(at_goal)
        kept = PreparedConstraints(fenced(arm, balls), arm, PERIOD, "measured")
        ways: dict[str, Callable[[], np.ndarray]] = {"ours": partial(by_ours, arm, balls, goal, start)}
        if has_mink:
            for name, gain in (("Mink, corrected", RATE * PERIOD**2), ("Mink, as shipped", 0.85)):
                ways[name] = partial(driven, by_mink(arm, balls, goal, gain), start)
        if has_daqp:
            ways["NEO, corrected"] = partial(driven, Neo(arm, balls, goal).step, start)
        for name, way in ways.items():
            begin = time.thread_time()
            path = way()
            spent[name] += time.thread_time() - begin
            end, distance = end_of(arm, kept, goal, path)
            ends.setdefault(name, Counter())[end] += 1
            least[name] = min(least.get(name, np.inf), distance)
        if (k + 1) % 20 == 0:
            print(
                f"{k + 1} scenes: " + "; ".join(f"{name} {dict(each)}" for name, each in ends.items()),
                flush=True,
            )
    kinds = ("reached", "collision", "limit", "deadlock", "timeout")
    print(f"| {count} scenes | " + " | ".join(kinds) + " | least distance [mm] | s of processor |")
    print("|---" * (len(kinds) + 3) + "|")
    for name, found in ends.items():
        numbers: list[Any] = [found[kind] for kind in kinds]
        print(f"| {name} | {' | '.join(map(str, numbers))} | {1e3 * least[name]:.2f} | {spent[name]:.0f} |")


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--scenes", type=int, default=200)
    main(parser.parse_args().scenes)

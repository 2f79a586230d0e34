"""What the inverses of a singular Jacobian cost: errors, joint speeds and accelerations of laws along singular paths.

Singular configurations are found by descent of the least singular value from random ones (seeded); a hand goes along
a straight line of 30 cm in a random direction through the pose there and back, at constant orientation (quintic
timing, 8 s, T = 5 ms, ideal joints, 0.25 m/s at most), started from a configuration beside it. Lines whose start
cannot be reached are left out. Half of them pass the pose itself, half 1 cm beside it. "through": all of the line can
be reached, as one of the runs misses it by less than 2 cm; "beyond": a part lies outside the workspace. Of the paths
of a robot: the median and the largest of the position errors' maxima (mm), the largest orientation error (°) and
joint speed (rad/s), and the median and the largest joint acceleration (rad/s²).

J-PARSE [Guptasarma et al. 2025, arXiv 2505.00306] is written here anew, with its γ = 0.1 and the same hand's twist: its
u is V diag(1/σ, or σ/(γ σ_max)² where σ < γ σ_max) Uᵀ t.

python benchmarks/singularities.py            # the default beside others, for several laws
python benchmarks/singularities.py --choose   # lengths, thresholds and dampings, as the default was chosen
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

import dqcontrol as dqc
from dqcontrol import algebra, laws
from dqcontrol.loop.simulate import simulate_prepared
from dqcontrol.plants import Integrator
from dqcontrol.tables import Column, Table

Array = np.ndarray
ROBOTS, COUNT, SEED = ("panda", "ur5", "iiwa7", "barrett-wam"), 24, 5
PERIOD, SECONDS, REACH, GAIN = 0.005, 8.0, 0.15, 10.0
OLD = laws.FilteredInverse(threshold=0.04, damping=0.1, characteristic_length=1.0)  # what K had until then
GAMMA = 0.1
COLUMNS = (
    Column("robot"),
    Column("paths"),
    Column("law"),
    Column("inverse"),
    Column("median", "mm"),
    Column("max", "mm"),
    Column("max", "°"),
    Column("speed", "rad/s"),
    Column("median acc.", "rad/s²"),
    Column("max acc.", "rad/s²"),
)
THROUGH = 20.0  # mm


@dataclass(frozen=True)
class Path:
    """Where an arm starts, and the desired motion, shape (N, 21)."""

    start: Array
    samples: Array


def hand_jacobian(arm: dqc.Robot, q: Array) -> Array:
    """Return the Jacobian of the hand's [ω ; ṗ]."""
    jacobian = arm.twist_jacobian(q)
    position = algebra.translation(arm.fkm(q))
    jacobian[3:] -= np.cross(position[:, None], jacobian[:3], axis=0)
    return jacobian


def singular_configurations(arm: dqc.Robot, rng: np.random.Generator) -> list[Array]:
    """Return configurations within the limits where J has lost rank."""
    lower, upper = np.maximum(arm.limits.lower, -2.8) + 0.05, np.minimum(arm.limits.upper, 2.8) - 0.05
    found: list[Array] = []
    while len(found) < COUNT:

        def least(q: Array) -> float:
            return float(np.linalg.svd(hand_jacobian(arm, q), compute_uv=False)[-1])

        best = minimize(
            least, rng.uniform(lower, upper), bounds=list(zip(lower, upper, strict=True)), method="Powell"
        )
        if best.fun < 1e-5:
            found.append(best.x)
    return found


def paths(name: str) -> tuple[dqc.Robot, list[Path]]:
    """Return a robot and its singular paths."""
    arm, rng = dqc.load_robot(name), np.random.default_rng(SEED)
    made = []
    for k, q in enumerate(singular_configurations(arm, rng)):
        direction, beside = rng.normal(size=(2, 3))
        direction /= np.linalg.norm(direction)
        beside -= beside @ direction * direction
        beside *= 0.01 * (k % 2) / np.linalg.norm(beside)
        side = np.linalg.svd(hand_jacobian(arm, q))[2][-1]  # what moves no hand here
        time = PERIOD * np.arange(round(SECONDS / PERIOD) + 1)
        samples = line(arm.fkm(q), beside, direction, time)
        law, target = laws.Proportional(gain=5.0), dqc.references.SetPoint(samples[0, :8])
        way = dqc.simulate(arm, target, law, Integrator(), q + 0.5 * side, PERIOD, 10.0)
        if way.error[-1] < 1e-6:
            made.append(Path(way.q[-1], samples))
    return arm, made


def line(pose: Array, beside: Array, direction: Array, time: Array) -> Array:
    """Return a straight line through (or beside) a pose and back."""
    s = np.minimum(time, SECONDS - time) / (SECONDS / 2)
    way = REACH * (2 * (10 * s**3 - 15 * s**4 + 6 * s**5) - 1)
    rate = REACH * 2 * 30 * s**2 * (1 - s) ** 2 / (SECONDS / 2) * np.where(time < SECONDS / 2, 1, -1)
    position = algebra.translation(pose) + beside + way[:, None] * direction
    samples = np.zeros((len(time), 21))
    samples[:, :8] = [algebra.pose(pose[:4], p) for p in position]
    samples[:, 11:14] = rate[:, None] * direction
    samples[:, 20] = time
    return samples


def j_parse(arm: dqc.Robot, path: Path) -> Array:
    """Return the configurations of a run with J-PARSE, feed-forward and gain as K+FF."""
    q, passed = path.start.copy(), []
    for row in path.samples:
        passed.append(q.copy())
        pose = arm.fkm(q)
        turn = algebra.multiply(row[:8], algebra.conjugate(pose))[:4]
        position = algebra.translation(pose)
        angular = 2 * GAIN * np.sign(turn[0]) * turn[1:4]
        wanted = np.concatenate([angular, row[11:14] + GAIN * (algebra.translation(row[:8]) - position)])
        left, sigma, right = np.linalg.svd(hand_jacobian(arm, q), full_matrices=False)
        least = GAMMA * sigma[0]
        q = q + PERIOD * right.T @ (
            np.where(sigma < least, sigma / least**2, 1 / np.maximum(sigma, least)) * (left.T @ wanted)
        )
    return np.array(passed)


def run(law: laws.Law) -> Callable[[dqc.Robot, Path], Array]:
    """Return what runs a law along a path."""
    return lambda arm, path: (
        simulate_prepared(law.prepare(arm, None, PERIOD), Integrator(), path.start, path.samples).q
    )


def judged(arm: dqc.Robot, path: Path, q: Array) -> list[float]:
    """Return the largest position error (mm), orientation error (°), joint speed and acceleration of a run."""
    pose, desired = arm.fkm(q), path.samples[: len(q), :8]
    turn = algebra.multiply(algebra.conjugate(pose), desired)
    angle = 2 * np.arctan2(np.linalg.norm(turn[:, 1:4], axis=1), np.abs(turn[:, 0]))
    miss = np.linalg.norm(algebra.translation(pose) - algebra.translation(desired), axis=1)
    u = np.diff(q, axis=0) / PERIOD
    return [
        1e3 * miss.max(),
        np.degrees(angle).max(),
        np.abs(u).max(),
        (np.abs(np.diff(u, axis=0)) / PERIOD).max(),
    ]


def compared(inverses: dict[str, laws.FilteredInverse], names: tuple[str, ...]) -> Table:
    """Return the table."""
    made: dict[str, Callable[[laws.FilteredInverse], laws.Law]] = {
        "K": lambda inverse: laws.Proportional(gain=GAIN, inverse=inverse),
        "K+FF": lambda inverse: laws.ProportionalFeedforward(gain=GAIN, inverse=inverse),
        "HIRT, left": lambda inverse: laws.HInfinityTracking(
            orientation_gain=2 * GAIN, translation_gain=GAIN, form="left", inverse=inverse
        ),
        "LQR-DQ": lambda inverse: laws.LinearQuadraticDQ(
            error_weight=GAIN**2, control_weight=1.0, inverse=inverse
        ),
    }
    rows = []
    for robot in ROBOTS:
        arm, ways = paths(robot)
        runners = {
            (name, label): run(made[name](inverse)) for name in names for label, inverse in inverses.items()
        }
        runners["K+FF", f"J-PARSE, γ = {GAMMA:g}"] = j_parse
        numbers = np.array(
            [[judged(arm, way, runner(arm, way)) for way in ways] for runner in runners.values()]
        )
        is_through = numbers[:, :, 0].min(axis=0) < THROUGH
        for kind, chosen in (("through", is_through), ("beyond", ~is_through)):
            if not chosen.any():
                continue
            for (name, label), each in zip(runners, numbers[:, chosen], strict=True):
                worst, middle = each.max(axis=0), np.median(each, axis=0)
                own = [middle[0], *worst[:3], middle[3], worst[3]]
                rows.append([robot, f"{chosen.sum()} {kind}", name, label, *own])
    return Table(COLUMNS, rows)


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--choose", action="store_true")
    names: tuple[str, ...]
    if parser.parse_args().choose:
        names, inverses = ("K+FF",), {"until now": OLD}
        for length in (0.1, 0.3, 1.0):
            for threshold in (0.02, 0.04, 0.08):
                for share in (0.5, 1.0):
                    label = f"ℓ {length:g}, ε {threshold:g}, λ {share:g} ε"
                    inverses[label] = laws.FilteredInverse(
                        threshold=threshold, damping=share * threshold, characteristic_length=length
                    )
    else:
        names, inverses = (
            ("K", "K+FF", "HIRT, left", "LQR-DQ"),
            {"until now": OLD, "default": laws.FilteredInverse()},
        )
    print(compared(inverses, names).markdown())


if __name__ == "__main__":
    main()

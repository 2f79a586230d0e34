"""Cranks of unknown radius in physics: how often they are turned by 90°, and by what side force.

``python benchmarks/crank.py [TRIALS]`` runs ``examples/crank.yaml`` so often (20), with cranks of 8 to 40 cm whose axes
lie anywhere around the hand where the arm can follow, other friction, and a first direction wrong by up to 20°. A long
one is turned as far as 50 mm/s come in 12 s. The side force is the handle's on the pin along the radius.
"""

from __future__ import annotations

import copy
import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import yaml

import dqcontrol as dqc

EXAMPLE = Path(__file__).parents[1] / "examples/crank.yaml"
HAND = np.array([0.549, 0.0])  # m
REACH = 0.43, 0.70  # m from the arm's axis, with the tool upright at this height
SPEED, SECONDS, MOST, SHARE = 0.05, 12.0, 10.0, 98.0  # m/s, s, N and %: wanted
SLOWED = 0.8  # of the speed, at least, against friction


def crank(spec: dict[str, Any], seed: int) -> tuple[dict[str, Any], np.ndarray, float]:
    """Return the spec with another crank, its axis (2,), m, and the angle to turn, rad."""
    out, rng = copy.deepcopy(spec), np.random.default_rng(seed)
    while True:
        radius, heading = rng.uniform(0.08, 0.4), rng.uniform(0, 2 * np.pi)
        axis = HAND + radius * np.array([np.cos(heading), np.sin(heading)])
        angle = min(0.5 * np.pi, SLOWED * SPEED * SECONDS / radius)
        sense = rng.choice([-1.0, 1.0])
        turned = heading + np.pi + sense * np.linspace(0, angle + 0.1, 50)
        way = axis + radius * np.column_stack([np.cos(turned), np.sin(turned)])
        far = np.linalg.norm(way, axis=1)
        if far.min() > REACH[0] and far.max() < REACH[1]:
            break
    first = heading + np.pi + sense * (0.5 * np.pi + rng.uniform(-1, 1) * np.radians(20))
    body = out["world"]["crank"]
    del body["parts"]
    hinge = body["hinge"]
    hinge["at"] = [*(axis - HAND).tolist(), 0.0]
    hinge["range"] = [-4.0, 4.0]
    hinge["friction"], hinge["damping"] = rng.uniform(0.1, 2.0) * radius, rng.uniform(0.0, 0.2)
    out["contact"]["goes_on"]["direction"] = [float(np.cos(first)), float(np.sin(first)), 0.0]
    out["seed"], out["duration"] = seed, SECONDS
    out["outcome"] = [{"body": "crank", "opened": float(sense * angle)}]
    return out, axis, float(sense * angle)


def main() -> None:
    """Print each trial, and how many were turned with what side force."""
    warnings.simplefilter("ignore")
    trials = int(sys.argv[1]) if len(sys.argv) > 1 else 20
    spec, done, peaks, means = yaml.safe_load(EXAMPLE.read_text()), 0, [], []
    for seed in range(trials):
        trial, axis, asked = crank(spec, seed)
        record = dqc.run(trial).record
        angle = record.readings["crank_angle"].values[:, 0]
        until = int(np.argmax(np.abs(angle) >= abs(asked))) or len(angle)
        radial = record.position[:until, :2] - axis
        radial /= np.linalg.norm(radial, axis=1, keepdims=True)
        side = np.abs(np.sum(record.readings["touch_force"].values[:until, :2] * radial, axis=1))
        turned = np.abs(angle).max() >= abs(asked)
        done += turned and side.max() <= MOST
        peaks.append(side.max())
        means.append(side.mean())
        radius = 1e3 * np.linalg.norm(axis - HAND)
        print(
            f"{seed:3d}: radius {radius:3.0f} mm, {np.degrees(np.abs(angle).max()):3.0f}° of "
            f"{np.degrees(abs(asked)):3.0f}°, side force {side.mean():.1f} N, {side.max():.1f} N at most",
            flush=True,
        )
    print(
        f"{done} of {trials} turned with at most {MOST:g} N aside ({100 * done / trials:.0f} %, ≥ {SHARE:g} wanted); "
        f"{np.mean(means):.2f} N in the mean, {max(peaks):.1f} N at most"
    )


if __name__ == "__main__":
    main()

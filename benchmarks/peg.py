"""Peg in hole in physics: 20 in 20.2 mm, 2 mm and 2° off in any direction; how often it goes in, and with what force.

``python benchmarks/peg.py [TRIALS]`` runs ``examples/peg.yaml`` so often (20), with the rim displaced and tilted in
other directions and other noise, on springs of 100 kN/m. It prints the largest force of the socket on the peg, and the
sum of all that presses in the hole, where both sides of a jammed peg count.

Beside them stands what the AI for Industry Challenge 2026 scores: whether a force goes beyond 20 N, and points for a
low jerk of the end effector, 6 at 0 falling to 0 at 50 m/s³. How its jerk is averaged is not known to us: this is the
mean of its size, by cubics over 60 ms.
"""

from __future__ import annotations

import copy
import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from scipy.signal import savgol_filter

import dqcontrol as dqc
from dqcontrol import algebra
from dqcontrol.loop import Record

EXAMPLE = Path(__file__).parents[1] / "examples/peg.yaml"
OFF, TILT = 2e-3, np.radians(2.0)
MOST, SHARE = 25.0, 98.0  # N and %: wanted
PENALTY, POINTS, STEEPEST = 20.0, 6.0, 50.0  # N; points at no jerk, and m/s³ from which on there are none
WINDOW = 0.06  # s
RIM = np.array([0.549255, 0.0, 0.0927])  # m: 10 mm below the peg at the start


def displaced(spec: dict[str, Any], seed: int) -> dict[str, Any]:
    """Return the spec with a rim that is 2 mm and 2° off in random directions, and another seed."""
    out, rng = copy.deepcopy(spec), np.random.default_rng(seed)
    way, axis = rng.uniform(0.0, 2 * np.pi, 2)
    socket = out["world"]["socket"]
    roll, pitch = TILT * np.cos(axis), TILT * np.sin(axis)
    turn = algebra.matrix_from_pose(algebra.pose(algebra.rotation_from_rpy([roll, pitch, 0]), np.zeros(3)))
    place = RIM + OFF * np.array([np.cos(way), np.sin(way), 0]) - 0.03 * turn[:3, 2]
    socket["position"], socket["rpy"] = place.tolist(), [float(roll), float(pitch), 0.0]
    out["seed"] = seed
    del out["outcome"][1:]
    return out


def jerk(record: Record) -> float:
    """Return the mean jerk of the end effector, m/s³."""
    period = float(record.time[1] - record.time[0])
    rates = savgol_filter(record.position, round(WINDOW / period) | 1, 3, deriv=3, delta=period, axis=0)
    return float(np.linalg.norm(rates, axis=1).mean())


def main() -> None:
    """Print each trial, and how many went in with what force."""
    warnings.simplefilter("ignore")
    trials = int(sys.argv[1]) if len(sys.argv) > 1 else 20
    spec = yaml.safe_load(EXAMPLE.read_text())
    done, peaks, points, beyond = 0, [], [], 0
    for seed in range(trials):
        run = dqc.run(displaced(spec, seed))
        record, words = run.record, run.verdict.words
        force = np.linalg.norm(record.readings["touch_force"].values, axis=1).max()
        pressed = record.readings["contact_force"].values.max()
        inside = "not so" not in words
        done += inside and force <= MOST
        peaks.append(force)
        beyond += force > PENALTY
        points.append(POINTS * max(0.0, 1 - jerk(record) / STEEPEST))
        print(
            f"{seed:3d}: {force:5.1f} N on the peg, {pressed:5.1f} N in all, {points[-1]:.2f} points; {words}",
            flush=True,
        )
    share = 100 * done / trials
    print(
        f"{done} of {trials} in with at most {MOST:g} N ({share:.0f} %, ≥ {SHARE:g} wanted), {max(peaks):.1f} N at most"
    )
    print(
        f"{beyond} beyond {PENALTY:g} N; {np.mean(points):.2f} of {POINTS:g} points for jerk, "
        f"{min(points):.2f} at least"
    )


if __name__ == "__main__":
    main()

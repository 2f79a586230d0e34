"""A million configurations at once: time of each on one core, and what a second core gives beside a plain C control."""

from __future__ import annotations

import time

import numpy as np
from measure import Ratio

import dqcontrol as dqc
from dqcontrol.robots import kernels


def ratios(short: bool) -> list[Ratio]:
    """Return the time of one configuration in a batch."""
    arm, count = dqc.load_robot("iiwa7"), 100_000 if short else 1_000_000
    q = np.random.default_rng(1).uniform(-np.pi, np.pi, (count, 7))
    out = np.empty((count, 8 + 14 * 7))
    least = np.inf
    for _ in range(3 if short else 9):
        start = time.perf_counter()
        kernels.batch(kernels.kinematics.pointer, arm.chain, q, out)
        least = min(least, time.perf_counter() - start)
    return [Ratio("batch: pose and both Jacobians", least / count * 1e9, "ns each", "", 1.0, "≤ 170")]

"""How well the loop keeps time here: law K on the servo plant against a loop that only sleeps until its deadlines.

    python benchmarks/clock.py --seconds 60

Pairs of both alternate; of each the period's 99 % deviation. The median over the pairs must stay below
max(2 × bare, bare + 100 µs).
"""

from __future__ import annotations

import argparse
import sys
import time

import numpy as np
from numpy.typing import NDArray

import dqcontrol as dqc
from dqcontrol.loop import Clock, Timing, close_loop

RATES = (125, 1000)  # Hz
PAIRS = 5
START = np.array([0.2, 0.6, 0.1, 1.6, -0.3, 0.9, 0.4])
Array = NDArray[np.float64]


def tail(periods: Array, period: float) -> float:
    """Return what 99 % of the periods deviate at most, s."""
    return float(np.quantile(np.abs(periods - period), 0.99))


def bare(period: float, steps: int) -> Array:
    """Return the periods of a loop that sleeps until each deadline and does nothing else."""
    begin = np.empty(steps)
    origin = time.perf_counter()
    for k in range(steps):
        rest = origin + k * period - time.perf_counter()
        if rest > 0:
            time.sleep(rest)
        begin[k] = time.perf_counter()
    return np.diff(begin)


def paced(period: float, steps: int, priority: int | None) -> Timing:
    """Return how the loop with law K on the servo plant kept time."""
    arm = dqc.load_robot("iiwa7")
    circle = dqc.references.Circle(arm.fkm(START), radius=0.05, duration=max(4.0, steps * period))
    law = dqc.laws.Proportional(gain=10.0).prepare(arm, circle, period)
    plant = dqc.plants.Servo().start(arm, START, period, steps, 0)
    clock = Clock(priority=priority)
    close_loop(law, plant, circle.samples(period * np.arange(steps)), clock=clock)
    return clock.timing


def main() -> None:
    """Print one line a pair and a verdict a rate; exit 1 if one is beyond its bound."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seconds", type=float, default=4.0, help="of each loop")
    parser.add_argument("--priority", type=int, help="1 to 99: real-time scheduling of the loop with the law")
    options = parser.parse_args()
    kept = True
    paced(0.001, 10, None)  # compiles
    for rate in RATES:
        period, steps = 1 / rate, round(options.seconds * rate)
        bares, ours = [], []
        print(f"{rate} Hz: 99 % of the periods within [µs], {steps} periods each")
        for pair in range(PAIRS):
            bares.append(tail(bare(period, steps), period))
            timing = paced(period, steps, options.priority)
            ours.append(tail(timing.periods, period))
            print(
                f"  pair {pair + 1}: bare {1e6 * bares[-1]:7.1f}   K on servo {1e6 * ours[-1]:7.1f}"
                f"   missed {timing.overruns}   command {1e6 * timing.computation.mean():.1f} µs"
            )
        reference, median = float(np.median(bares)), float(np.median(ours))
        bound = max(2 * reference, reference + 100e-6)
        kept &= median <= bound
        verdict = "kept" if median <= bound else "NOT kept"
        print(f"  median: {1e6 * median:.1f} µs, bound {1e6 * bound:.1f} µs: {verdict}")
    sys.exit(not kept)


if __name__ == "__main__":
    main()

"""Time [P16]'s experiments, metrics only: `python benchmarks/pereira2016.py [servo | meka-physics] [NAME …]`.

On servos, the default, all four large experiments; wanted: over 1000 runs in 15 s on two cores. In physics the spiral's
50 × 6 × 3 runs; wanted: 5 minutes on two cores. A first small round compiles and is not counted. Every run is really
run: repeats differ by the seed of the encoders' noise, and the table says how many different errors they gave.
"""

from __future__ import annotations

import resource
import sys
import time
import warnings
from typing import Any

import joblib
import numpy as np
from measure import Ratio

from dqcontrol.experiments.study import run_study
from dqcontrol_theses.pereira2016.pereira2016_catalogue import (
    EXPERIMENTS,
    PHYSICS,
    PLANTS,
    SERVO,
    published_spec,
)

NAMES = {SERVO: ["lqr", "h-infinity", "circle", "spiral"], PHYSICS: ["spiral"]}


def processor_time() -> float:
    """Return the processor time of this process and of those that have ended, s."""
    parts = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(part.ru_utime + part.ru_stime for part in parts)


def published_specs(plant: str, names: list[str]) -> list[dict[str, Any]]:
    """Return the specs of experiments, for metrics only."""
    return [
        published_spec(spec, plant) | {"record": "metrics"}
        for name in names
        for spec in EXPERIMENTS[name].specs.values()
    ]


def ratios(short: bool) -> list[Ratio]:
    """Return the time of the spiral's table on servos."""
    few = {"repeats": 2}
    specs = [spec | few if short else spec for spec in published_specs(SERVO, ["spiral"])]
    times, count = [], 0
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for spec in specs:
            run_study(spec | few)  # compiles
        for _ in range(1 if short else 3):
            start = time.perf_counter()
            count = sum(len(run_study(spec).rows) for spec in specs)
            times.append(time.perf_counter() - start)
    what = f"P16's spiral on servos: {count} runs of 3000 steps, {joblib.cpu_count()} cores"
    return [Ratio(what, float(np.median(times)), "s", "", 1.0, "≤ 5")]


def main() -> None:
    """Run every spec once small and once whole, and print runs and seconds."""
    warnings.simplefilter("ignore")
    plant = sys.argv[1] if len(sys.argv) > 1 else SERVO
    if plant not in PLANTS:
        sys.exit(f"plant: one of {', '.join(PLANTS)}")
    specs = published_specs(plant, sys.argv[2:] or NAMES[plant])
    for spec in specs:
        run_study(spec | {"repeats": 2})
    joblib.externals.loky.get_reusable_executor().shutdown()  # or their processor time would never be counted
    rows = []
    start, processor = time.perf_counter(), processor_time()
    for spec in specs:
        rows += run_study(spec).rows
    seconds = time.perf_counter() - start
    joblib.externals.loky.get_reusable_executor().shutdown()
    processor, cores = processor_time() - processor, joblib.cpu_count()
    errors = {row["error.integral"] for row in rows}
    print(f"{plant}: {len(rows)} runs, {len(errors)} different errors")
    print(f"{seconds:.1f} s on {cores} cores, {1e3 * seconds / len(rows):.1f} ms a run")
    print(f"processor time {processor:.1f} s: {processor / cores:.1f} s on {cores} cores of their own")


if __name__ == "__main__":
    main()

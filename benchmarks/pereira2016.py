"""Time the complete set of [P16]'s experiments on servos, metrics only: `python benchmarks/pereira2016.py`.

The first round compiles and is not counted. Wanted: over 1000 runs in 15 s on two cores.
"""

from __future__ import annotations

import os
import resource
import time
import warnings

from dqcontrol.experiments.conduct import run_study
from dqcontrol.experiments.published.pereira2016.catalogue import EXPERIMENTS, spec_path
from dqcontrol.yaml_file import parse_yaml, read_text

NAMES = ("lqr", "h-infinity", "circle", "spiral")


def processor_time() -> float:
    """Return the processor time of this process and of those that it has waited for, s."""
    parts = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(part.ru_utime + part.ru_stime for part in parts)


def main() -> None:
    """Run every spec once small and once whole, and print runs and seconds."""
    warnings.simplefilter("ignore")
    specs = []
    for name in NAMES:
        for spec in EXPERIMENTS[name].specs.values():
            path = spec_path(spec)
            specs.append(parse_yaml(str(path), read_text(path)) | {"record": "metrics"})
    for spec in specs:
        run_study(spec | {"repeats": 2})
    runs = 0
    start, processor = time.perf_counter(), processor_time()
    for spec in specs:
        runs += len(run_study(spec).rows)
    seconds, processor = time.perf_counter() - start, processor_time() - processor
    cores = len(os.sched_getaffinity(0))
    print(
        f"{runs} runs of 3000 steps in {seconds:.1f} s on {cores} cores ({seconds / runs * 1e3:.1f} ms a run)"
    )
    print(f"processor time of the main process and the ones it waited for: {processor:.1f} s")


if __name__ == "__main__":
    main()

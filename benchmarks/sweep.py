"""Parameter studies: what two workers gain, and the memory of 10⁵ runs.

`python benchmarks/sweep.py` times a study with one worker and with two beside its control: plain processes that do the
same trials in a loop, without tasks, files or a main process; all four in turns, so that what else the machine does
hits them alike, and with one thread of BLAS in each, as joblib's processes have. `python benchmarks/sweep.py --long`
runs 100,000 runs and prints their peak memory, all processes.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from itertools import pairwise
from pathlib import Path

for library in ("OPENBLAS", "OMP", "MKL"):  # before NumPy is loaded
    os.environ[f"{library}_NUM_THREADS"] = "1"

import numpy as np  # noqa: E402

from dqcontrol.experiments.sweep import read_sweep, run_sweep_to  # noqa: E402

SPEC = {
    "name": "benchmark",
    "robot": "iiwa7",
    "start": [0, 0.6, 0, 1.6, 0, 0.6, 0],
    "period": 0.01,
    "reference": {"kind": "circle", "radius": 0.05, "duration": 10},
    "law": {"kind": "proportional", "gain": 10},
    "plant": {"kind": "servo", "encoder_noise": 1e-4},
}
WANTED = 0.93  # of the control's speed-up
SOUND = 1.8  # with a control below it the machine was not free, and the ratio says nothing

PLAIN = """
import json, sys
from dqcontrol.experiments.sweep import read_sweep
study = read_sweep(json.loads(sys.argv[1]))
first, last = int(sys.argv[2]), int(sys.argv[3])
list(study.rows(range(first, first + 5)))
print("ready", flush=True)
sys.stdin.readline()
for number in range(first, last, 100):
    list(study.rows(range(number, min(number + 100, last))))
print("done", flush=True)
"""


def spec(points: int, duration: float = 10.0) -> dict[str, object]:
    over = {
        "law.gain": {"low": 1, "high": 50, "scale": "log"},
        "plant.time_constant": {"low": 0.01, "high": 0.1},
    }
    sampling = {"method": "sobol", "points": points, "over": over}
    return SPEC | {"duration": duration, "sweep": sampling}


def control(points: int, workers: int) -> float:
    """Return the seconds that plain processes take, from when all are ready."""
    cuts = np.linspace(0, points, workers + 1).astype(int)
    processes = [
        subprocess.Popen(
            [sys.executable, "-c", PLAIN, json.dumps(spec(points)), str(first), str(last)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        for first, last in pairwise(cuts)
    ]
    pipes = [(process.stdin, process.stdout) for process in processes]
    for _, out in pipes:
        assert out is not None
        out.readline()
    start = time.perf_counter()
    for into, _ in pipes:
        assert into is not None
        into.write("go\n")
        into.flush()
    for _, out in pipes:
        assert out is not None
        out.readline()
    seconds = time.perf_counter() - start
    for process in processes:
        process.communicate()
    return seconds


def study(points: int, workers: int, folder: Path) -> float:
    """Return the seconds that a study takes, from the first report of progress to the last."""
    told: list[float] = []
    run_sweep_to(
        spec(points),
        folder / "s",
        force=True,
        jobs=workers,
        progress=lambda *_: told.append(time.perf_counter()),
    )
    return told[-1] - told[0]


def speed_up(points: int, rounds: int) -> None:
    times: dict[str, list[float]] = {}
    with tempfile.TemporaryDirectory() as name:
        study(400, 2, Path(name))  # starts the two processes, which stay
        for _ in range(rounds):
            for workers in (1, 2):
                times.setdefault(f"control {workers}", []).append(control(points, workers))
                times.setdefault(f"sweep {workers}", []).append(study(points, workers, Path(name)))
    medians = {key: float(np.median(values)) for key, values in times.items()}
    for key, seconds in medians.items():
        print(f"{key}: {seconds:.2f} s, {1e3 * seconds / points:.2f} ms a run")
    ours, its = (medians[f"{kind} 1"] / medians[f"{kind} 2"] for kind in ("sweep", "control"))
    print(f"{points} runs of 1001 steps, medians of {rounds} interleaved rounds")
    print(
        f"speed-up of two workers: {ours:.3f}, of the control {its:.3f}, ratio {ours / its:.3f} (≥ {WANTED} wanted)"
    )
    if its < SOUND:
        print(f"void: the control's speed-up is below {SOUND}; the machine had other work")


def memory(points: int, workers: int) -> None:
    """Run many short trials, and print the largest sum of the memory of this process and its children."""
    largest, over = [0.0], threading.Event()

    def watch() -> None:
        while not over.wait(0.5):
            largest[0] = max(largest[0], _resident())

    thread = threading.Thread(target=watch)
    thread.start()
    start = time.perf_counter()
    try:
        with tempfile.TemporaryDirectory() as name:
            run_sweep_to(spec(points, duration=1.0), Path(name) / "s", jobs=workers)
            size = (Path(name) / "s/runs.parquet").stat().st_size / 2**20
    finally:
        over.set()
        thread.join()
    seconds = time.perf_counter() - start
    print(f"{points} runs of 101 steps by {workers} processes in {seconds:.0f} s: {size:.0f} MiB of rows")
    print(f"largest memory of all processes together: {largest[0]:.0f} MiB (≤ 2048 wanted)")


def _resident() -> float:
    """Return the resident memory of this process and all below it, MiB; shared pages count in each."""
    parents, pages = {}, {}
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            number = int(folder.name)
            parents[number] = int((folder / "stat").read_text().rpartition(")")[2].split()[1])
            pages[number] = int((folder / "statm").read_text().split()[1])
        except (OSError, IndexError):  # it ended
            continue

    ours = {os.getpid()}
    while more := {child for child, parent in parents.items() if parent in ours} - ours:
        ours |= more
    return sum(pages.get(number, 0) for number in ours) * os.sysconf("SC_PAGE_SIZE") / 2**20


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--points", type=int, default=3000, help="runs of a round")
    options.add_argument("--rounds", type=int, default=7)
    options.add_argument("--long", action="store_true", help="100,000 runs, for the memory")
    chosen = options.parse_args()
    print(f"{read_sweep(spec(1)).name}: Python {sys.version.split()[0]}")
    if chosen.long:
        memory(100_000, 2)
    else:
        speed_up(chosen.points, chosen.rounds)


if __name__ == "__main__":
    main()

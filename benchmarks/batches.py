"""A million configurations at once: time of each on one core, and what a second core gives beside a plain C control."""

from __future__ import annotations

import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
from measure import Ratio

import dqcontrol as dqc
from dqcontrol.robots.kinematics import kinematics_kernels as kernels

SOURCE = Path(__file__).parent / "c/batch.c"
SOUND = 1.8  # with a control below it the machine was not free, and the ratio says nothing


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
    found = [Ratio("batch: pose and both Jacobians", least / count * 1e9, "ns each", "", 1.0, "≤ 170")]
    return found + (two_cores(arm, q, out, 1 if short else 9) if shutil.which("cc") else [])


def two_cores(arm: dqc.Robot, q: np.ndarray, out: np.ndarray, rounds: int) -> list[Ratio]:
    """Return what two threads gain on a batch beside what two plain C processes gain, all in turns."""

    def ours(part: slice) -> None:
        kernels.batch(kernels.kinematics.pointer, arm.chain, q[part], out[part])

    halves = [slice(0, len(q) // 2), slice(len(q) // 2, None)]
    with ThreadPoolExecutor(2) as threads, tempfile.TemporaryDirectory() as folder:
        program = Path(folder) / "batch"
        subprocess.run(["cc", "-O3", SOURCE, "-o", program, "-lm"], check=True)
        pair = [CProcess(program, arm.chain, q[half]) for half in halves]
        functions: dict[str, Callable[[], object]] = {
            "ours 1": lambda: ours(slice(None)),
            "ours 2": lambda: list(threads.map(ours, halves)),
            "C 1": lambda: [together([process]) for process in pair],
            "C 2": lambda: together(pair),
        }
        times: dict[str, list[float]] = {name: [] for name in functions}
        for _ in range(rounds):
            for name, function in functions.items():
                start = time.perf_counter()
                function()
                times[name].append(time.perf_counter() - start)
        for process in pair:
            process.close()
    seconds = {name: float(np.median(values)) for name, values in times.items()}
    gain, control = (seconds[f"{kind} 1"] / seconds[f"{kind} 2"] for kind in ("ours", "C"))
    void = "" if control >= SOUND else f" (void: the control is below {SOUND})"
    what, wanted = f"batch: speed-up of two cores{void}", "≥ 0" if void else "≥ 0.93"
    return [Ratio(what, gain, "", "two plain C processes", control, wanted)]


class CProcess:
    """A C program that computes the same batch."""

    def __init__(self, program: Path, chain: np.ndarray, q: np.ndarray) -> None:
        command = [str(program), str(q.shape[1]), str(len(q))]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        self._tell(np.ascontiguousarray(chain).tobytes() + q.tobytes())
        self.wait()

    def start(self) -> None:
        """Let it compute."""
        self._tell(b".")

    def wait(self) -> None:
        """Wait for its word."""
        assert self._process.stdout is not None
        if not self._process.stdout.readline():
            raise SystemExit("the C program ended")

    def close(self) -> None:
        """End it."""
        self._process.communicate()

    def _tell(self, data: bytes) -> None:
        assert self._process.stdin is not None
        self._process.stdin.write(data)
        self._process.stdin.flush()


def together(processes: list[CProcess]) -> None:
    """Let processes compute at the same time."""
    for process in processes:
        process.start()
    for process in processes:
        process.wait()

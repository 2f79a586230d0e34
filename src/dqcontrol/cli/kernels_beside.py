"""Kernels of every run, compiled in a second process while the first one compiles those that its law needs."""

from __future__ import annotations

import os
import subprocess
import sys

from dqcontrol.compiled import kernel_cache
from dqcontrol.compiled.numba_choice import IS_PLAIN
from dqcontrol.loop.record import pose_errors
from dqcontrol.loop.rollout import rollout
from dqcontrol.measures.run_numbers import measure_kernel
from dqcontrol.robots.inverse.inverse_kernels import solve

_IN_THEIR_ORDER = (solve, rollout, measure_kernel, pose_errors)  # half of what a first run compiles


def compile_beside() -> None:
    """Start the second process where these kernels are new and kept, and a processor is left; nobody waits for it."""
    if (
        IS_PLAIN  # kernels are kept by Numba's internals alone
        or kernel_cache.root() is None
        or (os.cpu_count() or 1) < 2
        or kernel_cache.is_kept(measure_kernel.function)
    ):
        return
    command = [sys.executable, "-P", "-m", __name__]  # -P: no module of the folder that it runs in
    nothing = subprocess.DEVNULL
    subprocess.Popen(command, stdin=nothing, stdout=nothing, stderr=nothing)


if __name__ == "__main__":
    for each in _IN_THEIR_ORDER:
        _ = each.compiled

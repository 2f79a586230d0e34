"""How long the first answers take: help, import, the first compiled run with and without a cache.

All modules have their bytecode, as installed ones do. "Import" is of the package and of what `RUN` uses of it.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time

import numpy as np
from measure import Ratio

IMPORT = """
import numpy as np, dqcontrol as dqc
dqc.load_robot, dqc.references, dqc.laws, dqc.plants, dqc.simulate
"""
RUN = f"""{IMPORT}
arm = dqc.load_robot("iiwa7")
q = np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])
goal = dqc.references.SetPoint(arm.fkm(q + 0.1))
dqc.simulate(arm, goal, dqc.laws.Proportional(gain=5.0), dqc.plants.Integrator(), q, 0.01, 1.0)
"""


def seconds(*arguments: str, kernels: str, bytecode: str) -> float:
    """Return how long a Python process takes that has these folders."""
    environment = dict(os.environ, DQCONTROL_CACHE=kernels, PYTHONPYCACHEPREFIX=bytecode)
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    start = time.perf_counter()
    subprocess.run([sys.executable, *arguments], check=True, capture_output=True, env=environment)
    return time.perf_counter() - start


def ratios(short: bool) -> list[Ratio]:
    """Return all lines."""
    calls = {
        "help": ("-m", "dqcontrol", "--help"),
        "numba": ("-c", "import numpy, numba"),
        "import": ("-c", IMPORT),
        "warm": ("-c", RUN),
        "cold": ("-c", RUN),
    }
    best = dict.fromkeys(calls, np.inf)
    with tempfile.TemporaryDirectory() as bytecode, tempfile.TemporaryDirectory() as kept:
        for arguments in calls.values():
            seconds(*arguments, kernels=kept, bytecode=bytecode)
        for i in range(1 if short else 7):
            for name, arguments in calls.items():
                if name == "cold" and i > 2:  # it takes longest
                    continue
                with tempfile.TemporaryDirectory() as fresh:
                    kernels = fresh if name == "cold" else kept
                    best[name] = min(best[name], seconds(*arguments, kernels=kernels, bytecode=bytecode))
    return [
        Ratio("dqcontrol --help", best["help"], "s", "", 1.0, "≤ 0.3"),
        Ratio("import, beyond numpy and numba", best["import"] - best["numba"], "s", "", 1.0, "≤ 0.15"),
        Ratio("first run, nothing compiled", best["cold"], "s", "", 1.0, "≤ 8"),
        Ratio("first run, compiled before", best["warm"], "s", "", 1.0, "≤ 1"),
    ]

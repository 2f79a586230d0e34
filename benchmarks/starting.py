"""How long the first answers take: help, import, the first compiled run with and without a cache."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time

import numpy as np
from measure import Ratio

RUN = """
import numpy as np, dqcontrol as dqc
arm = dqc.load_robot("iiwa7")
q = np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])
goal = dqc.references.SetPoint(arm.fkm(q + 0.1))
dqc.simulate(arm, goal, dqc.laws.Proportional(gain=5.0), dqc.plants.Integrator(), q, 0.01, 1.0)
"""


def seconds(*arguments: str, cache: str | None = None) -> float:
    """Return how long a Python process takes."""
    environment = dict(os.environ, **({"DQCONTROL_CACHE": cache} if cache else {}))
    start = time.perf_counter()
    subprocess.run([sys.executable, *arguments], check=True, capture_output=True, env=environment)
    return time.perf_counter() - start


def ratios(short: bool) -> list[Ratio]:
    """Return all lines."""
    rounds = 1 if short else 7
    best = dict.fromkeys(("help", "numba", "import", "cold", "warm"), np.inf)
    with tempfile.TemporaryDirectory() as kept:
        seconds("-c", RUN, cache=kept)
        for i in range(rounds):
            best["help"] = min(best["help"], seconds("-m", "dqcontrol", "--help"))
            best["numba"] = min(best["numba"], seconds("-c", "import numpy, numba"))
            best["import"] = min(best["import"], seconds("-c", "import dqcontrol"))
            best["warm"] = min(best["warm"], seconds("-c", RUN, cache=kept))
            if i < 2:
                with tempfile.TemporaryDirectory() as fresh:
                    best["cold"] = min(best["cold"], seconds("-c", RUN, cache=fresh))
    return [
        Ratio("dqcontrol --help", best["help"], "s", "", 1.0, "≤ 0.3"),
        Ratio("import, beyond numpy and numba", best["import"] - best["numba"], "s", "", 1.0, "≤ 0.15"),
        Ratio("first run, nothing compiled", best["cold"], "s", "", 1.0, "≤ 8"),
        Ratio("first run, compiled before", best["warm"], "s", "", 1.0, "≤ 1"),
    ]

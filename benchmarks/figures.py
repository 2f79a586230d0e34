"""What the figures of a run cost: processor time beside that of the run itself, also against another checkout.

Examples
--------
::

    git worktree add ../before main~20
    python benchmarks/figures.py --before ../before

Figures are what saving a run with them takes longer than without. Rounds of the checkouts take turns, and of each the
least counts, as other processes lengthen the time that a processor takes, too.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
from measure import Ratio, table

ROOT = Path(__file__).parents[1]
MEASURE = """
import json, sys, tempfile, time, warnings
from pathlib import Path
import dqcontrol as dqc
warnings.simplefilter("ignore")
rounds, period = int(sys.argv[1]), float(sys.argv[2])
spec = {
    "name": "circle", "robot": "iiwa7", "start": [0, 0.6, 0, 1.6, 0, 0.6, 0], "period": period,
    "reference": {"kind": "circle", "radius": 0.07, "duration": 12},
    "law": {"kind": "proportional-feedforward", "gain": 4},
    "plant": {"kind": "servo", "encoder_noise": 2e-5},
}
def spent(work):
    begin = time.process_time()
    done = work()
    return time.process_time() - begin, done
_, run = spent(lambda: dqc.run(spec))
least = {}
for _ in range(rounds + 1):
    with tempfile.TemporaryDirectory() as folder:
        times = {
            "run": spent(lambda: dqc.run(spec))[0],
            "plain": spent(lambda: run.save(Path(folder) / "plain", figures=False))[0],
            "drawn": spent(lambda: run.save(Path(folder) / "drawn"))[0],
        }
    if _:  # the first round loads Matplotlib
        least = {name: min(least.get(name, value), value) for name, value in times.items()}
print(json.dumps(least))
"""
CASES = {"of 1200 steps": 0.01, "of 100 000 steps": 1.2e-4}


def measured(checkout: Path, rounds: int, period: float) -> dict[str, float]:
    """Return the processor time of a run, of saving it, and of saving it with its figures, s."""
    done = subprocess.run(
        [sys.executable, "-c", MEASURE, str(rounds), str(period)],
        env={**os.environ, "PYTHONPATH": str(checkout / "src")},
        capture_output=True,
        text=True,
        check=True,
    )
    return json.loads(done.stdout)


def ratios(short: bool, before: Path | None = None) -> list[Ratio]:
    """Return the lines of the table: figures in s, and against those of another checkout or the run itself."""
    found = []
    for case, period in list(CASES.items())[: 1 if short else None]:
        checkouts = [ROOT, *([before] if before else [])]
        figures, runs = dict.fromkeys(checkouts, np.inf), dict.fromkeys(checkouts, np.inf)
        for _ in range(1 if short else 3):
            for checkout in checkouts:
                times = measured(checkout, 1 if short else 3, period)
                figures[checkout] = min(figures[checkout], times["drawn"] - times["plain"])
                runs[checkout] = min(runs[checkout], times["run"])
        if before:
            found.append(
                Ratio(f"figures of a run {case}", figures[ROOT], "s", "before", figures[before], "≤ 0.2")
            )
        else:
            found.append(Ratio(f"figures of a run {case}", figures[ROOT], "s", "", 1.0, "≤ 0.75"))
        found.append(Ratio(f"figures of a run {case}", figures[ROOT], "s", "the run", runs[ROOT], "≤ 50"))
    return found


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--before", type=Path, help="another checkout, measured in turns")
    parser.add_argument("--short", action="store_true", help="one round of the shorter run")
    given = parser.parse_args()
    print(table(ratios(given.short, given.before), "processor time of figures").markdown())


if __name__ == "__main__":
    main()

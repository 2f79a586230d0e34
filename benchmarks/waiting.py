"""What a person waits for, in processor time beside that of another checkout, both in turns.

Examples
--------
::

    git worktree add ../before main~20
    python benchmarks/waiting.py --before ../before

Of each row the least of the rounds counts, as other processes lengthen the time that a processor takes, too. A first
run is one of `dqcontrol run` without a folder of compiled kernels, a warm one the same again, both by the clock, as a
second process compiles beside the first. Figures are what saving
a run with them takes longer than without; a run of a study is one of noisy servos, without what starting costs.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import yaml
from measure import Ratio, table

ROOT = Path(__file__).parents[1]
SPEC = {
    "name": "circle",
    "robot": "iiwa7",
    "start": [0, 0.6, 0, 1.6, 0, 0.6, 0],
    "period": 0.01,
    "reference": {"kind": "circle", "radius": 0.07, "duration": 12},
    "law": {"kind": "proportional-feedforward", "gain": 4},
    "plant": {"kind": "servo", "encoder_noise": 2e-5},
}
TUNE = SPEC | {
    "name": "tune",
    "laws": {
        "K": {"kind": "proportional", "gain": 5},
        "K+FF": {"kind": "proportional-feedforward", "gain": 5},
    },
    "tune": {
        "objectives": {"position.rms": 1, "command_jerk": 5e-4},
        "budget": 40,
        "front": {"objectives": ["position.rms", "command_jerk"], "budget": 40},
    },
}
del TUNE["law"]
MEASURE = """
import importlib.util, json, sys, tempfile, time, warnings
from pathlib import Path
import numpy as np
import dqcontrol as dqc
from dqcontrol.experiments.sweep import read_sweep
from dqcontrol.recording import save_record
warnings.simplefilter("ignore")
rounds, spec = int(sys.argv[1]), json.loads(sys.argv[2])
def spent(work):
    begin = time.process_time()
    work()
    return time.process_time() - begin
home = {"robot": "panda", "start": [0, -0.3, 0, -2.0, 0, 1.8, 0.7]}
has_world = importlib.util.find_spec("dqcontrol.world") is not None  # obstacles were constraints before
def obstacles(count):
    places = np.random.default_rng(1).uniform([1.2, -1, 0], [2, 1, 1], (count, 3)).tolist()
    if has_world:
        world = {f"ball {k}": {"sphere": 0.02, "position": place} for k, place in enumerate(places)}
        around = {"world": world, "constraints": {"clear_of": "all"}}
    else:
        balls = {f"ball {k}": {"kind": "sphere", "radius": 0.02, "center": each} for k, each in enumerate(places)}
        around = {"constraints": {"obstacles": balls}}
    return lambda: dqc.run(spec | home | around | {"plant": {"kind": "integrator"}, "duration": 0.1})
run = dqc.run(spec)
over = {"law.gain": {"low": 1, "high": 50, "scale": "log"}, "plant.time_constant": {"low": 0.01, "high": 0.1}}
study = read_sweep(spec | {"duration": 10.0, "sweep": {"method": "sobol", "points": 1000, "over": over}})
least = {}
for k in range(rounds + 1):
    with tempfile.TemporaryDirectory() as folder:
        here = Path(folder)
        times = {
            "loop": spent(lambda: dqc.run(spec)),
            "plain": spent(lambda: run.save(here / "plain", figures=False)),
            "drawn": spent(lambda: run.save(here / "drawn")),
            "record": spent(lambda: save_record(run.record, here / "record.mcap")) / len(run.record.q),
            "study": spent(lambda: list(study.rows(range(200 * k, 200 * (k + 1))))) / 200,
            "300": spent(obstacles(300)),
            "100": spent(obstacles(100)),
        }
    if k:  # the first round loads Matplotlib and kernels
        least = {name: min(least.get(name, value), value) for name, value in times.items()}
print(json.dumps(least))
"""


def processor(*command: str, checkout: Path, kernels: str | None = None) -> tuple[float, str]:
    """Return the processor time of a command with a checkout's code, s, and what it prints."""
    environment = {**os.environ, "PYTHONPATH": str(checkout / "src")}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    if kernels:
        environment["DQCONTROL_CACHE"] = kernels
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(
        [sys.executable, *command], env=environment, capture_output=True, text=True, check=True
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, done.stdout


def measured(checkout: Path, rounds: int) -> dict[str, float]:
    """Return what each row takes with a checkout's code, s."""
    found = json.loads(
        processor("-c", MEASURE, str(rounds), json.dumps(SPEC), checkout=checkout)[1].splitlines()[-1]
    )
    with tempfile.TemporaryDirectory() as folder:
        for name, content in {"run": SPEC, "tune": TUNE}.items():
            (Path(folder) / f"{name}.yaml").write_text(yaml.safe_dump(content), encoding="utf-8")

        def command(name: str) -> tuple[float, float]:
            file, out = str(Path(folder) / f"{name}.yaml"), str(Path(folder) / "out")
            call = ("-m", "dqcontrol", name, file, "--out", out, "--force")
            begin = time.monotonic()
            spent = processor(*call, checkout=checkout, kernels=str(Path(folder) / "kernels"))[0]
            return time.monotonic() - begin, spent

        found["first"], found["warm"] = command("run")[0], command("run")[0]
        command("tune")  # compiles
        found["tune"] = command("tune")[1]
    return found


def ratios(rounds: int, before: Path | None) -> list[Ratio]:
    """Return the lines of the table."""
    checkouts = [ROOT, *([before] if before else [])]
    least: dict[Path, dict[str, float]] = {checkout: {} for checkout in checkouts}
    for _ in range(rounds):
        for checkout in checkouts:
            times, best = measured(checkout, 3), least[checkout]
            times["figures"] = times["drawn"] - times["plain"]
            least[checkout] = {name: min(best.get(name, value), value) for name, value in times.items()}
    now = least[ROOT]
    rows = [
        ("first run on a machine, by the clock", "first", "s", 1.0, "≤ 5", now["warm"], "a warm one"),
        ("figures of a run of 1200 steps", "figures", "s", 1.0, "≤ 0.75", 1.0, ""),
        ("recording of a step", "record", "µs", 1e6, "≤ 2", 1.0, ""),
        ("a run of a study, 1000 steps", "study", "ms", 1e3, "≤ 1.2", 1.0, ""),
        ("tune, two laws", "tune", "s", 1.0, "", 1.0, ""),
        ("a run beside 300 obstacles", "300", "ms", 1e3, "≤ 3", now["100"], "100 obstacles"),
    ]
    found = []
    for what, key, unit, scale, wanted, peer, named in rows:
        if wanted:
            found.append(Ratio(what, scale * now[key], unit, named, scale * peer if named else 1.0, wanted))
        if before:
            found.append(Ratio(what, scale * now[key], unit, "before", scale * least[before][key], "≤ 1"))
    return found


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--before", type=Path, help="another checkout, measured in turns")
    parser.add_argument("--rounds", type=int, default=3)
    given = parser.parse_args()
    print(table(ratios(given.rounds, given.before), "What a person waits for, processor time").markdown())


if __name__ == "__main__":
    main()

"""How many instructions a step of the compiled closed loop takes, counted by callgrind.

python benchmarks/instructions.py STEPS       so many steps of law K and nothing else, for callgrind
python benchmarks/instructions.py --laws      a table of all laws; --before FOLDER compares with another checkout
"""

from __future__ import annotations

import argparse
import itertools
import math
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

import dqcontrol as dqc
from dqcontrol.loop import close_loop
from dqcontrol.plants import Integrator, Servo

START, PERIOD = np.array([0, 0.6, 0, 1.6, 0, 0.6, 0]), 0.008
DRIVING = np.array([0, 0, 0, 0.3, -0.8, 1.2, 0.6, 0.4])
FEW, MANY = 200, 1200  # steps; the difference is free of what Python does before and after
MARK = "getpgid"  # of the C library: where it is called, callgrind writes what it has counted since
# Valgrind knows no AVX-512 and not all of AVX.
PLAIN = {"NUMBA_CPU_NAME": "x86-64-v2", "NUMBA_CPU_FEATURES": "", "PYTHONHASHSEED": "0"}

INVERSE = {"inverse": dqc.laws.DampedInverse(damping=0.01)}
GAINS = {"gain": 20.0}
H_INFINITY = {"orientation_gain": 40.0, "translation_gain": 20.0}
QUADRATIC = {"error_weight": 400.0, "control_weight": 1.0}
SECOND_ORDER = {"stiffness": 4.0, "damping": 4.0, "null_space": None}
ARM_LAWS = {
    "K": ("Proportional", GAINS),
    "K+FF": ("ProportionalFeedforward", GAINS),
    "decoupled": ("DecoupledProportional", GAINS),
    "position": ("PartialProportional", GAINS | {"part": "position"}),
    "rotation": ("PartialProportional", GAINS | {"part": "rotation"}),
    "axis": ("PartialProportional", GAINS | {"part": "axis"}),
    "HIR": ("HInfinity", H_INFINITY),
    "HIR, left": ("HInfinity", H_INFINITY | {"form": "left"}),
    "HIRT": ("HInfinityTracking", H_INFINITY),
    "HIRT, left": ("HInfinityTracking", H_INFINITY | {"form": "left"}),
    "LQR-R8": ("LinearQuadraticR8", QUADRATIC),
    "LQR-DQ": ("LinearQuadraticDQ", QUADRATIC),
    "LQR-DQ, sin": ("LinearQuadraticDQ", QUADRATIC | {"form": "sin"}),
    "LQR-DQ, left": ("LinearQuadraticDQ", QUADRATIC | {"error": "left"}),
}
DRIVE_LAWS = {
    "drive: K": ("Proportional", {"gain": 2.0}),
    "drive: feedback linearisation": ("FeedbackLinearization", SECOND_ORDER),
}
DEFAULT_LAWS = {"K": "Proportional", "K+FF": "ProportionalFeedforward"}  # with the inverse that they have
STARTS = {"panda": [0, -0.3, 0, -2.0, 0, 1.7, 0.7], "youbot-arm": [0.1, 0.4, -0.6, 0.3, 0.2]}
AWAY = {
    "1 mm away": 1e-3,
    "20 cm away": 0.2,
}  # m, towards the base; the hand hardly moves in so few, short steps


def main(steps: int) -> None:
    """Let law K drive an arm along a circle."""
    arm = dqc.load_robot("iiwa7")
    circle = dqc.references.Circle(arm.fkm(START), radius=0.07, duration=10_000 * PERIOD)
    law = dqc.laws.Proportional(gain=20.0, inverse=dqc.laws.DampedInverse(damping=0.01))
    samples = np.repeat(circle.samples(np.zeros(1)), steps, axis=0)
    plant = Integrator().start(arm, START, PERIOD, steps, 0)
    close_loop(law.prepare(arm, circle, PERIOD), plant, samples)


def loops() -> Iterator[tuple[str, Callable[[int], object]]]:
    """Yield the name of each law that this checkout has, and a function that takes so many steps of it."""
    arm, john = dqc.load_robot("iiwa7"), dqc.load_robot("little-john")
    servo = Servo(time_constant=0.02, delay=PERIOD, sag=0.69, stiffness=100.0, encoder_resolution=4e-4)
    integrator = Integrator()
    tasks = [
        *((name, arm, START, integrator, *law) for name, law in ARM_LAWS.items()),
        ("K on servos", arm, START, servo, *ARM_LAWS["K"]),
        *((name, john, DRIVING, integrator, *law) for name, law in DRIVE_LAWS.items()),
    ]
    for name, robot, start, plant, law_name, given in tasks:
        law, options = getattr(dqc.laws, law_name, None), INVERSE | given
        if law is None or not options.keys() <= set(law.__struct_fields__):  # in an older checkout
            continue
        circle = dqc.references.Circle(robot.fkm(start), radius=0.07, duration=MANY * PERIOD)
        prepared = law(**options).prepare(robot, circle, PERIOD)
        samples = circle.samples(PERIOD * np.arange(MANY))

        def run(steps, robot=robot, start=start, plant=plant, prepared=prepared, samples=samples):
            close_loop(prepared, plant.start(robot, start, PERIOD, steps, 0), samples[:steps])

        yield name, run
    yield from default_loops()


def default_loops() -> Iterator[tuple[str, Callable[[int], object]]]:
    """Yield the same for laws as they are by default, near and far from a resting target and along a circle."""
    for (robot_name, start), (name, law_name) in itertools.product(STARTS.items(), DEFAULT_LAWS.items()):
        arm, q = dqc.load_robot(robot_name), np.array(start, dtype=float)
        pose, law = arm.fkm(q), getattr(dqc.laws, law_name)(gain=10.0)
        circle = dqc.references.Circle(pose, radius=0.07, duration=MANY * PERIOD)
        tasks: dict[str, tuple[dqc.references.Circle | None, float, np.ndarray]] = {}
        tasks["circle"] = (circle, PERIOD, circle.samples(PERIOD * np.arange(MANY)))
        for label, away in AWAY.items():
            there = dqc.algebra.pose(pose[:4], dqc.algebra.translation(pose) - [away, 0.0, 0.0])
            tasks[label] = None, 1e-6, np.repeat(dqc.Sample(there).numbers[None], MANY, axis=0)
        for label, (reference, period, samples) in tasks.items():
            prepared = law.prepare(arm, reference, period)

            def run(steps, arm=arm, q=q, period=period, prepared=prepared, samples=samples):
                close_loop(prepared, Integrator().start(arm, q, period, steps, 0), samples[:steps])

            yield f"{robot_name}, {name}, {label}", run


def run_loops() -> None:
    """Take few and many steps of each law between marks; print the names."""
    for name, run in loops():
        run(FEW)  # what the first run alone does
        for steps in (FEW, MANY):
            os.getpgid(0)
            run(steps)
        os.getpgid(0)
        print(name)


def count(checkout: Path) -> dict[str, float]:
    """Return the instructions of a step of each law in a checkout."""
    here = Path(__file__).parent
    environment = {**os.environ, **PLAIN, "PYTHONPATH": os.pathsep.join([str(here), str(checkout / "src")])}
    command = [sys.executable, "-c", "import instructions; instructions.run_loops()"]
    names = subprocess.run(command, env=environment, stdout=subprocess.PIPE, text=True, check=True).stdout
    with tempfile.TemporaryDirectory() as folder:
        callgrind = ["valgrind", "--tool=callgrind", "--trace-children=yes", f"--dump-before={MARK}"]
        callgrind.append(f"--callgrind-out-file={folder}/%p")
        subprocess.run([*callgrind, *command], env=environment, capture_output=True, check=True)
        parts = sorted(Path(folder).glob("*.*"), key=lambda path: int(path.suffix[1:]))
        counts = [int(re.findall(r"^summary: (\d+)", path.read_text(), re.M)[0]) for path in parts]
    few, many = counts[1::3], counts[2::3]
    return {name: (b - a) / (MANY - FEW) for name, a, b in zip(names.splitlines(), few, many, strict=True)}


def table(before: Path | None) -> str:
    """Return what is counted, of another checkout too, as lines."""
    now = count(Path(__file__).parent.parent)
    then = count(before) if before else {}
    lines = [f"{'instructions a step':30} {'before':>8} {'now':>8} {'ratio':>7}"]
    for name, value in now.items():
        old = then.get(name, math.nan)
        known = math.isfinite(old)  # a law of today may be none of the other checkout's
        lines.append(
            f"{name:30} {f'{old:.0f}' if known else '–':>8} {value:8.0f} {f'{value / old:.3f}' if known else '–':>7}"
        )
    return "\n".join(lines)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("steps", type=int, nargs="?", help="of law K and nothing else")
    parser.add_argument("--laws", action="store_true", help="count a step of every law")
    parser.add_argument("--before", type=Path, metavar="FOLDER", help="another checkout to compare with")
    asked = parser.parse_args()
    if asked.laws:
        print(table(asked.before))
    elif asked.steps:
        main(asked.steps)
    else:
        parser.error("give the number of steps, or --laws")

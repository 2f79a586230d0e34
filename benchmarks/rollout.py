"""The compiled closed loop against the same law written by hand in C, and P16's table of 900 runs."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from measure import Ratio, medians

import dqcontrol as dqc
from dqcontrol.loop import close_loop
from dqcontrol.plants import Integrator, Servo

START = np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])
STEPS, PERIOD, GAIN, DAMPING = 3000, 0.008, 20.0, 0.01
SOURCES = Path(__file__).parent / "c"
IN_C = {  # the name in the table: the file and function, the compiler's flags, what is wanted
    "C, -O3": ("closed_loop", ["-O3"], "≤ 1.35"),
    "C, -O3 -march=native -ffast-math": ("closed_loop", ["-O3", "-march=native", "-ffast-math"], "≤ 1.35"),
    "an expert's C, -O3": ("expert_loop", ["-O3"], "≤ 1.20"),
    "an expert's C, -O3 -march=native": ("expert_loop", ["-O3", "-march=native"], "≤ 1.20"),
}


def by_c(name: str, flags: list[str], arm: dqc.Robot, samples: np.ndarray, folder: Path) -> Any:
    """Build the C program and return a function that runs it; None without a compiler."""
    compiler = shutil.which("cc")
    if compiler is None:
        return None
    library = folder / f"{name}{'_'.join(flags)}.so"
    source = SOURCES / f"{name}.c"
    subprocess.run([compiler, *flags, "-shared", "-fPIC", source, "-o", library, "-lm"], check=True)
    function = getattr(ctypes.CDLL(str(library)), name)
    chain = np.ascontiguousarray(arm.chain)

    def pointer(array: np.ndarray) -> ctypes.c_void_p:
        return array.ctypes.data_as(ctypes.c_void_p)

    def run() -> np.ndarray:
        q, record, command = START.copy(), np.empty((STEPS, 7)), np.empty((STEPS, 7))
        function(
            pointer(chain),
            7,
            pointer(q),
            pointer(samples),
            samples.shape[1],
            STEPS,
            ctypes.c_double(PERIOD),
            ctypes.c_double(GAIN),
            ctypes.c_double(DAMPING),
            ctypes.c_double(dqc.laws.DampedInverse(damping=DAMPING).characteristic_length),
            pointer(record),
            pointer(command),
        )
        return record

    return run


def ratios(short: bool) -> list[Ratio]:
    """Return the steps a second on ideal joints and servos, and the ratios to C."""
    arm = dqc.load_robot("iiwa7")
    circle = dqc.references.Circle(arm.fkm(START), radius=0.07, duration=STEPS * PERIOD)
    samples = circle.samples(PERIOD * np.arange(STEPS))
    damped = dqc.laws.Proportional(gain=GAIN, inverse=dqc.laws.DampedInverse(damping=DAMPING))
    law = damped.prepare(arm, circle, PERIOD)
    servo = Servo(
        time_constant=0.02, delay=PERIOD, sag=0.69, stiffness=100.0, encoder_resolution=2 * np.pi / 2**14
    )
    functions: dict[str, Any] = {
        "ideal": lambda: close_loop(law, Integrator().start(arm, START, PERIOD, STEPS, 0), samples),
        "servo": lambda: close_loop(law, servo.start(arm, START, PERIOD, STEPS, 0), samples),
    }
    both, twice = dqc.TwoArms(arm, arm.mirrored(), task="absolute"), np.concatenate([START, START])
    path = dqc.references.Circle(both.fkm(twice), radius=0.07, duration=STEPS * PERIOD)
    shared, along = damped.prepare(both, path, PERIOD), path.samples(PERIOD * np.arange(STEPS))
    pair: dict[str, Any] = {  # apart from the rest, which run as they do without it
        "one arm": functions["ideal"],
        "two arms": lambda: close_loop(shared, Integrator().start(both, twice, PERIOD, STEPS, 0), along),
    }
    with tempfile.TemporaryDirectory() as folder:
        for name, (source, flags, _) in IN_C.items():
            run = by_c(source, flags, arm, samples, Path(folder))
            if run is not None:
                functions[name] = run
                difference = np.abs(run() - functions["ideal"]().q).max()
                if not difference < 1e-9:
                    raise SystemExit(f"C differs by {difference:g}")
        rounds = 3 if short else 25
        t = medians(functions, 3, rounds) | medians(pair, 3, rounds)
    step = {name: microseconds / STEPS * 1e3 for name, microseconds in t.items()}
    found = [
        Ratio("closed loop, K on ideal joints", 1e3 / step["ideal"], "million steps/s", "", 1.0, "≥ 3.00"),
        Ratio("closed loop, K on servos", 1e3 / step["servo"], "million steps/s", "", 1.0, "≥ 1.00"),
    ]
    found.append(
        Ratio(
            "the same of two arms, absolute pose",
            1e3 / step["two arms"],
            "million steps/s",
            "one arm",
            1e3 / step["one arm"],
            "≥ 0.45",
        )
    )
    for name, (_, _, wanted) in IN_C.items():
        if name in step:
            found.append(
                Ratio("closed loop, K on ideal joints", step["ideal"], "ns", name, step[name], wanted)
            )
    return found

"""Controllers in C against what is wanted of them: equality with Python, memory, time, size and jitter.

    python benchmarks/export.py [--jitter SECONDS] [--fuzz STEPS]

Needs a C compiler; CasADi (group bench) for the comparison of kinematics. Times are taken in turns; the jitter of the C
loop stands beside that of a bare loop with absolute deadlines and that of the same spec in Python.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import yaml
from measure import Ratio, table

import dqcontrol as dqc
import dqcontrol_theses
from dqcontrol.compiled.object_code import code_object, target_named
from dqcontrol.experiments.prepared_experiment import prepare
from dqcontrol.experiments.run import execute
from dqcontrol.export import ExportSummary, export_controller
from dqcontrol.export.compiled_run import ThreadHost, _startable_plant
from dqcontrol.export.controller_folder import vector_header
from dqcontrol.export.controller_parts import controller_parts
from dqcontrol.loop import Clock
from dqcontrol.robots.kinematics.kinematics_kernels import kinematics

HERE = Path(__file__).parent
ARM = {
    "name": "arm",
    "robot": "iiwa7",
    "start": [0, 0.6283, 0, 1.5708, 0, 0.6283, 0],
    "period": 0.001,
    "duration": 5,
    "reference": {"kind": "circle", "radius": 0.07, "duration": 12},
    "law": {"kind": "proportional-feedforward", "gain": 4},
    "plant": {"kind": "servo", "time_constant": 0.05},
}
SUPERVISED = ARM | {"supervisor": True}
WIDE = {  # bounds that P16's runs keep, which leave the robot's limits: u also holds the arm against gravity
    "velocity": 100.0,
    "acceleration": 1e4,
    "tracking_error": 100.0,
    "overspeed": 100.0,
    "jump": 2.0,
    "measured_tolerance": 100.0,
    "slow_below": 0.0,
    "hold_below": 0.0,
    "ramp": 0.0,
}
FLAGS = ["-O3", "-march=native", "-ffast-math"]


def shell(*words: object) -> str:
    """Run a command and return what it printed."""
    done = subprocess.run([*map(str, words)], capture_output=True, text=True, check=False)
    if done.returncode:
        sys.exit(f"{words[0]}: {done.stdout}{done.stderr}")
    return done.stdout


def casadi_source(folder: Path) -> Path | None:
    """Write CasADi's C code of pose, pose Jacobian and twist Jacobian of the arm; None without CasADi."""
    try:
        import casadi as ca
    except ImportError:
        return None
    chain = dqc.load_robot(ARM["robot"]).chain
    q = ca.SX.sym("q", 7)

    def product(a, b):  # of quaternions
        return ca.vertcat(
            a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
            a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
            a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
            a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
        )

    def turned(r, v):
        t = 2 * ca.cross(r[1:4], v)
        return v + r[0] * t + ca.cross(r[1:4], t)

    def moved(r, p, row):
        return product(r, ca.DM(row[:4])), p + turned(r, ca.DM(row[4:7]))

    r, p = ca.DM([1, 0, 0, 0]), ca.DM.zeros(3)
    columns = []
    for i in range(7):
        r, p = moved(r, p, chain[i])
        z = turned(r, ca.DM([0, 0, 1]))
        columns.append(ca.vertcat(z, ca.cross(p, z)))
        r = product(r, ca.vertcat(ca.cos(q[i] / 2), 0, 0, ca.sin(q[i] / 2)))
    r, p = moved(r, p, chain[7])
    pose = ca.vertcat(r, 0.5 * product(ca.vertcat(0, p), r))
    twist_jacobian = ca.horzcat(*columns)
    function = ca.Function(
        "kinematics", [q], [ca.densify(pose), ca.densify(ca.jacobian(pose, q)), twist_jacobian]
    )
    values = [np.array(value) for value in function(np.linspace(-1, 1, 7))]
    ours = dqc.load_robot(ARM["robot"]).kinematics(np.linspace(-1, 1, 7))
    np.testing.assert_allclose(values[0].ravel(), ours.pose, atol=1e-12)
    np.testing.assert_allclose(values[1], ours.pose_jacobian, atol=1e-12)
    np.testing.assert_allclose(values[2], ours.twist_jacobian, atol=1e-12)
    path = folder / "casadi.c"
    path.write_text(_generated(function, folder), encoding="utf-8")
    return path


def _generated(function, folder: Path) -> str:
    import os

    here = Path.cwd()
    os.chdir(folder)
    try:
        name = function.generate("casadi_kinematics.c")
        return Path(name).read_text(encoding="utf-8")
    finally:
        os.chdir(here)


def step_times(spec: dict, folder: Path) -> tuple[list[float], ExportSummary]:
    """Return step, its plain median, kinematics and CasADi's (ns), calls of malloc, bytes; and the export."""
    done = export_controller(spec, folder / "c")
    shell("make", "-C", done.folder)
    native = target_named("native")
    (folder / "full.o").write_bytes(code_object({"dqc_kernel_full": kinematics}, native))
    source, objects = casadi_source(folder), [done.folder / "libdqc_controller.a", folder / "full.o"]
    define = ["-DWITH_CASADI"] if source else []
    if source:
        shell("cc", *FLAGS, "-c", source, "-o", folder / "casadi.o")
        objects.insert(0, folder / "casadi.o")
    header = done.folder / "dqc_kernels.h"
    text = header.read_text(encoding="utf-8")
    from dqcontrol.compiled.object_code import prototype

    header.write_text(text + prototype("dqc_kernel_full", kinematics.signature) + "\n", encoding="utf-8")
    wraps = [f"-Wl,--wrap={name}" for name in ("malloc", "calloc", "realloc")]
    program = folder / "steps"
    shell(
        "cc",
        "-O2",
        *define,
        f"-I{done.folder}",
        HERE / "c/export_steps.c",
        *objects,
        *wraps,
        "-lm",
        "-o",
        program,
    )
    return [float(word) for word in shell(program).split()], done


def spiral_equality(folder: Path) -> tuple[int, float]:
    """Return steps and the largest difference between C and Python on P16's spiral with faults and stops."""
    spec = Path(dqcontrol_theses.__file__).parent / "pereira2016/specs/spiral.yaml"
    data = yaml.safe_load(spec.read_text(encoding="utf-8")) | {"repeats": 1, "supervisor": WIDE}
    total, largest = 0, 0.0
    for law in data["laws"]:
        out = folder / f"spiral-{law}"
        done = export_controller(data, out, law=f"{law} · best")
        parts = controller_parts(data, f"{law} · best")
        whole = out / "test_vector.h"
        whole.write_text(vector_header(parts, target_named("native"), whole=True), encoding="utf-8")
        said = shell("make", "-C", done.folder, "test")
        words = said.split()
        total += int(words[words.index("steps,") - 1])
        largest = max(largest, float(words[words.index("Python") + 1]))
        print(next(line for line in said.splitlines() if "largest difference" in line))
    return total, largest


def tail(begin: np.ndarray, period: float) -> float:
    """Return what 99.9 % of the periods deviate at most, s."""
    return float(np.quantile(np.abs(np.diff(begin) - period), 0.999))


def jitter(folder: Path, seconds: float) -> None:
    """Print how the C loop, a bare loop and Python keep a period of 1 ms, in turns."""
    period, rounds = 1e-3, max(1, round(seconds / 10))
    share = seconds / rounds
    steps = round(share / period)
    spec = SUPERVISED | {"duration": share, "reference": ARM["reference"] | {"duration": share + 5}}
    spec["supervisor"] = {"stale_after": 1000.0}
    parts = controller_parts(spec)
    host = ThreadHost(parts, _startable_plant(parts), folder / "host")
    shell("cc", "-O2", HERE / "c/bare_loop.c", "-lpthread", "-o", folder / "bare")
    tails: dict[str, list[float]] = {"bare": [], "C": [], "Python": []}
    missed = dict.fromkeys(tails, 0)
    for _ in range(rounds):
        begin = np.array(shell(folder / "bare", 1_000_000, steps, 50).split(), dtype=float)
        tails["bare"].append(tail(begin, period))
        missed["bare"] += int((np.diff(begin) > 1.5 * period).sum())
        host.start()
        while not host.is_done:
            time.sleep(0.05)
        host.join()
        begin = host.rows[:steps].begin
        tails["C"].append(tail(begin, period))
        missed["C"] += int((np.diff(begin) > 1.5 * period).sum())
        clock = Clock(overrun="skip")
        setting = prepare(spec)
        execute(setting, setting.cases[0], clock=clock)
        tails["Python"].append(tail(clock.timing.begin, period))
        missed["Python"] += int((clock.timing.periods > 1.5 * period).sum())
    for name, values in tails.items():
        each = ", ".join(f"{1e6 * value:.0f}" for value in values)
        print(
            f"1 kHz, {name}: 99.9 % of the periods within {1e6 * np.median(values):.0f} µs, "
            f"median of {rounds} × {share:g} s ({each}); {missed[name]} periods over 1.5 ms"
        )


def ratios(short: bool = False) -> list[Ratio]:
    """Return what was measured against what is wanted; a ``short`` one leaves the supervisor out."""
    with tempfile.TemporaryDirectory() as name:
        return measured(Path(name), short)


def measured(folder: Path, short: bool) -> list[Ratio]:
    """Return the ratios of controllers that are built in a folder."""
    begin = time.perf_counter()
    alone, _ = step_times(ARM, folder / "alone")
    rows = [Ratio("step of K+FF, 7 joints", alone[0] / 1e3, "µs", "", 1.0, "≤ 0.6")]
    if alone[3]:
        peer = "CasADi, -O3 -ffast-math"
        rows.append(Ratio("pose and Jacobians", alone[2] / 1e3, "µs", peer, alone[3] / 1e3, "≤ 0.6"))
    if not short:
        guarded, whole = step_times(SUPERVISED, folder / "guarded")
        print(f"median of all steps: {alone[1]:.0f} ns, with supervisor {guarded[1]:.0f} ns")
        rows += [
            Ratio("step with supervisor", guarded[0] / 1e3, "µs", "", 1.0, "≤ 1"),
            Ratio("code with supervisor", whole.code / 1024, "kB", "", 1.0, "≤ 150"),
            Ratio("a controller", guarded[5] / 1024, "kB", "", 1.0, "≤ 20"),
            Ratio("calls of malloc in 100 000 steps", guarded[4], "", "", 1.0, "≤ 0"),
        ]
    rows.append(
        Ratio("export and build, each", (time.perf_counter() - begin) / (2 - short), "s", "", 1.0, "≤ 10")
    )
    return rows


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--jitter", type=float, default=0.0, help="seconds of each loop")
    parser.add_argument("--fuzz", type=int, default=0, help="random steps")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        print(table(measured(folder, short=False), "controllers in C"))
        steps, largest = spiral_equality(folder)
        print(f"P16's spiral, {steps} steps with faults and stops: largest difference to Python {largest:g}")
        if options.fuzz:
            built, program = folder / "guarded/c", folder / "fuzz"
            source = HERE.parent / "tests/export/fuzz.c"
            library = built / "libdqc_controller.a"
            shell("cc", "-O2", "-std=gnu99", f"-I{built}", source, library, "-lm", "-o", program)
            print(shell(program, options.fuzz, 1).strip())
        if options.jitter:
            jitter(folder, options.jitter)


if __name__ == "__main__":
    main()

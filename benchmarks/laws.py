"""What a step of every law costs beside one of law K, compiled and from Python, and what its preparation costs."""

from __future__ import annotations

import os
import platform
from functools import partial

import numba
import numpy as np
from measure import medians
from msgspec.structs import replace

import dqcontrol as dqc
from dqcontrol import laws
from dqcontrol.experiments import Column, Table
from dqcontrol.loop import close_loop
from dqcontrol.plants import Integrator

STEPS, PERIOD = 3000, 0.008
START = np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])
GAIN = 25.0  # with these weights and gains all laws decay at 25 1/s
H_INFINITY = laws.HInfinity(orientation_gain=2 * GAIN, translation_gain=GAIN)
TRACKING = laws.HInfinityTracking(orientation_gain=2 * GAIN, translation_gain=GAIN)
DUAL_QUATERNION = laws.LinearQuadraticDQ(error_weight=GAIN**2, control_weight=1.0)

LAWS = {
    "K": laws.Proportional(gain=GAIN),
    "K, gain over time": laws.Proportional(gain=laws.Schedule([0, STEPS * PERIOD], [5.0, GAIN])),
    "K+FF": laws.ProportionalFeedforward(gain=GAIN),
    "open loop": laws.OpenLoop(),
    "classic": laws.ClassicProportional(gain=GAIN),
    "decoupled": laws.DecoupledProportional(gain=GAIN),
    "position only": laws.PartialProportional(part="position", gain=GAIN),
    "HIR, right": H_INFINITY,
    "HIR, left": replace(H_INFINITY, form="left"),
    "HIRT, right": TRACKING,
    "HIRT, left": replace(TRACKING, form="left"),
    "LQR-R8": laws.LinearQuadraticR8(error_weight=GAIN**2, control_weight=1.0),
    "LQR-DQ, log": DUAL_QUATERNION,
    "LQR-DQ, sin": replace(DUAL_QUATERNION, form="sin"),
}


def table() -> Table:
    arm = dqc.load_robot("iiwa7")
    circle = dqc.references.Circle(arm.fkm(START), radius=0.07, duration=STEPS * PERIOD)
    samples, sample, out = (
        circle.samples(PERIOD * np.arange(STEPS)),
        circle.at(STEPS * PERIOD / 2),
        np.empty(7),
    )
    ready = {name: law.prepare(arm, circle, PERIOD) for name, law in LAWS.items()}

    def rollout(law: laws.PreparedLaw) -> None:
        close_loop(law, Integrator().start(arm, START, PERIOD, STEPS, 0), samples)

    steps = medians({name: partial(rollout, law) for name, law in ready.items()}, 1)
    calls = medians(
        {
            name: partial(law.command, START, sample, law.initial_state(START), out)
            for name, law in ready.items()
        },
        500,
    )
    preparations = medians({name: partial(law.prepare, arm, circle, PERIOD) for name, law in LAWS.items()}, 1)
    columns = [
        Column("Law"),
        Column("Compiled step", "ns", ".0f"),
        Column("÷ K", "", ".2f"),
        Column("Command from Python", "µs", ".2f"),
        Column("÷ K", "", ".2f"),
        Column("Preparation", "ms", ".2f"),
    ]
    rows = [
        [
            name,
            1e3 / STEPS * steps[name],
            steps[name] / steps["K"],
            calls[name],
            calls[name] / calls["K"],
            1e-3 * preparations[name],
        ]
        for name in LAWS
    ]
    return Table(columns, rows)


if __name__ == "__main__":
    print(table().markdown(), end="")
    print(
        f"7 joints, {STEPS} samples of {PERIOD:g} s, least times measured in turns, ≤ 1.3 K wanted; "
        f"dqcontrol {dqc.__version__}, Numba {numba.__version__}, NumPy {np.__version__}, "
        f"Python {platform.python_version()}, {platform.machine()}, {os.cpu_count()} cores"
    )

"""Steps of the compiled closed loop and nothing else, for callgrind, which counts their instructions.

python benchmarks/instructions.py STEPS
"""

from __future__ import annotations

import sys

import numpy as np

import dqcontrol as dqc
from dqcontrol.loop import close_loop
from dqcontrol.plants import Integrator

START, PERIOD = np.array([0, 0.6, 0, 1.6, 0, 0.6, 0]), 0.008


def main(steps: int) -> None:
    """Let law K drive an arm along a circle."""
    arm = dqc.load_robot("iiwa7")
    circle = dqc.references.Circle(arm.fkm(START), radius=0.07, duration=10_000 * PERIOD)
    law = dqc.laws.Proportional(gain=20.0, inverse=dqc.laws.DampedInverse(damping=0.01))
    samples = np.repeat(circle.samples(np.zeros(1)), steps, axis=0)
    plant = Integrator().start(arm, START, PERIOD, steps, 0)
    close_loop(law.prepare(arm, circle, PERIOD), plant, samples)


if __name__ == "__main__":
    main(int(sys.argv[1]))

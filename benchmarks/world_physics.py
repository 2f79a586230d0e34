"""A Panda with shapes among ten boxes that lie on the floor, in physics: against bare MuJoCo and real time.

The plant steps the arm, reads contacts and bodies; MuJoCo alone steps the same model as often. Processor time, medians.

Usage: python benchmarks/world_physics.py
"""

from __future__ import annotations

import time

import mujoco
import numpy as np

import dqcontrol as dqc
from dqcontrol.plants import MujocoPlant
from dqcontrol.world import Body

PERIOD, STEPS, ROUNDS = 0.01, 200, 9
HOME = np.array([0.0, -0.3, 0.0, -2.0, 0.0, 1.8, 0.7])


def main() -> None:
    """Print both ratios, while the boxes still move and once they lie."""
    arm, bodies = dqc.load_robot("panda"), {"floor": Body(plane=(0, 0, 1))}
    for k, turn in enumerate(2 * np.pi * np.arange(10) / 10):
        at = (0.9 * np.cos(turn), 0.9 * np.sin(turn), 0.06)
        bodies[f"box {k}"] = Body(box=0.1, position=at, mass=0.5)
    plant = MujocoPlant(world=dqc.World(bodies=bodies))
    live = plant.start(arm, HOME, PERIOD, STEPS, 0)
    substeps = round(PERIOD / plant.timestep)
    ours, bare = [], []
    for _ in range(ROUNDS):
        begin = time.process_time()
        for k in range(STEPS):
            live.step(np.full(7, 0.1 * np.sin(0.01 * k)))
        ours.append(time.process_time() - begin)
        begin = time.process_time()
        for _ in range(STEPS):
            mujoco.mj_step(live.model, live.data, substeps)
        bare.append(time.process_time() - begin)
    ratio = np.median(ours) / np.median(bare)
    print(f"plant against MuJoCo alone: {ratio:.2f}; {STEPS * PERIOD / np.median(ours):.0f} x real time")
    circle = dqc.references.Circle(arm.fkm(HOME), radius=0.05, duration=4.0)
    law = dqc.laws.ProportionalFeedforward(gain=5.0)
    took = []
    for _ in range(3):
        begin = time.process_time()
        dqc.simulate(arm, circle, law, plant, HOME, period=PERIOD)
        took.append(time.process_time() - begin)
    print(f"whole runs of 4 s, in which the boxes come to rest: {4.0 / min(took):.0f} x real time")


if __name__ == "__main__":
    main()

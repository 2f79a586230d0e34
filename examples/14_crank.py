"""A crank and the door of a cabinet, whose axes nobody knows: the way of the hand, and what presses it aside."""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import dqcontrol as dqc

HERE = Path(__file__).parent
CASES = {"crank": ("crank.yaml", "crank"), "door of a cabinet": ("cabinet.yaml", "door")}

figure, axes = plt.subplots(2, 2, figsize=(9, 6), layout="constrained", height_ratios=[1.3, 1])
for column, (label, (file, name)) in enumerate(CASES.items()):
    run = dqc.run(HERE / file)
    record = run.record
    print(f"{label}: {run.verdict.words.partition(';')[0]}")
    body = dqc.experiments.prepare(HERE / file).spec.world[name]
    axis = np.array(body.position)[:2] + body.hinge.at[:2]
    radial = record.position[:, :2] - axis
    radius = np.linalg.norm(radial, axis=1)
    radial /= radius[:, None]
    force = record.readings["touch_force"].values[:, :2]
    side = np.sum(force * radial, axis=1)
    along = np.sum(force * np.column_stack([-radial[:, 1], radial[:, 0]]), axis=1)
    turns = np.linspace(0, 2 * np.pi, 200)
    way, circle = (
        1e3 * record.position,
        1e3 * (axis + radius[0] * np.column_stack([np.cos(turns), np.sin(turns)])),
    )
    axes[0, column].plot(*circle.T, color="0.85", lw=5, label="what it turns on")
    axes[0, column].plot(way[:, 0], way[:, 1], label="hand")
    axes[0, column].plot(*(1e3 * axis), "k+", ms=12)
    axes[0, column].set(title=label, xlabel="x (mm)", ylabel="y (mm)", aspect="equal")
    axes[1, column].plot(record.time, side, label="aside")
    axes[1, column].plot(record.time, along, label="along")
    axes[1, column].set(xlabel="time (s)", ylabel="force on the hand (N)")
axes[0, 1].legend(loc="lower right")
axes[1, 0].legend()
figure.savefig("14_crank.png", dpi=100)

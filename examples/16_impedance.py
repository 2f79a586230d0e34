"""A torque-driven arm wipes a hard board by a plan inside of it: springs of the end effector beside position servos."""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import yaml

import dqcontrol as dqc

spec = yaml.safe_load((Path(__file__).parent / "impedance.yaml").read_text())
figure, axes = plt.subplots(2, 1, figsize=(7, 5), layout="constrained", sharex=True)
for label in ("springs", "position servos"):
    record = dqc.run(spec).record
    spec["plant"].pop("impedance", None)
    force = np.convolve(record.readings["touch_force"].values[:, 2], np.full(25, 0.04), "same")  # over 0.1 s
    wipes = (record.time > 2.5) & (record.time < 10)
    print(f"{label}: {force[wipes].min():.1f} to {force[wipes].max():.1f} N")
    axes[0].plot(record.time, 1e3 * record.position[:, 2], label=label)
    axes[1].semilogy(record.time, np.maximum(force, 0.1))
axes[0].plot(record.time, 1e3 * record.desired_position[:, 2], color="0.7", label="plan")
axes[0].set(ylabel="height (mm)")
axes[0].legend()
axes[1].set(xlabel="time (s)", ylabel="force of the board (N)", xlim=(0, 10), ylim=(1, 1000))
figure.savefig("16_impedance.png", dpi=100)

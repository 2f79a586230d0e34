"""A round tool wipes a drum whose shape nobody told it: how its height follows, and the force over the path."""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import dqcontrol as dqc

run = dqc.run(Path(__file__).parent / "wiping.yaml")
record = run.record
wipes = record.time > 2.5  # 1 s after it has touched
force = record.readings["touch_force"].values[wipes, 2]
share = 100 * np.mean(np.abs(force - 5.0) <= 1.0)
print(f"{run.verdict.words.partition(';')[0]}: within 5 ± 1 N on {share:.0f} % of the path")

planned, way = record.desired_position[wipes], record.position[wipes]
length = 1e3 * np.linalg.norm(np.diff(planned, axis=0, prepend=planned[:1]), axis=1).cumsum()
figure, axes = plt.subplots(2, 1, figsize=(7, 5), layout="constrained", sharex=True)
axes[0].plot(length, 1e3 * planned[:, 2], color="0.7", label="plan")
axes[0].plot(length, 1e3 * way[:, 2], label="hand")
axes[0].set(ylabel="height (mm)")
axes[0].legend()
axes[1].axhspan(4, 6, color="0.9")
axes[1].plot(length, force, lw=1)
axes[1].set(xlabel="path (mm)", ylabel="force (N)", ylim=(0, 8))
figure.savefig("15_wiping.png", dpi=100)

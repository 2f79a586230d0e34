"""A pen writes by 2 N on a hard board, 5 mm and 3° off: with force alone, and after three touches have found it."""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import yaml

import dqcontrol as dqc

HERE = Path(__file__).parent
spec = yaml.safe_load((HERE / "writing.yaml").read_text())
pause, script = spec["reference"]["references"]
script["file"] = str(HERE / script["file"])
touched = dqc.run(spec).record

del script["touch"]
pause["duration"] = "5 s"  # time to come down onto the board

figure, axes = plt.subplots(2, 2, figsize=(9, 5), layout="constrained", height_ratios=[1.2, 1])
runs = {"by force alone": dqc.run(spec).record, "after three touches": touched}
seconds = runs["by force alone"].duration - 5.0  # of writing
for column, (label, record) in enumerate(runs.items()):
    writes = record.time > record.duration - seconds + 0.3
    force = record.readings["touch_force"].values[:, 2]
    inked = writes & (force > 0)
    share = 100 * np.mean(np.abs(force[writes] - 2.0) <= 0.5)
    worst = 1e3 * np.linalg.norm((record.position - record.desired_position)[inked][:, :2], axis=1).max()
    print(f"{label}: within 2 ± 0.5 N on {share:.0f} % of the path, ink {worst:.1f} mm from the plan at most")
    desired, way = record.desired_position[writes], record.position.copy()
    way[~inked] = np.nan
    axes[0, column].plot(1e3 * desired[:, 0], 1e3 * desired[:, 1], color="0.8", lw=5, label="plan")
    axes[0, column].plot(1e3 * way[:, 0], 1e3 * way[:, 1], lw=1, label="ink")
    axes[0, column].set(title=label, xlabel="x (mm)", ylabel="y (mm)", aspect="equal")
    lengths = np.linalg.norm(np.diff(desired, axis=0, prepend=desired[:1]), axis=1).cumsum()
    axes[1, column].plot(1e3 * lengths, force[writes])
    axes[1, column].axhspan(1.5, 2.5, color="0.9")
    axes[1, column].set(xlabel="path (mm)", ylabel="force (N)", ylim=(-0.2, 8))
axes[0, 0].legend()
figure.savefig("12_writing.png", dpi=100)

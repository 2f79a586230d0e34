"""A pen writes by 2 N on a hard board, 5 mm and 3° off: by plan, by force, touched first, and learnt."""

from copy import deepcopy
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import yaml

import dqcontrol as dqc

HERE = Path(__file__).parent
touched = yaml.safe_load((HERE / "writing.yaml").read_text())
pause, script = touched["reference"]["references"]
script["file"] = str(HERE / script["file"])

by_force = deepcopy(touched)
pause, script = by_force["reference"]["references"]
del script["touch"]
pause["duration"] = "5 s"  # time to come down onto the board
by_plan = deepcopy(by_force)
del by_plan["contact"]
learning = dqc.learn(by_force, repeats=3, return_time=3.0)

runs = {
    "by plan": dqc.run(by_plan).record,
    "by force": learning.first,
    "after three touches": dqc.run(touched).record,
    f"by force, learnt in {learning.best}": learning.last,
}
desired = learning.first.desired_position
seconds = learning.first.duration - 5.0  # of writing
figure, axes = plt.subplots(
    2, 4, figsize=(13, 4.6), layout="constrained", height_ratios=[1, 1.2], sharey="row"
)
for column, (label, record) in enumerate(runs.items()):
    writes = record.time > record.duration - seconds + 0.3
    force = record.readings["touch_force"].values[:, 2]
    inked = writes & (force > 0)
    plan = record.desired_position if label == "after three touches" else desired[: len(record)]
    off = 1e3 * np.linalg.norm((record.position - plan)[inked][:, :2], axis=1)
    share, pressed = 100 * np.mean(np.abs(force[writes] - 2) <= 0.5), force[writes]
    said = f"{label}: {pressed.mean():.2f} ± {pressed.std():.2f} N, {share:.0f} % within 2 ± 0.5 N"
    print(f"{said}, ink {off.max(initial=0):.1f} mm off")
    way = record.position.copy()
    way[~inked] = np.nan
    axes[0, column].plot(1e3 * plan[writes, 0], 1e3 * plan[writes, 1], color="0.8", lw=5, label="plan")
    axes[0, column].plot(1e3 * way[:, 0], 1e3 * way[:, 1], lw=1, label="ink")
    axes[0, column].set(title=label, xlabel="x (mm)", aspect="equal")
    lengths = np.linalg.norm(np.diff(plan[writes], axis=0, prepend=plan[writes][:1]), axis=1).cumsum()
    axes[1, column].plot(1e3 * lengths, force[writes])
    axes[1, column].axhspan(1.5, 2.5, color="0.9")
    axes[1, column].set(xlabel="path (mm)", ylim=(-0.2, 8))
axes[0, 0].set_ylabel("y (mm)")
axes[1, 0].set_ylabel("force (N)")
axes[0, 0].legend()
figure.savefig("12_writing.png", dpi=100)

"""A peg of 20 mm goes into a hole of 20.2 mm that is 2 mm and 2° off: its way over the rim, its depth and its force."""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import dqcontrol as dqc

file = Path(__file__).parent / "peg.yaml"
run = dqc.run(file)
record, time = run.record, run.record.time
print(run.verdict.words.partition(";")[0])

socket = dqc.experiments.prepare(file).spec.world["socket"]
rim = dqc.algebra.matrix_from_pose(socket.pose)
rim = rim[:3, 3] + 0.03 * rim[:3, 2]
hand, plan = (1e3 * (each - rim) for each in (record.position, record.desired_position))
searching = (time > 5.1) & (hand[:, 2] > -3)
force = np.linalg.norm(record.readings["touch_force"].values, axis=1)

figure, (above, beside) = plt.subplots(1, 2, figsize=(9, 4), layout="constrained", width_ratios=[1, 1.3])
above.plot(*plan[searching, :2].T, color="0.8", lw=3, label="plan")
above.plot(*hand[searching, :2].T, lw=1, label="peg")
above.plot(0, 0, "k+", ms=12, label="hole")
above.set(xlabel="x (mm)", ylabel="y (mm)", title="search", aspect="equal")
above.legend()
beside.plot(time, -hand[:, 2], label="depth below the rim (mm)")
beside.plot(time, force, lw=1, label="force on the peg (N)")
beside.axhline(0, color="0.8", lw=1)
beside.set(xlabel="time (s)", title="touch, search, drop, in")
beside.legend()
figure.savefig("13_peg.png", dpi=100)

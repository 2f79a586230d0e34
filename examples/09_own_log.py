"""Your own joint log, measured: here a table of times and joint angles in degrees, as a robot's software writes it."""

import tempfile
from pathlib import Path

import numpy as np

import dqcontrol as dqc

folder = Path(tempfile.mkdtemp())
arm, q = dqc.load_robot("ur5"), np.array([0, -1.2, 1.6, -0.4, 1.6, 0])

# Stands for your log: an arm on servos that lag and sag, read at 125 Hz by encoders of 0.01°.
circle = dqc.references.Circle(arm.fkm(q), radius=0.08, duration=6.0)
law = dqc.laws.Proportional(gain=8.0)
moved = dqc.simulate(arm, circle, law, dqc.plants.Servo(sag=1, stiffness=2000), start=q, period=0.008)
table = np.column_stack([moved.time, np.rad2deg(moved.q).round(2)])
header = "time [s]," + ",".join(f"q{i + 1} [deg]" for i in range(6))
np.savetxt(folder / "log.csv", table, delimiter=",", header=header, comments="", fmt="%.3f")

# Where the hand should have been: the same mapping as in an experiment.
(folder / "circle.yaml").write_text("reference: {kind: circle, radius: 0.08, duration: 6}\n")

mine = dqc.logs.evaluate_log(folder / "log.csv", "ur5", folder / "circle.yaml", skip_initial=1)
print(
    f"RMS error {mine.metrics.position.settled_rms:.1f} mm, largest {mine.metrics.position.settled_peak:.1f} mm"
)
dqc.figures.errors(mine.record).savefig("09_own_log.png", dpi=150)

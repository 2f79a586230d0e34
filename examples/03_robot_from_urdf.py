"""Your own robot from its URDF file: what was read, a configuration for a wanted pose, and a spiral."""

from pathlib import Path

import numpy as np

import dqcontrol as dqc
from dqcontrol.robots import describe

arm = dqc.load_robot(Path(__file__).parent / "robots/six-axis.urdf", tip_link="tool")
about = describe(arm)
print(f"{about.name}: {', '.join(arm.joint_names)}; reach {about.reach:.2f} m, {about.mass:.1f} kg")

# The tool points down, 35 cm in front of the base and 25 cm above it.
wanted = dqc.algebra.pose([0, 0, 1, 0], [0.35, 0, 0.25])
solution = arm.solve(wanted, [0, 0.5, 1.5, 0, 1, 0], restarts=20, seed=1)
print("joints [°]:", np.rad2deg(solution.q).round(1))

spiral = dqc.references.Spiral(wanted, radius=0.05, length=0.05, duration=10.0, axis="z")
law = dqc.laws.ProportionalFeedforward(gain=5.0)
record = dqc.simulate(arm, spiral, law, dqc.plants.Servo(), start=solution.q, period=0.01)
print(f"RMS error {dqc.measures.evaluate(record).position.rms:.2f} mm")
dqc.figures.path_3d(record).savefig("03_robot_from_urdf.png", dpi=150)

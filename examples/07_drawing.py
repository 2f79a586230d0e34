"""A drawing file becomes a light painting: the hand's real path as a long exposure shows a lamp that it holds."""

from pathlib import Path

import numpy as np

import dqcontrol as dqc
from dqcontrol.films.light_painting import light_painting

arm, q = dqc.load_robot("panda"), np.array([0, -0.8, 0, -2.4, 0, 1.6, 0.8])
drawing = dqc.references.load_drawing(Path(__file__).parent / "drawings/flower.txt", arm.fkm(q))
print(f"{drawing.length:.2f} m of line in {drawing.duration:.0f} s")

law = dqc.laws.LinearQuadraticDQ(error_weight=100.0, control_weight=1.0)
record = dqc.simulate(arm, drawing, law, dqc.plants.Servo(), start=q, period=0.01)
light_painting(record).savefig("07_drawing.png", dpi=150)

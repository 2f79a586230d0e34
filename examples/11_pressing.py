"""Write on a board that is 5 mm and 3° off: as planned, and pressed on by 2 N. The picture shows both forces."""

import matplotlib.pyplot as plt
import numpy as np

import dqcontrol as dqc

arm, start = dqc.load_robot("iiwa7"), np.array([0, 0.6, 0, -1.6, 0, 0.9, 0])
pose = arm.fkm(start)
x, y, z = dqc.algebra.translation(pose)
board = dqc.world.Body(
    box=(0.4, 0.4, 0.04), position=(x, y, z - 0.025), rpy=(np.radians(3), 0, 0), stiffness=2000, friction=0.2
)
pen = dqc.plants.Servo(time_constant=0.04, delay=0.012, wrist=dqc.plants.Wrist(filter=0.005, force_noise=0.1))
plant = pen.in_world(dqc.World(bodies={"board": board}))
by_force = dqc.contact.Admittance(
    axes="base",
    translation=dqc.contact.Compliance(damping=100.0, stiffness=["rigid", "rigid", 0.0]),
    force=dqc.contact.WantedWrench(z=2.0),
    sensor=dqc.contact.ForceSensor(filter=0.005),
)
circle = dqc.references.Circle(pose, radius=0.04, duration=12.0, plane="xy")

figure, axes = plt.subplots(2, 1, figsize=(7, 6), layout="constrained", height_ratios=[1, 1])
for contact, label in ((None, "as planned"), (by_force, "pressed on by 2 N")):
    law = dqc.laws.ProportionalFeedforward(gain=1.0, contact=contact)
    record = dqc.simulate(arm, circle, law, plant, start, period=0.004)
    force = record.readings["touch_force"].values[:, 2]
    height = dqc.algebra.translation(record.pose)[:, 2]
    inked = 100 * np.mean(np.abs(force[record.time > 3] - 2.0) <= 0.5)
    print(f"{label}: within 2 ± 0.5 N for {inked:.0f} % of the time")
    axes[0].plot(record.time, force, label=label)
    axes[1].plot(record.time, 1e3 * height, label=label)
axes[0].axhspan(1.5, 2.5, color="0.9")
axes[0].set(ylabel="force of the board (N)")
axes[1].set(xlabel="time (s)", ylabel="height of the pen (mm)")
axes[0].legend()
figure.savefig("11_pressing.png", dpi=100)

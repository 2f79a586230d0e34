"""How much gain? The error over the gain on three plants, up to where each loop becomes unstable."""

import warnings

import matplotlib.pyplot as plt
import numpy as np

import dqcontrol as dqc

arm, q = dqc.load_robot("iiwa7"), np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])
circle = dqc.references.Circle(arm.fkm(q), radius=0.05, duration=5.0)
plants = {
    "ideal joints": dqc.plants.Integrator(),
    "servos": dqc.plants.Servo(time_constant=0.05),
    "servos, 20 ms late": dqc.plants.Servo(time_constant=0.05, delay=0.02),
}
gains = np.geomspace(1, 300, 25)  # 1/s
figure, axes = plt.subplots(figsize=(6, 4), layout="constrained")
for label, plant in plants.items():
    errors = []
    for gain in gains:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of unstable loops: they are what is looked for
            law = dqc.laws.Proportional(gain=gain)
            record = dqc.simulate(arm, circle, law, plant, start=q, period=0.01)
        errors.append(dqc.measures.evaluate(record).position.rms)
    print(f"{label}: least error {min(errors):.2f} mm at k = {gains[int(np.argmin(errors))]:.0f}/s")
    axes.loglog(gains, errors, "o-", ms=3, label=label)
axes.set(xlabel="gain k of K [1/s]", ylabel="RMS error [mm]", ylim=(0.2, 100))
axes.grid(which="both", alpha=0.3)
axes.legend()
figure.savefig("08_gain_sweep.png", dpi=150)

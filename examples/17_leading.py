"""An arm is led by hand, and goes along again through the poses in which it was let go."""

from pathlib import Path
from tempfile import TemporaryDirectory

import matplotlib.pyplot as plt
import numpy as np
import yaml

import dqcontrol as dqc

spec = yaml.safe_load((Path(__file__).parent / "leading.yaml").read_text())
led = dqc.run(spec).record
pushes = spec["plant"]["pushes"]
rests = (
    np.searchsorted(led.time, [*(each["time"] for each in pushes), led.duration]) - 1
)  # before each push, at the end

again = {"plant": {"kind": "compliant", "mode": "THETA"}, "contact": None, "name": "taught"}
with TemporaryDirectory() as folder:
    poses = dqc.algebra.translation(led.pose[rests]), led.pose[rests, :4]
    file = Path(folder) / "taught.csv"
    np.savetxt(file, np.hstack(poses), delimiter=",", header="x,y,z,qw,qx,qy,qz", comments="")
    again["reference"] = {
        "kind": "via-points",
        "file": str(file),
        "duration": "8 s",
        "jerk_limits": {"velocity": 0.1, "acceleration": 0.4, "jerk": 3},
    }
    taught = dqc.run({key: value for key, value in {**spec, **again}.items() if value is not None}).record

gap = max(np.linalg.norm(taught.position - led.position[k], axis=1).min() for k in rests)
print(
    f"led {1e3 * np.ptp(led.position, axis=0).max():.0f} mm; passes what it was taught within {1e3 * gap:.1f} mm"
)
figure, axes = plt.subplots(1, 2, figsize=(8, 4), layout="constrained", width_ratios=[1.2, 1])
for axis, name in enumerate("xyz"):
    axes[0].plot(led.time, 1e3 * (led.position - led.position[0])[:, axis], label=name)
for each in pushes:
    axes[0].axvspan(each["time"], each["time"] + each["duration"], color="0.9")
axes[0].set(xlabel="time (s), pushed where grey", ylabel="way of the end effector (mm)")
axes[0].legend()
for record, label in ((led, "led"), (taught, "taught")):
    axes[1].plot(1e3 * record.position[:, 1], 1e3 * record.position[:, 2], label=label)
axes[1].plot(*(1e3 * led.position[rests][:, 1:].T), "ko", label="let go")
axes[1].set(xlabel="y (mm)", ylabel="z (mm)", aspect="equal", ylim=(280, 480))
axes[1].legend(loc="upper left", ncols=3)
figure.savefig("17_leading.png", dpi=100)

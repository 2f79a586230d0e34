"""The same law in physics: rigid bodies under gravity, which the servos must carry. Needs the extra `physics`."""

from pathlib import Path

import dqcontrol as dqc
from dqcontrol.films.physics_picture import render_run

run = dqc.run(
    {
        "name": "physics",
        "robot": "panda",
        "start": [1.5708, -0.8, 0, -2.4, 0, 3.1708, 0.7854],  # rad; the hand points forward, along y
        "period": 0.01,  # s
        "reference": {
            "kind": "drawing",
            "file": str(Path(__file__).parent / "drawings/light-bulb.txt"),
            "offset": {"translation": [0, 0, 0.02]},  # m
        },
        "law": {"kind": "proportional-feedforward", "gain": 5},
        "plant": {"kind": "mujoco", "gravity_compensation": 0},
        "skip_initial": 2,  # s
    }
)
print(f"RMS error {run.metrics.position.settled_rms:.2f} mm")
render_run(run.robot, run.q, run.pose, run.desired, "10_physics.png", overwrite=True)

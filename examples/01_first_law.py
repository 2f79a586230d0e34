"""A preset arm follows a circle under the law K+FF, on position servos that lag: the hand's path."""

import dqcontrol as dqc

run = dqc.run(
    {
        "name": "first-law",
        "robot": "iiwa7",
        "start": [0, 0.6, 0, 1.6, 0, 0.6, 0],  # rad
        "period": 0.01,  # s
        "reference": {
            "kind": "circle",
            "radius": 0.07,  # m
            "duration": 8,  # s
            "offset": {
                "translation": [0, 0, 0.03],
                "rotation": [0, 0, 0.2],
            },  # m, rad: where the hand is not yet
        },
        "law": {"kind": "proportional-feedforward", "gain": 4},  # 1/s
        "plant": {"kind": "servo", "time_constant": 0.05},  # s
        "skip_initial": 2,  # s that the errors leave out
    }
)
print(f"RMS error {run.metrics.position.settled_rms:.2f} mm, {run.metrics.orientation.settled_rms:.3f}°")
dqc.figures.path_3d(run.record).savefig("01_first_law.png", dpi=150)

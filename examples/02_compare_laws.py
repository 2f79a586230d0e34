"""Four laws follow the same circle on the same servos: one table, and their errors over time."""

import dqcontrol as dqc

study = dqc.run_study(
    {
        "name": "four-laws",
        "robot": "iiwa7",
        "start": [0, 0.6, 0, 1.6, 0, 0.6, 0],  # rad
        "period": 0.01,  # s
        "reference": {
            "kind": "circle",
            "radius": 0.07,  # m
            "duration": 8,  # s
            "offset": {"translation": [0, 0, 0.03], "rotation": [0, 0, 0.2]},  # m, rad
        },
        "laws": {
            "K": {"kind": "proportional", "gain": 5},
            "K+FF": {"kind": "proportional-feedforward", "gain": 5},
            "HIRT": {"kind": "h-infinity-tracking", "orientation_gain": 10, "translation_gain": 5},
            "LQR-DQ": {"kind": "linear-quadratic-dq", "error_weight": 25, "control_weight": 1},  # √(q/r) = 5
        },
        "plant": {"kind": "servo", "time_constant": 0.05, "sag": 1, "stiffness": 2000},  # s, –, N·m/rad
        "skip_initial": 2,  # s
    }
)
print(study.table().markdown())
records = {label: run.record for label, run in study.runs.items()}
dqc.figures.compare_errors(records).savefig("02_compare_laws.png", dpi=150)

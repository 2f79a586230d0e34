"""The robot that tests of play drive."""

SPEC = {
    "name": "play",
    "robot": "iiwa7",
    "start": [0, 0.6, 0, -1.6, 0, 0.9, 0],
    "period": 0.01,
    "reference": {"kind": "set-point", "duration": 1.0},
    "law": {"kind": "proportional-feedforward", "gain": 5.0},
    "plant": {"kind": "servo"},
}

PRESS = {
    **SPEC,
    "period": 0.004,
    "law": {"kind": "proportional-feedforward", "gain": 1.0},
    "contact": {
        "axes": "base",
        "translation": {"damping": 100, "stiffness": ["rigid", "rigid", 0]},
        "force": {"z": 2},
        "limits": {"speed": 0.05},
    },
    "world": {"board": {"box": [0.4, 0.4, 0.04], "position": [0.55, 0, 0.284], "stiffness": 2000}},
    "plant": {"kind": "servo", "time_constant": 0.04, "delay": 0.012, "wrist": {"filter": 0.005}},
}

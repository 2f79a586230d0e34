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

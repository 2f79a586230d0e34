"""Specs that the tests of studies share: an arm with noisy encoders that takes milliseconds a trial."""

BASE = {
    "name": "noise",
    "robot": "iiwa7",
    "start": [0, 0.6, 0, 1.6, 0, 0.6, 0],
    "period": 0.01,
    "reference": {"kind": "circle", "radius": 0.05, "duration": 1},
    "laws": {
        "K": {"kind": "proportional", "gain": 10},
        "K+FF": {"kind": "proportional-feedforward", "gain": 10},
    },
    "plant": {"kind": "servo", "encoder_noise": 1e-4},
    "repeats": 3,
    "seed": 5,
}

# It turns by 3 rad with a gain that no number holds, at once or from the start of a schedule on.
FAR = {"kind": "set-point", "duration": 1, "offset": {"rotation": [0, 0, 3.0]}}
AT_ONCE = {"kind": "proportional", "gain": 1.7e308}
LATER = {"kind": "proportional", "gain": {"times": [0, 0.5, 0.51], "values": [1, 1, 1.7e308]}}


def spec(**changes):
    """Return the spec with changes; a change to None leaves a key out."""
    return {key: value for key, value in {**BASE, **changes}.items() if value is not None}

"""The kernels of usual runs, compiled before somebody waits for them: each case is a run of a few samples."""

from __future__ import annotations

import sys
from typing import Any

_ARM: dict[str, Any] = {
    "name": "ahead",
    "robot": "iiwa7",
    "start": [0, 0.6, 0, 1.6, 0, 0.6, 0],
    "period": 0.01,
    "duration": 0.05,
    "reference": {"kind": "circle", "radius": 0.02, "duration": 2.0},
    "law": {"kind": "proportional", "gain": 2.0},
    "plant": {"kind": "servo"},
}
_BASE = {
    "robot": "little-john",
    "start": [0, 0, 0, 0, -0.9, 0.9, 0.9, 0],
    "reference": {"kind": "set-point"},
    "plant": {"kind": "integrator"},
}
_WEIGHTS = {"error_weight": 100.0, "control_weight": 1.0}
_GAINS = {"orientation_gain": 2.0, "translation_gain": 2.0}
_LAWS: dict[str, dict[str, Any]] = {
    "proportional": {"gain": 2.0},
    "proportional-feedforward": {"gain": 2.0},
    "decoupled-proportional": {"gain": 2.0},
    "linear-quadratic-r8": _WEIGHTS,
    "linear-quadratic-dq": _WEIGHTS,
    "h-infinity": _GAINS,
    "h-infinity-tracking": _GAINS,
    "open-loop": {},
}
CASES: dict[str, dict[str, Any]] = {
    **{f"law {kind}": {"law": {"kind": kind, **keys}} for kind, keys in _LAWS.items()},
    "ideal joints": {"plant": {"kind": "integrator"}},
    "supervisor": {"supervisor": True},
    "constraints": {"constraints": {"self_collision": False, "zones": {}, "acceleration": 50.0}},
    "mobile base": {**_BASE, "law": {"kind": "feedback-linearization", "stiffness": 1.0, "damping": 2.0}},
}
"""What differs from a proportional law on the servos of an arm; kernels are the same for every arm."""


def case_spec(name: str) -> dict[str, Any]:
    """Return the spec of a case."""
    return {**_ARM, **CASES[name]}


def compile_ahead() -> int:
    """Run each case once, saying which on the error output, and return how many kernels are new in the cache."""
    import warnings

    from dqcontrol.compiled import kernel_cache
    from dqcontrol.experiments import run

    before = kernel_cache.state()[2]
    for number, name in enumerate(CASES, start=1):
        print(f"dqcontrol: compiling {number} of {len(CASES)}: {name} …", file=sys.stderr, flush=True)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of runs that nobody looks at
            run(case_spec(name))
    return kernel_cache.state()[2] - before

"""Specs that are exported in tests, and the tools that build what comes of them."""

import shutil
import subprocess

import pytest

SPEC = {
    "name": "circle",
    "robot": "iiwa7",
    "start": [0, 0.6283, 0, 1.5708, 0, 0.6283, 0],
    "period": 0.01,
    "duration": 3,
    "reference": {"kind": "circle", "radius": 0.07, "duration": 12, "offset": {"translation": [0, 0, 0.02]}},
    "law": {"kind": "proportional-feedforward", "gain": 4},
    "plant": {
        "kind": "servo",
        "time_constant": 0.05,
        "sag": 1,
        "stiffness": 2000,
        "encoder_resolution": 1e-5,
    },
    "supervisor": True,
}

needs_c = pytest.mark.skipif(
    not (shutil.which("cc") and shutil.which("make")), reason="needs a C compiler and make"
)


def make(folder, *targets):
    """Run make in a folder of an export, and return what it printed."""
    done = subprocess.run(
        ["make", "-C", str(folder), *targets], capture_output=True, text=True, timeout=300, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "warning" not in done.stderr
    return done.stdout


def undefined_symbols(*files):
    """Return what object files and archives ask of others."""
    done = subprocess.run(["nm", "-u", *map(str, files)], capture_output=True, text=True, check=True)
    words = [line.split() for line in done.stdout.splitlines()]
    return {parts[1] for parts in words if len(parts) == 2 and parts[0] in "Uw"}

"""Specs that are exported in tests, the tools that build what comes of them, and controllers called from Python."""

import ctypes
import os
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

HERE = Path(__file__).parent
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


def shell(*words):
    """Run a command, and return what it printed."""
    own = {
        name: value for name, value in os.environ.items() if name not in ("MAKEFLAGS", "MFLAGS", "MAKELEVEL")
    }
    done = subprocess.run(
        [*map(str, words)], capture_output=True, text=True, timeout=300, check=False, env=own
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "warning" not in done.stderr
    return done.stdout


def make(folder, *targets):
    """Run make in a folder of an export, and return what it printed."""
    return shell("make", "-C", folder, *targets)


def undefined_symbols(*files):
    """Return what object files and archives ask of others."""
    words = [line.split() for line in shell("nm", "-u", *files).splitlines()]
    return {parts[1] for parts in words if len(parts) == 2 and parts[0] in "Uw"}


class Config(ctypes.Structure):
    _fields_ = [
        ("coordinates", ctypes.c_int32),
        ("inputs", ctypes.c_int32),
        ("source", ctypes.c_int32),
        ("linear_speed", ctypes.c_double),
        ("angular_speed", ctypes.c_double),
        ("twist_timeout", ctypes.c_double),
        ("pose_timeout", ctypes.c_double),
        ("acceleration", ctypes.c_double),
    ]


class Target(ctypes.Structure):
    _fields_ = [
        ("position", ctypes.c_double * 3),
        ("rotation", ctypes.c_double * 4),
        ("linear", ctypes.c_double * 3),
        ("angular", ctypes.c_double * 3),
        ("of_hand", ctypes.c_int32),
    ]


class LibraryController:
    """A controller of an exported shared library."""

    def __init__(self, folder, source=0):
        self._library = ctypes.CDLL(str(folder / "libdqc_controller.so"))
        self._library.dqc_default_config.restype = Config
        self._memory = ctypes.create_string_buffer(1 << 20)  # zero, as the header wants it
        config = self._library.dqc_default_config()
        config.source = source
        self.status = self._library.dqc_init(self._memory, ctypes.byref(config))
        self._inputs = config.inputs

    def step(self, q, time, target=None):
        """Return the command."""
        u = np.zeros(self._inputs)
        self.status = self._library.dqc_step(
            self._memory,
            None if q is None else np.ascontiguousarray(q).ctypes.data_as(ctypes.c_void_p),
            ctypes.c_double(time),
            target and ctypes.byref(target),
            u.ctypes.data_as(ctypes.c_void_p),
        )
        return u

    def set(self, name, value):
        """Change a parameter and return the status."""
        return self._library.dqc_set(self._memory, name.encode(), ctypes.c_double(value))

    def init(self):
        """Make the same memory ready again, and return the status."""
        return self._library.dqc_init(self._memory, None)

    def stop(self):
        return self._library.dqc_stop(self._memory)

    def end(self):
        return self._library.dqc_end(self._memory)

    def reset(self):
        return self._library.dqc_reset(self._memory)

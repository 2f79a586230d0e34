"""Kernels without Numba's internals compute the same."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import dqcontrol

SCRIPT = """
import numpy as np, dqcontrol as dqc
from dqcontrol.compiled.compile import numba_used
arm, q = dqc.load_robot("iiwa7"), np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])
circle = dqc.references.Circle(arm.fkm(q), radius=0.05, duration=1.0)
law = dqc.laws.Proportional(gain=5.0, null_space=dqc.laws.Posture(gain=1.0))
record = dqc.simulate(arm, circle, law, dqc.plants.Integrator(), start=q, period=0.01)
print(numba_used.__name__, *(float(value).hex() for value in record.q[-1]))
"""


@pytest.mark.slow
def test_the_way_of_what_numba_documents_gives_the_same_motion(tmp_path):
    folder = Path(dqcontrol.__file__).parent.parent
    environment = {**os.environ, "PYTHONPATH": str(folder), "DQCONTROL_CACHE": str(tmp_path)}
    found = []
    for way, name in (("", "numba_internals"), ("plain", "numba_public")):
        done = subprocess.run(
            [sys.executable, "-c", SCRIPT],
            env={**environment, "DQCONTROL_NUMBA": way},
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        used, *values = done.stdout.split()
        assert used == f"dqcontrol.compiled.{name}"
        found.append([float.fromhex(value) for value in values])
    np.testing.assert_allclose(found[1], found[0], rtol=0, atol=1e-13)

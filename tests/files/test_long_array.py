"""Arrays of long runs: as in memory to the last bit, in files that leave nothing, of which a full disk is said."""

import errno
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.errors import Error
from dqcontrol.files import long_array as long

EXAMPLES = Path(__file__).parents[2] / "examples"
NOISY = {
    "name": "long",
    "robot": "iiwa7",
    "start": [0, 0.6, 0, 1.6, 0, 0.6, 0],
    "period": 0.01,
    "reference": {"kind": "circle", "radius": 0.07, "duration": 5},
    "law": {"kind": "proportional-feedforward", "gain": 10},
    "plant": {"kind": "servo", "encoder_noise": 1e-4},
    "disturbance": {"twist": {"kind": "constant", "value": [0, 0, 0, 0.02, 0, -0.01]}},
}


@pytest.fixture
def in_files(monkeypatch):
    """Let every array lie in a file, and be worked on in blocks of 64 rows."""
    if not hasattr(os, "posix_fallocate"):
        pytest.skip("no promise of room on the disk")
    monkeypatch.setattr(long, "_IN_MEMORY", 0)
    monkeypatch.setattr(long, "BLOCK", 64)


def measured(data):
    run = dqc.run(data)
    record = run.record
    return run.metrics.flat(), [
        record.q,
        record.command,
        record.pose,
        record.desired,
        record.error,
        record.rotation_error,
    ]


@pytest.mark.parametrize("data", [NOISY, NOISY | {"supervisor": {}}, EXAMPLES / "mobile.yaml"])
def test_a_run_in_files_equals_that_in_memory(data, request):
    metrics, arrays = measured(data)
    request.getfixturevalue("in_files")
    metrics_in_files, arrays_in_files = measured(data)
    assert metrics_in_files == metrics
    for array, other in zip(arrays_in_files, arrays, strict=True):
        assert np.array_equal(array, other)


@pytest.mark.usefixtures("in_files")
def test_files_of_arrays_leave_nothing(tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    array = long.long_array(1000, 3)
    array[:] = 1.0
    assert array.sum() == 3000
    assert array.flags.writeable
    assert not list(tmp_path.iterdir())


@pytest.mark.usefixtures("in_files")
def test_a_full_disk_is_said(monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "posix_fallocate", full)
    with pytest.raises(
        Error, match=r"no room for 0\.0017 GB of samples \(No space left on device\); set TMPDIR"
    ):
        dqc.run(NOISY | {"period": 5e-4})


LONG = """
import resource, sys, dqcontrol as dqc
dqc.run_study({**%r, "duration": 3.0})  # what is compiled is no part of it
resource.setrlimit(resource.RLIMIT_DATA, (%d << 20,) * 2)
study = dqc.run_study({**%r, "duration": 5e3, "period": 5e-3, "record": "metrics"})
print(study.rows[0]["samples"])
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="the limit counts memory of processes as Linux does")
def test_a_million_steps_need_little_memory():
    data = {key: value for key, value in NOISY.items() if key != "disturbance"}
    done = subprocess.run([sys.executable, "-c", LONG % (data, 600, data)], capture_output=True, text=True)
    assert done.stdout.split() == ["1000001"], done.stderr

"""What `dqcontrol doctor` finds here, and where something is missing."""

import os
import subprocess
import sys
from importlib import metadata
from pathlib import Path

import numpy
import pytest

import dqcontrol
from dqcontrol.cli import doctor_command


def found(what):
    (finding,) = [one for one in doctor_command.examine() if one.what == what]
    return finding


def doctor(folder, cache, *options):
    """Run the command in a process of its own, and return its exit code and its table, cells joined by spaces."""
    done = subprocess.run(
        [sys.executable, "-m", "dqcontrol", "doctor", *options],
        cwd=folder,
        env={
            **os.environ,
            "PYTHONPATH": str(Path(dqcontrol.__file__).parents[1]),
            "DQCONTROL_CACHE": cache,
            "COLUMNS": "200",  # for a table, not lines of words
        },
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stderr == ""
    return done.returncode, " ".join(done.stdout.replace("│", " ").split())


@pytest.mark.slow
def test_this_environment_is_fit(tmp_path):
    code, table = doctor(tmp_path, "cache", "--all")
    assert code == 0
    assert f"numpy {numpy.__version__} ok" in table
    assert "empty; the first runs compile, once ok" in table
    assert table.endswith("no problems")
    for extra in ("physics", "robots", "data"):
        assert f"extra [{extra}]" in table


@pytest.mark.slow
def test_a_cache_that_cannot_be_written_is_a_problem(tmp_path):
    (tmp_path / "file").write_text("no folder")
    code, table = doctor(tmp_path, "file")
    assert code == 1
    assert "cannot be written problem set DQCONTROL_CACHE to a writable folder" in table
    assert "1 problem; " in table
    assert "numpy" not in table  # what is well


@pytest.mark.slow
def test_a_missing_extra_is_named_with_its_cure(monkeypatch):
    version = metadata.version

    def without_mujoco(name):
        if name == "mujoco":
            raise metadata.PackageNotFoundError(name)
        return version(name)

    monkeypatch.setattr(doctor_command.metadata, "version", without_mujoco)
    finding = found("extra [physics]")
    assert (finding.found, finding.verdict) == ("mujoco not installed", doctor_command.MISSING)
    assert finding.cure == "pip install 'dqcontrol[physics]'"


@pytest.mark.slow
def test_a_package_that_is_too_old_is_a_problem(monkeypatch):
    version = metadata.version
    monkeypatch.setattr(
        doctor_command.metadata, "version", lambda name: "1.9" if name == "numpy" else version(name)
    )
    finding = found("numpy")
    assert (finding.found, finding.verdict) == ("1.9, not >=2.2", doctor_command.PROBLEM)
    assert finding.cure == "pip install 'numpy>=2.2'"


@pytest.mark.slow
def test_a_back_end_that_is_none(monkeypatch):
    pytest.importorskip("mujoco")
    monkeypatch.setenv("MUJOCO_GL", "eggl")
    finding = found("OpenGL for pictures of physics")
    assert finding.verdict == doctor_command.MISSING
    assert "did you mean 'egl'" in finding.found


def test_ros_2_that_is_not_there(monkeypatch):
    monkeypatch.setitem(sys.modules, "rclpy", None)
    finding = found("ROS 2")
    assert finding.verdict == doctor_command.MISSING
    assert "pip install 'dqcontrol[ros2]'" in finding.cure

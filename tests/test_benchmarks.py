"""The benchmarks run and agree with their peers; how fast they are is not judged here."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[1] / "benchmarks"
SHOW = "import {module}, measure; print(measure.table({module}.ratios(short=True), '').markdown())"


def shown(module):
    done = subprocess.run(
        [sys.executable, "-c", SHOW.format(module=module)],
        cwd=FOLDER,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_each_program_that_is_named_is_there():
    root = FOLDER.parent
    for page in (
        root / "Makefile",
        root / "README.md",
        root / "CONTRIBUTING.md",
        *(root / "docs").glob("*.md"),
    ):
        for program in re.findall(
            r"\b(?:benchmarks|tools|examples)/\w+\.(?:py|yaml)\b", page.read_text(encoding="utf-8")
        ):
            assert (root / program).exists(), f"{page.name}: {program}"


@pytest.mark.slow
def test_one_configuration_against_its_peers():
    table = shown("kinematics")
    assert table.count("DQ Robotics") == 8
    assert "MuJoCo" in table


@pytest.mark.slow
@pytest.mark.parametrize(
    "module",
    [
        "commands",
        "rollout",
        "batches",
        "sizes",
        "starting",
        "quadratic_programs",
        "export",
        "recording",
        "figures",
    ],
)
def test_the_other_benchmarks(module):
    assert "ratio" in shown(module)

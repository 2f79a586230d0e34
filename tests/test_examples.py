"""The numbered examples: short, they run, and each leaves its picture, that of the documentation."""

import runpy
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

ROOT = Path(__file__).parents[1]
EXAMPLES = sorted((ROOT / "examples").glob("[0-9][0-9]_*.py"))
GALLERY = ROOT / "docs/pictures/examples"
LONG = ("10_physics", "13_peg", "14_crank", "15_wiping", "16_impedance", "17_leading")
PHYSICS = LONG
CASES = [
    pytest.param(path, id=path.stem, marks=[pytest.mark.slow] if path.stem in LONG else [])
    for path in EXAMPLES
]


@pytest.mark.parametrize("path", CASES)
def test_example_runs_and_leaves_a_picture(path, tmp_path, monkeypatch, capsys):
    if path.stem in PHYSICS:
        pytest.importorskip("mujoco")
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(path), run_name="__main__")
    assert capsys.readouterr().out.strip()
    (picture,) = tmp_path.iterdir()
    assert picture.name == f"{path.stem}.png"
    assert picture.stat().st_size > 10_000
    assert differing(picture, GALLERY / picture.name) < 0.01, "an old picture in the gallery: make gallery"


def differing(one, other):
    """Return the share of two pictures that differs plainly, whatever the rendering of edges and letters."""
    first, second = (Image.open(path).convert("L") for path in (one, other))
    if first.size != second.size:
        return 1.0
    first, second = (np.asarray(picture.reduce(4), dtype=int) for picture in (first, second))
    return (np.abs(first - second) > 40).mean()


def test_they_are_numbered_without_a_gap_and_short():
    assert [int(path.stem[:2]) for path in EXAMPLES] == list(range(1, len(EXAMPLES) + 1))
    for path in EXAMPLES:
        assert len(path.read_text().splitlines()) < 60, path

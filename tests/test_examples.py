"""The numbered examples: short, they run, and each leaves its picture."""

import runpy
from pathlib import Path

import pytest

EXAMPLES = sorted((Path(__file__).parents[1] / "examples").glob("[0-9][0-9]_*.py"))
LONG = ("10_physics",)
PHYSICS = ("10_physics",)
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


def test_they_are_numbered_without_a_gap_and_short():
    assert [int(path.stem[:2]) for path in EXAMPLES] == list(range(1, len(EXAMPLES) + 1))
    for path in EXAMPLES:
        assert len(path.read_text().splitlines()) < 60, path

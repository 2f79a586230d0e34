"""An SVG file as the reference of a spec: its outlines in one go, at the size and speed that the spec says."""

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.errors import Error
from dqcontrol.experiments.spec import read_spec

pytest.importorskip("svgelements")

TWO = """<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 100 100">
<path d="M10 10 H50 V50 Z" fill="none" stroke="black"/><path d="M60 50 H90" stroke="black"/></svg>"""
HAND = dqc.algebra.pose([1, 0, 0, 0], [0.4, 0.1, 0.3])


def reference(folder, **keys):
    (folder / "two.svg").write_text(TWO)
    spec, _ = read_spec(
        {
            "name": "drawn",
            "robot": "iiwa7",
            "start": [0.0] * 7,
            "period": "125 Hz",
            "reference": {"kind": "drawing", "file": str(folder / "two.svg"), **keys},
            "law": {"kind": "proportional", "gain": 4},
            "plant": {"kind": "integrator"},
        }
    )
    assert spec.period == 0.008
    return spec.reference.build(HAND, folder, "reference")


def test_outlines_are_drawn_one_after_the_other_from_the_hand_on(tmp_path):
    """The first is a triangle with sides of 0.4, 0.4 and 0.4 √2 of the width, the second a line of 0.3."""
    drawn = reference(tmp_path, width=0.16, speed=0.05)
    scale = 0.16 / 80  # the outlines reach from 10 to 90
    side = 40 * scale
    gap = scale * np.hypot(60 - 10, 50 - 10)
    length = 2 * side + np.sqrt(2) * side + gap + 30 * scale
    assert drawn.duration == pytest.approx(length / 0.05, rel=1e-12)
    places = dqc.algebra.translation(
        drawn.samples(np.array([0, side / 0.05, 2 * side / 0.05, drawn.duration]))[:, :8]
    )
    expected = [
        [0, 0],
        [side, 0],
        [side, -side],
        [80 * scale, -40 * scale],
    ]  # right, up: y of the file is down
    np.testing.assert_allclose(places[:, [0, 2]], np.array([0.4, 0.3]) + expected, atol=1e-12)
    assert np.ptp(places[:, 1]) < 1e-12
    wide = reference(tmp_path)
    assert wide.duration == pytest.approx(length / 0.16 * 0.2 / 0.1, rel=1e-12)


def test_size_and_speed_are_not_for_drawing_files(tmp_path):
    (tmp_path / "line.txt").write_text("speed 0.1\nline 0.1 0\n")
    with pytest.raises(Error, match=r"width: is for SVG files; .*line\.txt says it itself"):
        reference(tmp_path, file=str(tmp_path / "line.txt"), width=0.1)

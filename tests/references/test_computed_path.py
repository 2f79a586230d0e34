"""Paths that are computed period by period agree with the samples that NumPy makes of all at once."""

import numpy as np
import pytest

from dqcontrol import algebra
from dqcontrol.references import Circle, CornerStops, SetPoint, Spiral, Square, StartRamp
from dqcontrol.references.computed_path import computed_path, path_parameters
from dqcontrol.references.modifiers import Transformed

START = algebra.pose(algebra.rotation_from_axis_angle([1, 2, 3], 0.7), [0.4, -0.1, 0.5])
TURN = algebra.pose(algebra.rotation_from_axis_angle([0, 1, 0], 0.4), [0.1, 0.2, -0.3])
SQUARE = Square(START, side=0.1, duration=8.0)
PATHS = {
    "circle": Circle(START, radius=0.07, duration=6.0, plane="yz", turns=1.5),
    "spiral": Spiral(START, radius=0.07, length=0.07, axis=[1, 2, 0], duration=6.0),
    "square": SQUARE,
    "ramp": StartRamp(SQUARE, seconds=1.0),
    "corner stops": CornerStops(SQUARE, seconds=0.5),
    "displaced": Transformed(StartRamp(SQUARE, seconds=1.0), by=TURN),
}


@pytest.mark.parametrize("name", PATHS)
def test_a_computed_path_is_that_of_its_samples(name):
    reference = PATHS[name]
    times = np.concatenate([np.linspace(0.0, reference.duration + 0.1, 301), reference.corners])
    parameters, row = path_parameters(reference), np.zeros(21)
    rows = []
    for time in times:
        computed_path(parameters, time, row)
        rows.append(row.copy())
    np.testing.assert_allclose(np.array(rows), reference.samples(times), atol=1e-12)


def test_other_references_are_not_computed():
    assert path_parameters(SetPoint(START)) is None

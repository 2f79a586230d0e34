"""Sampling at many times: blocks change nothing, and repeats cost nothing."""

import numpy as np
import pytest

from dqcontrol import references
from dqcontrol.references.reference import Reference

START = np.array([1.0, 0, 0, 0, 0, 0.2, 0, 0.3])


class Counted(Reference):
    """A reference that counts how often it is asked, and for how many times."""

    def __init__(self, inner):
        self.inner, self.duration, self.corners = inner, inner.duration, inner.corners
        self.calls = self.rows = 0

    def motion(self, times):
        self.calls += 1
        self.rows += len(times)
        return self.inner.motion(times)


def circle():
    return references.Circle(START, radius=0.1, duration=2.0, turns=1.5)


def square():
    return references.Square(START, side=0.1, duration=4.0)


REFERENCES = {
    "circle": circle,
    "drawing": lambda: references.Drawing(
        START,
        [references.StraightStroke(0.1, 0, 0.1), references.Arc(0, 0, 0.05, 0, False, 0.1)],
        orientation="path",
        repeat=3,
    ),
    "sequence": lambda: references.Sequence([references.SetPoint(START, duration=1.0), square(), square()]),
    "repeat": lambda: references.Repeat(square(), 7),
    "nested": lambda: references.Repeat(references.Repeat(references.CornerStops(square(), 0.3), 3), 2),
    "transformed": lambda: references.Transformed(square(), by=[1, 0, 0, 0, 0, 0, 0, 0.5]),
    "jerk-limited": lambda: references.JerkLimited(
        references.Repeat(square(), 3), velocity=0.1, acceleration=0.5, jerk=5.0
    ),
}


@pytest.mark.parametrize("name", REFERENCES)
def test_many_times_in_any_order_give_what_each_gives_alone(name):
    reference = REFERENCES[name]()
    rng = np.random.default_rng(4)
    times = np.concatenate([np.linspace(0, 1.1 * reference.duration, 9000), reference.corners])
    rng.shuffle(times)
    samples = reference.samples(times)
    for k in rng.choice(len(times), 40, replace=False):
        np.testing.assert_array_equal(samples[k], reference.at(times[k]).data)


@pytest.mark.parametrize("count", [10, 1000])
def test_a_repeat_asks_its_reference_once_for_all_rounds(count):
    inner = Counted(square())
    repeat = references.Repeat(inner, count)
    assert inner.calls == 2  # for its start and its end
    inner.calls = inner.rows = 0
    times = np.linspace(0, repeat.duration, 20_000)
    samples = repeat.samples(times)
    assert (inner.calls, inner.rows) == (5, 20_000)  # blocks, and no time twice
    inside = (times > 0) & (times < repeat.duration)
    once = inner.samples(np.mod(times[inside], inner.duration))
    np.testing.assert_allclose(samples[inside, :8], once[:, :8], atol=1e-9)

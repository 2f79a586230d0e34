"""The histogram of a loop's time."""

import numpy as np
import pytest

from dqcontrol.errors import ShapeError
from dqcontrol.figures import timing_histogram, timing_table
from dqcontrol.loop import Timing

print("seed 3")
RNG = np.random.default_rng(3)


def made(steps):
    begin = 0.008 * np.arange(steps) + RNG.uniform(0, 1e-4, steps)
    return Timing(0.008, begin, RNG.uniform(2e-4, 3e-4, steps), np.full(steps, 0.007), np.arange(steps) == 5)


@pytest.mark.slow
def test_all_steps_are_counted_and_the_overruns_told(tmp_path):
    figure = timing_histogram(made(500))
    counts = [sum(bar.get_height() for bar in axes.patches) for axes in figure.axes]
    assert counts == [499, 500, 499]
    assert figure.get_suptitle() == "T = 8 ms, 500 steps, 1 overruns"
    figure.savefig(tmp_path / "timing.png")


def test_one_step_has_no_period():
    with pytest.raises(ShapeError, match="timing: needs at least two steps, got 1"):
        timing_histogram(made(1))


def test_the_table_counts_late_steps_and_missed_periods():
    begin = np.delete(0.008 * np.arange(100), [40, 41, 70])
    late = np.diff(begin, prepend=-0.008) > 0.009
    timing = Timing(0.008, begin, np.full(97, 2e-4), np.full(97, 0.007), late)
    assert (timing.overruns, timing.missed) == (2, 3)
    table = timing_table(timing)
    assert table.title == "97 steps of 8 ms: 2 began late, 3 periods missed"
    assert table.texts()[0] == ["period", "8", "16.4", "24"]
    assert table.texts()[1] == ["computation", "0.2", "0.2", "0.2"]
    assert made(500).missed == 0

"""The filter behind speeds and accelerations of logs, at the edge of what it filters at all."""

import numpy as np
import pytest

from dqcontrol.measures.metrics import low_passed

PERIOD = 0.01  # s: the Nyquist frequency is 50 Hz


@pytest.mark.parametrize(("cutoff", "is_filtered"), [(44.9, True), (45.1, False)])
def test_a_cutoff_near_the_nyquist_frequency_leaves_what_there_is(cutoff, is_filtered):
    values = np.random.default_rng(3).standard_normal((200, 2))
    found = low_passed(PERIOD * np.arange(200), values, cutoff)
    assert (np.abs(found - values).max() > 1e-3) == is_filtered


@pytest.mark.parametrize(("cutoff", "is_filtered"), [(44.9, True), (45.1, False)])
def test_gaps_are_joined_by_ten_points_a_sample_at_most(cutoff, is_filtered):
    """2000 points, each 10 ms, of 200 samples at 1 ms and a gap."""
    time = 1e-3 * np.arange(200)
    time[-1] = time[0] + 20.0
    values = np.random.default_rng(3).standard_normal((200, 1))
    assert (np.abs(low_passed(time, values, cutoff) - values).max() > 1e-3) == is_filtered

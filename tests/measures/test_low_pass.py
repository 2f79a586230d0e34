"""The filter behind speeds and accelerations of logs, at the edge of what it filters at all."""

from dataclasses import replace

import numpy as np
import pytest
from test_numbers_of_a_run import make_run

from dqcontrol import algebra
from dqcontrol.measures.metrics import evaluate, low_passed

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


def test_motion_is_that_of_the_smooth_run_and_all_else_is_as_it_was():
    """Joint steps and path, speed and acceleration; errors, commands and effort are not smoothed."""
    run = make_run(400)
    run = replace(run, time=PERIOD * np.arange(400))
    smooth = replace(
        run,
        q=low_passed(run.time, run.q, 5.0),
        pose=algebra.pose(run.pose[:, :4], low_passed(run.time, run.position, 5.0)),
    )
    given, found, other = evaluate(run).flat(), evaluate(run, low_pass=5.0).flat(), evaluate(smooth).flat()
    moves = "joint_path_length", "joint_step", "hand_speed", "hand_acceleration"
    for name, value in found.items():
        expected = (other if name.split(".")[0] in moves else given)[name]
        assert value == (pytest.approx(expected, rel=1e-12) if isinstance(expected, float) else expected), (
            name
        )
    assert found["joint_path_length"] < 0.2 * given["joint_path_length"]


@pytest.mark.parametrize(("share", "left"), [(0.5, 16 / 17), (1.0, 1 / 2), (2.0, 1 / 17)])
def test_a_sine_leaves_as_of_a_filter_of_second_order_there_and_back(share, left):
    """|H|² = 1/(1 + (f/f_c)⁴), without a shift, far below the Nyquist frequency."""
    time = 1e-3 * np.arange(8000)
    sine = np.sin(2 * np.pi * 5.0 * share * time)[:, None]
    inside = slice(2000, 6000)
    assert low_passed(time, sine, 5.0)[inside] == pytest.approx(left * sine[inside], abs=2e-3)

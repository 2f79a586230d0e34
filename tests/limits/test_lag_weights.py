"""Delayed targets that reach a joint within a period, against its differential equation."""

import math

import pytest
from scipy.integrate import solve_ivp

from dqcontrol.limits.compensation import lag_weights


@pytest.mark.parametrize("lag", [0.004, 0.05])
@pytest.mark.parametrize("share", [0.2, 0.7, 1.0])
def test_weights_are_those_of_the_lag_s_solution(share, lag):
    """τ ẋ = older − x for the first share of the period, then newer − x."""
    older, newer, start, period = 0.3, -0.4, 0.1, 0.01
    x = [start]
    for target, seconds in ((older, share * period), (newer, (1 - share) * period)):
        if seconds:
            path = solve_ivp(
                lambda _, x, target=target: (target - x) / lag, (0, seconds), x, rtol=1e-11, atol=1e-13
            )
            x = path.y[:, -1]
    oldest, decay = lag_weights(share, lag, period)
    goal = oldest * older + (1 - oldest) * newer
    assert goal + decay * (start - goal) == pytest.approx(x[0], abs=1e-9)
    assert decay == pytest.approx(math.exp(-period / lag))


def test_joints_without_lag_are_where_their_newest_target_is():
    assert lag_weights(0.5, 0.0, 0.01) == (0.0, 0.0)
    assert lag_weights(1.0, 0.0, 0.01) == (1.0, 0.0)

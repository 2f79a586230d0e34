"""How steeply limits repel, against the formula and its end near a limit."""

import math

import pytest

from dqcontrol.limits.position_limit import repulsion


def formula(q, lower, upper):
    return (upper - lower) ** 2 * (2 * q - upper - lower) / (4 * (upper - q) ** 2 * (q - lower) ** 2)


@pytest.mark.parametrize("share", [0.5, 0.9, 0.3, 1.1e-5, 1 - 1.1e-5])
def test_it_is_the_gradient(share):
    assert repulsion(-1.0 + 4.0 * share, -1.0, 3.0) == pytest.approx(formula(-1.0 + 4.0 * share, -1.0, 3.0))


@pytest.mark.parametrize("share", [0.9e-5, 0.0, -0.1])
def test_nearer_than_a_hundred_thousandth_of_the_range_it_grows_no_more(share):
    at_most = formula(-1.0 + 4.0 * 1e-5, -1.0, 3.0)
    assert repulsion(-1.0 + 4.0 * share, -1.0, 3.0) == pytest.approx(at_most, rel=0.3 if share < 0 else 2e-5)
    assert repulsion(3.0 - 4.0 * share, -1.0, 3.0) == pytest.approx(-at_most, rel=0.3 if share < 0 else 2e-5)


def test_without_limits_nothing_repels():
    assert repulsion(1.0, -math.inf, math.inf) == 0.0

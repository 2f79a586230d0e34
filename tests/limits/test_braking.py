"""Rates from which joints stop in time: what is surely slow enough."""

from fractions import Fraction

import numpy as np
import pytest

from dqcontrol.limits.rates import braked, braking_share, fastest_stoppable, largest_share, surely_stops

SEED = 20261128


def test_what_surely_stops_does():
    rng, sure = np.random.default_rng(20261122), 0
    for _ in range(20_000):
        period, acceleration, rate = 10 ** rng.uniform([-9, -3, -6], [-1, 5, 3])
        room = rate * (rate / (2 * acceleration) + period) * 10 ** rng.uniform(-0.1, 0.1)
        if surely_stops(room, rate, acceleration, period):
            assert fastest_stoppable(room, acceleration, period) >= rate
            sure += 1
    assert sure > 5_000


def test_nothing_is_sure_without_numbers_to_say_it():
    for room, rate, acceleration in (
        (-1.0, 0.1, 1.0),
        (np.nan, 0.1, 1.0),
        (1.0, np.inf, 1.0),
        (1.0, 0.1, np.inf),
        (1.0, 0.1, 0.0),
    ):
        assert not surely_stops(room, rate, acceleration, 0.01)


def test_it_is_sure_from_a_hundredth_of_the_room_on():
    needed = 0.5 * (0.5 + 2 * 2.0 * 0.01) / (2 * 2.0)
    assert surely_stops(1.0101 * needed, 0.5, 2.0, 0.01)
    assert not surely_stops(1.0099 * needed, 0.5, 2.0, 0.01)


def test_the_fastest_rate_brakes_to_rest_just_at_the_end_of_the_room():
    """Step by step in fractions: each period aT slower; from 1e-12 faster the way is longer than the room."""
    rng = np.random.default_rng(SEED)
    for _ in range(300):
        room, acceleration, period = 10 ** rng.uniform([-4, -1, -3], [1, 2, -1])
        rate = fastest_stoppable(room, acceleration, period)
        step = Fraction(acceleration) * Fraction(period)
        for share, is_within in ((1 - 1e-12, True), (1 + 1e-12, False)):
            way, left = Fraction(0), Fraction(rate) * Fraction(share)
            while left > 0:
                way, left = way + left * Fraction(period), left - step
            assert (way <= room) is is_within, (SEED, room, acceleration, period)


def test_there_is_no_room_without_distance_or_acceleration_and_all_at_once_with_infinite_ones():
    for distance, acceleration in ((0.0, 1.0), (-0.5, 1.0), (1.0, 0.0), (1.0, -0.5)):
        assert fastest_stoppable(distance, acceleration, 0.01) == 0.0
    assert fastest_stoppable(0.02, np.inf, 0.01) == 2.0
    assert fastest_stoppable(np.inf, 1.0, 0.01) == np.inf
    assert fastest_stoppable(1e-25, 1.0, 0.01) == 1e-23  # far less than a step: all of it in one period


@pytest.mark.parametrize(("ratio", "least", "most"), [(0.9e12, -1e-9, 1e-9), (1.1e12, 1e-7, 4e-6)])
def test_beyond_ten_to_the_twelve_periods_squared_the_formula_without_sampling_stays_below(
    ratio, least, most
):
    """Exactly, in fractions: the way of braking from the rate, and the room that it leaves."""
    room, period = Fraction(1), Fraction(float((1 / ratio) ** 0.5))
    rate = Fraction(fastest_stoppable(1.0, 1.0, float(period)))
    count = -(-rate // period)
    way = period * (count * rate - period * count * (count - 1) / 2)
    assert least <= 1 - way / room <= most


@pytest.mark.parametrize(
    ("least", "asked"),
    [
        (0.1, [1.0, 0.5, 0.25, 0.125, 0.0625, 0.0]),
        (0.125, [1.0, 0.5, 0.25, 0.125, 0.0]),
        (0.2, [1.0, 0.5, 0.25, 0.125, 0.0]),
    ],
)
def test_shares_are_halved_down_to_the_first_below_the_least(least, asked):
    seen = []
    assert largest_share(lambda parts, share: seen.append(share), None, least)[0] == 0.0
    assert seen == asked
    for kept in asked:
        assert largest_share(lambda parts, share, kept=kept: share <= kept, None, least) == (kept, True)


@pytest.mark.parametrize(("rate", "after"), [(0.5, 0.3), (-0.5, -0.3), (0.2, 0.0), (-0.1, 0.0), (0.0, 0.0)])
def test_a_period_of_braking(rate, after):
    assert braked(rate, 0.2) == pytest.approx(after)
    assert rate * (1 - braking_share(rate, 0.2)) == pytest.approx(after)

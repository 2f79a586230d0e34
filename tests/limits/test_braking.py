"""Rates from which joints stop in time: what is surely slow enough."""

import numpy as np

from dqcontrol.limits.braking import fastest_stoppable, surely_stops


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

"""Sampling times measured by a clock whose time the tests make pass."""

import numpy as np
import pytest

from dqcontrol.errors import Error, ValueRangeError
from dqcontrol.loop import Clock, Timing
from dqcontrol_theses.pereira2016.sampling_time import SamplingTime, sampling_table, sampling_times

SPEC = {
    "name": "pace",
    "robot": "iiwa7",
    "start": [0, 0.6, 0, 1.6, 0, 0.6, 0],
    "period": 0.01,
    "reference": {"kind": "circle", "radius": 0.05, "duration": 1},
    "laws": {
        "K": {"kind": "proportional", "gain": 10},
        "LQR-DQ": {"kind": "linear-quadratic-dq", "error_weight": 100, "control_weight": 1},
    },
    "plant": {"kind": "servo"},
}


class MadeTime:
    """A time that passes by a microsecond a look and as long as sleepers say."""

    def __init__(self):
        self.seconds = 0.0

    def now(self):
        self.seconds += 1e-6
        return self.seconds

    def sleep(self, seconds):
        self.seconds += seconds


@pytest.mark.slow
def test_every_law_at_every_period():
    time, told = MadeTime(), []
    rows = sampling_times(
        SPEC,
        [0.008, 0.02],
        150,
        clock=Clock(time.now, time.sleep),
        progress=lambda done, total: told.append((done, total)),
    )
    assert [row.label for row in rows] == ["K · servo", "LQR-DQ · servo"] * 2
    assert [row.timing.period for row in rows] == [0.008, 0.008, 0.02, 0.02]
    for row in rows:
        assert len(row.timing.begin) == 150
        assert row.mean == pytest.approx(row.timing.period, abs=1e-6)
        assert row.deviation < 1e-5
        assert row.tail < 1e-5
        assert 0 < row.computation < 1e-5
        assert row.timing.overruns == 0
    assert time.seconds == pytest.approx(2 * 149 * 0.028, rel=0.01), "and no longer"
    assert told[0] == (1 / 3, 4)
    assert told[-1] == (4, 4)
    assert np.all(np.diff([done for done, _ in told]) > 0)


def test_numbers_of_a_row():
    begin = np.array([0.0, 0.010, 0.021, 0.030, 0.040])
    row = SamplingTime("K", Timing(0.01, begin, np.full(5, 2e-4), np.zeros(5), begin == 0.021))
    assert row.mean == pytest.approx(0.01)
    assert row.deviation == pytest.approx(np.sqrt(2e-6 / 3))
    assert row.tail == pytest.approx(0.001)
    assert row.computation == pytest.approx(2e-4)
    assert sampling_table([row]).texts() == [
        ["K", "10", "10.0000", "0.8165", "1.0000", "0.2000", "1"],
    ]


@pytest.mark.parametrize(
    ("changes", "periods", "samples", "text"),
    [
        ({}, [0.0], 10, r"^periods: must be > 0, got 0$"),
        ({}, [0.01], 2, r"^samples: must be at least 3, got 2$"),
        ({}, [0.01], -1, r"^samples: expected an integer ≥ 0, got -1$"),
    ],
    ids=["period", "few", "negative"],
)
def test_bad_input(changes, periods, samples, text):
    with pytest.raises((ValueRangeError, Error), match=text):
        sampling_times(SPEC | changes, periods, samples)

"""Where a hand was held, and how long it takes back after a contact: from numbers alone."""

from types import SimpleNamespace

import numpy as np
import pytest

from dqcontrol.loop.constraint_signals import EFFECT, PRESSURE
from dqcontrol.measures.held import Deadlock, deadlocks
from dqcontrol.measures.metrics import recovery_time
from dqcontrol.plants.mujoco.world_model import FORCE


class Numbers(SimpleNamespace):
    """Of a record what is asked for."""

    def __len__(self):
        return len(self.time)


def held(asked=1.0, speed=0.0, rows=1.0, count=41, pressures=(1.0, 0.5)):
    """Return a record of 10 ms a sample that is free, then so held, then free."""
    effect = np.tile([0, 0, 0, 0, 1.0, 1.0], (60, 1))
    effect[5 : 5 + count, [0, 4, 5]] = rows, asked, speed
    pressure = SimpleNamespace(values=np.tile(pressures, (60, 1)), parts=("wall", "joint_2"))
    return SimpleNamespace(
        time=0.01 * np.arange(60), readings={EFFECT: SimpleNamespace(values=effect), PRESSURE: pressure}
    )


@pytest.mark.parametrize(
    ("given", "is_held"),
    [
        ({}, True),
        ({"count": 40}, False),
        ({"speed": 0.099}, True),
        ({"speed": 0.101}, False),
        ({"asked": 1.1e-3}, True),
        ({"asked": 0.9e-3}, False),
        ({"rows": 0.0}, False),
    ],
    ids=str,
)
def test_held_is_slower_than_a_tenth_of_what_is_asked_for_two_fifths_of_a_second(given, is_held):
    assert bool(deadlocks(held(**given))) == is_held


@pytest.mark.parametrize(
    ("pressures", "names"),
    [
        ((1.0, 0.11), ("wall", "joint_2")),
        ((1.0, 0.09), ("wall",)),
        ((0.5, 1.0), ("joint_2", "wall")),
        ((0.0, 0.0), ("joint limits",)),
    ],
)
def test_names_count_from_a_tenth_of_the_hardest_on(pressures, names):
    assert deadlocks(held(pressures=pressures)) == [Deadlock(pytest.approx(0.05), pytest.approx(0.45), names)]


@pytest.mark.parametrize(("left", "time"), [(1.9e-3, 0.03), (2.1e-3, 0.06)])
def test_it_is_back_within_two_millimetres_of_before_the_contact(left, time):
    force = np.zeros((20, 2))
    force[5:8, 1] = 3.0
    error = np.full(20, 0.01)
    error[5:10], error[10:13] = 0.05, 0.01 + left
    record = Numbers(
        time=0.01 * np.arange(20), readings={FORCE: SimpleNamespace(values=force)}, position_error=error
    )
    assert recovery_time(record) == pytest.approx(time)

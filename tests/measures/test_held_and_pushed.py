"""Where a hand was held, and how long it takes back after a contact: from numbers alone."""

from types import SimpleNamespace

import numpy as np
import pytest

from dqcontrol.loop.replanning import PLAN
from dqcontrol.loop.signals import EFFECT, PRESSURE
from dqcontrol.measures.held import Deadlock, apart_at_plans, deadlocks, plans_of_run
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
        ((0.001, 0.0002), ("wall", "joint_2")),
    ],
)
def test_names_count_from_a_tenth_of_the_hardest_on(pressures, names):
    assert deadlocks(held(pressures=pressures)) == [Deadlock(pytest.approx(0.05), pytest.approx(0.45), names)]


@pytest.mark.parametrize(("left", "time"), [(1.9e-3, 0.03), (2.1e-3, 0.06)])
def test_it_is_back_within_two_millimetres_of_before_the_contact(left, time):
    force = np.zeros((20, 2))
    force[5:8, 1] = 3.0
    error = np.full(20, 0.01)
    error[:4], error[5:10], error[10:13] = 0.02, 0.05, 0.01 + left
    record = Numbers(
        time=0.01 * np.arange(20), readings={FORCE: SimpleNamespace(values=force)}, position_error=error
    )
    assert recovery_time(record) == pytest.approx(time)


def planned(at, effect=(1, 0, 0, 0, 1.0, 0.0)):
    """Return a record of 10 ms a sample with plans at these samples, by what held it in the sample before."""
    plan = np.zeros((60, 4))
    for number, k in enumerate(at, 1):
        plan[k:] = number, 100, 7, 0.012
    pressure = np.zeros((60, 2))
    pressure[[k - 1 for k in at if k], 1] = 1.0
    effects = np.tile([0, 0, 0, 0, 1.0, 1.0], (60, 1))
    effects[[k - 1 for k in at if k]] = effect
    return Numbers(
        time=0.01 * np.arange(60),
        position=np.arange(180.0).reshape(60, 3),
        readings={
            PLAN: SimpleNamespace(values=plan),
            EFFECT: SimpleNamespace(values=effects),
            PRESSURE: SimpleNamespace(values=pressure, parts=("wall", "joint_2")),
        },
    )


def test_plans_say_when_where_and_why_they_were_made():
    first, second = plans_of_run(planned((0, 30)))
    assert (first.time, first.edges, first.seed, first.held_by, first.cause) == (0.0, 100, 7, "", "")
    assert (second.time, second.edges, second.held_by) == (pytest.approx(0.3), 100, "joint_2")
    assert second.place.tolist() == [90, 91, 92]
    assert second.cause == "planned again at 0.3 s, held by joint_2"
    assert second.proof == "certified: least room 12 mm beyond what is asked; 100 edges, seed 7"


def test_a_plan_for_a_goal_that_moved_was_held_by_nothing():
    assert [each.held_by for each in plans_of_run(planned((0, 30), effect=(0, 0, 0, 0, 1.0, 1.0)))] == [
        "",
        "",
    ]


def test_what_is_desired_begins_anew_where_a_plan_was_made_again():
    record = planned((0, 20, 30))
    parts = apart_at_plans(record, np.arange(60.0)[:, None])
    assert [(each[0, 0], len(each)) for each in parts] == [(0, 20), (20, 10), (30, 30)]
    assert [len(each) for each in apart_at_plans(record, np.arange(5.0)[:, None])] == [5]

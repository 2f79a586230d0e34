"""Two arms that carry a box in physics."""

from types import SimpleNamespace

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.controller import FurtherTask
from dqcontrol.errors import ValueRangeError
from dqcontrol.plants import MujocoPlant
from dqcontrol.plants.mujoco.carried_box import CarriedBox
from dqcontrol.reports.run_verdicts import _held_box as held_box

Q = np.array([-0.1, -0.5, 0.1, -2.2, 0.1, 1.7, 0.8, 0.1, -0.5, -0.1, -2.2, -0.1, 1.7, 0.8])
LAW = dqc.laws.ProportionalFeedforward(gain=5.0)
GRASP = FurtherTask("relative", gain=0.0, level=0)


def carried(duration, **box):
    arms = dqc.load_robot("two-pandas").with_task("absolute")
    circle = dqc.references.StartRamp(dqc.references.Circle(arms.fkm(Q), radius=0.05, duration=duration), 0.5)
    return dqc.simulate(arms, circle, LAW, MujocoPlant(box=CarriedBox(**box)), Q, period=0.01, tasks=[GRASP])


@pytest.mark.slow
def test_the_box_goes_where_the_hands_go():
    record = carried(3.0)
    place = record.readings["box_position"].values
    away = np.linalg.norm(place - record.position, axis=1)
    assert away.max() < 0.01
    force = record.readings["grip_force"].values[20:]
    assert force.min() > 9.81 / 2 / 0.8  # what friction needs at least, each hand half the weight
    assert (
        np.abs(force[:, 0] - force[:, 1]).max() < 0.5 * force.max()
    )  # gravity and acceleration are the rest


def test_a_report_tells_the_least_internal_force():
    times = np.arange(5) * 0.1
    for forces, verdict, words in (
        ([0, 20, 30, 25, 24], "held", "internal force 20 N at least, after 0.1 s"),
        ([0, 20, 30, 0, 0], "let go", "internal force 0 N at least, after 0.1 s"),
    ):
        grip = SimpleNamespace(
            values=np.column_stack([forces, np.array(forces) + 1.0]) * (np.array(forces) > 0)[:, None]
        )
        record = SimpleNamespace(time=times, readings={"grip_force": grip})
        ((_, cell, said),) = held_box(record)
        assert (cell, said) == (verdict, words)


@pytest.mark.slow
def test_without_a_squeeze_it_falls():
    record = carried(1.0, squeeze=0.0)
    assert record.readings["box_position"].values[-1, 2] < record.position[-1, 2] - 0.3
    assert (record.readings["grip_force"].values[-1] == 0).all()


def test_what_is_refused():
    panda = dqc.load_robot("panda")
    plant = MujocoPlant(box=CarriedBox())
    with pytest.raises(ValueRangeError, match=r"plant\.box: is carried by two hands, and panda has 1"):
        plant.start(panda, Q[:7], 0.01, 1, 0)
    with pytest.raises(ValueRangeError, match=r"plant\.box: both hands start 0 m apart, too near"):
        plant.start(dqc.TwoArms(panda, panda), np.concatenate([Q[:7], Q[:7]]), 0.01, 1, 0)

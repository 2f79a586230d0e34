"""Tables name the unit of what the inputs of their robots move."""

import pytest

import dqcontrol as dqc
from dqcontrol.experiments import summary
from dqcontrol.robots import SerialArm


@pytest.mark.parametrize(
    ("kinds", "units"),
    [
        (["revolute", "revolute"], ("rad/√s", "rad/s", "rad")),
        (["prismatic", "prismatic"], ("m/√s", "m/s", "m")),
        (["revolute", "prismatic"], ("rad/√s or m/√s", "rad/s or m/s", "rad or m")),
    ],
)
def test_summary_and_excitation(kinds, units):
    arm = SerialArm.from_dh([0, 0], [0.3, 0.3], [1, 1], [0, 1.5], joint_types=kinds, name="gantry")
    q = [0.2, 0.3]
    run = dqc.run(
        {
            "name": "rest",
            "robot": arm,
            "start": q,
            "period": 0.01,
            "reference": {"kind": "set-point", "duration": 0.05},
            "law": {"kind": "proportional", "gain": 1},
            "plant": {"kind": "integrator"},
        }
    )
    shown = {column.title: column.unit for column in summary({"rest": run}).columns}
    assert (shown["effort"], shown["peak |u|"], shown["limit margin"]) == units
    alone = {column.title: column.unit for column in summary({"rest": run.record}).columns}
    assert alone["limit margin"] == "rad or m"  # a record alone does not say what moves

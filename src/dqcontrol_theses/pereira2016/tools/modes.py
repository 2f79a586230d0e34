"""Print from which gain the Meka of [P16] shakes in physics, how fast, and in which joints.

`python -m dqcontrol_theses.pereira2016.tools.modes`. From the linear model of the arm at the start of the spiral, for
law K.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from dqcontrol.experiments import check, prepare
from dqcontrol.measures import gain_limits
from dqcontrol.tables import Cell, Column, Table
from dqcontrol_theses.pereira2016 import published_spec
from dqcontrol_theses.pereira2016.gain_x100 import with_gain_x100
from dqcontrol_theses.pereira2016.pereira2016_catalogue import PHYSICS

PERIODS = (0.008, 0.02)  # s
VARIANTS: dict[str, dict[str, Any]] = {
    "as chosen": {},
    "springs twice as stiff": {"springs": [600, 600, 300, 300, 80, 80, 80]},
    "springs half as stiff": {"springs": "soft"},
    "no hand": {"hand": False},
    "mode THETA": {"mode": "THETA"},
}


def row(label: str, changes: dict[str, Any], period: float) -> list[tuple[Column, Cell]]:
    """Return the largest stable k T of a variant, and the motion that it begins to shake with."""
    spec = published_spec("spiral", PHYSICS)
    every_tick = {"exchange_period": None}  # one every 10 ms and a period of 8 ms have no linear model
    setting = prepare(spec | {"plant": spec["plant"] | every_tick | changes})
    case = setting.cases[0]
    robot = case.scene.robot
    model = case.plant.linear_model(robot, case.scene.start, period)
    assert model is not None
    limit, frequency, joints = gain_limits(model, period).stable, "", "shakes by itself"
    if limit:
        closed = model.transition.copy()
        closed[:, : model.inputs.shape[1]] -= limit / period * model.inputs
        poles, motions = np.linalg.eig(closed)
        k = int(np.abs(poles).argmax())
        shares = np.abs(motions[: robot.configuration_size, k])
        largest = np.argsort(shares)[::-1][:3]
        joints = ", ".join(f"{robot.joint_names[i]} {shares[i] / shares.max():.2f}" for i in largest)
        frequency = abs(np.angle(poles[k])) / (2 * np.pi * period)
    return [
        (Column("Variant"), label),
        (Column("T", "ms", "g"), 1e3 * period),
        (Column("shakes from k T", "", ".2f"), limit),
        (Column("at", "Hz", ".1f"), frequency),
        (Column("joints that move most, relative"), joints),
    ]


def main() -> None:
    """Print the table, and what `check` says of the robust laws with a hundred times their gains."""
    rows = [row(label, changes, period) for label, changes in VARIANTS.items() for period in PERIODS]
    print(Table.of(rows).markdown())
    for remark in check(with_gain_x100(published_spec("spiral", PHYSICS))).remarks():
        print(remark)


if __name__ == "__main__":
    main()

"""How many of 100 far goals are reached with limits of joints, wheels, rims and accelerations all on.

Goals are hand poses at configurations of `dqcontrol.references.random_goals` (seed 2017): bases within ± 1.5 m at any
heading, arms anywhere within their limits. `GuidedProportional` follows a `DriveTo` reference; both keep all limits,
the law as hard constraints. Reached on ideal joints: |1 − x*x_d| < 1e-3 for the last second. Reached in physics, on
wheels that roll and slip, located by odometry: the hand's true position within 10 mm at the end.
"""

from __future__ import annotations

import sys
import time
from typing import Any

import numpy as np

import dqcontrol as dqc
from dqcontrol import laws
from dqcontrol.loop import Record
from dqcontrol.plants import Integrator, MobilePlant, Plant
from dqcontrol.references import DriveTo, random_goals
from dqcontrol.tables import Column, Table
from dqcontrol_theses.silva2017.goal_runs import (
    ALL_LIMITS,
    BASE_ACCELERATION,
    BASE_TURN_ACCELERATION,
    JOINT_ACCELERATION,
    beyond_limits,
)

ARM = [0, -0.9, 0.9, 0.9, 0]
PERIOD, SEED, COUNT, REACH = 0.05, 2017, 100, 1.5
REACHED, NEAR = 1e-3, 0.01
BASE: dict[str, Any] = {"acceleration": BASE_ACCELERATION, "turn_acceleration": BASE_TURN_ACCELERATION}
LAW = laws.GuidedProportional(gain=1.0, constraints=ALL_LIMITS)


def bodies() -> dict[str, dqc.WholeBody]:
    """Return bases of three kinds under the arm of Little John."""
    little_john = dqc.load_robot("little-john")
    assert isinstance(little_john, dqc.WholeBody)
    chassis = little_john.parts[0].chassis
    arm = dqc.load_robot("ax18")
    assert isinstance(arm, dqc.SerialArm)
    stand = dqc.DualQuaternion.from_translation([0, 0, 0.17])
    bases = {
        "differential": dqc.DifferentialDrive(0.065, 0.13, rim_speed=0.5, chassis=chassis, **BASE),
        "holonomic": dqc.HolonomicBase(speed=0.5, turn_rate=2.0, **BASE),
        "car-like": dqc.CarLikeBase(0.065, 0.13, wheelbase=0.25, steering_limit=0.6, rim_speed=0.5, **BASE),
    }
    return {name: dqc.WholeBody([base, stand, arm], name=name) for name, base in bases.items()}


def follow(
    robot: dqc.WholeBody, goal: np.ndarray, plant: Plant, rest: float = 3.0, period: float = PERIOD
) -> Record:
    """Return a run to a goal, and some seconds there."""
    home = np.array([0, 0, 0, *ARM])
    way = DriveTo.pose(robot, home, goal, acceleration=JOINT_ACCELERATION)
    return dqc.simulate(robot, way, LAW, plant, home, period, way.duration + rest)


def main() -> None:
    """Print the table."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else COUNT
    columns = [
        Column("Base"),
        Column("Reached to 1e-3", f"of {count}", ".0f"),
        Column("Worst error", "", ".1e"),
        Column("Median time", "s", ".1f"),
        Column("Beyond limits", "share", ".1e"),
        Column("In physics by odometry: within 10 mm", f"of {count}", ".0f"),
        Column("Median", "mm", ".1f"),
        Column("Worst", "mm", ".1f"),
    ]
    rows, begin = [], time.perf_counter()
    for name, robot in bodies().items():
        home = np.array([0, 0, 0, *ARM])
        goals = robot.fkm(random_goals(robot, home, count, reach=REACH, seed=SEED))
        records = [follow(robot, goal, Integrator()) for goal in goals]
        errors = np.array([record.error[-round(1 / PERIOD) :].max() for record in records])
        times = [record.duration - 3.0 for record in records]
        beyond = max(beyond_limits(robot, record, PERIOD) for record in records)
        cells = [name, float((errors < REACHED).sum()), errors.max(), float(np.median(times)), beyond]
        if name == "differential":
            plant = MobilePlant(location="odometry")
            missed = [float(follow(robot, goal, plant, 8.0).position_error[-1]) for goal in goals]
            cells += [
                float((np.array(missed) < NEAR).sum()),
                1e3 * float(np.median(missed)),
                1e3 * max(missed),
            ]
        else:
            cells += [None, None, None]
        rows.append(cells)
    print(Table(columns, rows).markdown())
    print(f"T = {PERIOD:g} s, seed {SEED}, {time.perf_counter() - begin:.0f} s in all")


if __name__ == "__main__":
    main()

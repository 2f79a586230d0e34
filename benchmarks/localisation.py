"""How near the hand keeps to its way and comes to its goal, by what tells where the base is.

Ten far goals (seed 2017) in MuJoCo with all limits on, as in `benchmarks/far_goals.py`. The odometry takes the right
wheel for 0.5 % larger than it is and the left one for 0.5 % smaller. The laser scanner's localisation has 10 Hz, 50 ms
of delay, 10 mm and 0.5° of noise; the camera 30 Hz, 100 ms, 5 mm and 0.3°. Errors are those of the true hand: root mean
square on the way, and mean of the last second.
"""

from __future__ import annotations

import math
import sys
import time

import far_goals
import msgspec
import numpy as np

from dqcontrol.plants import Camera, MobilePlant, WheeledBase
from dqcontrol.references import random_goals
from dqcontrol.tables import Column, Table

COUNT, DRIFT, PERIOD = 10, (0.005, -0.005), 0.03
SENSORS = {
    "laser scanner, 10 Hz": Camera(rate=10.0, delay=0.05, position_noise=0.01, angle_noise=math.radians(0.5)),
    "camera, 30 Hz": Camera(rate=30.0, delay=0.1, position_noise=0.005, angle_noise=math.radians(0.3)),
}
AVERAGED = 1.0  # s


def plants() -> dict[str, MobilePlant]:
    """Return the plants that are compared."""
    base = WheeledBase(wheel_errors=DRIFT)
    found = {"odometry alone": MobilePlant(location="odometry", base=base)}
    for name, camera in SENSORS.items():
        found[f"{name}, alone"] = MobilePlant(location="camera", base=base, camera=camera)
        filtered = msgspec.structs.replace(camera, filter_time=AVERAGED)
        found[f"{name}, fused"] = MobilePlant(location="fused", base=base, camera=filtered)
    return found


def errors(plant: MobilePlant, count: int) -> np.ndarray:
    """Return the hand's errors on the way and at the end of each run, shape (count, 2), m."""
    robot = far_goals.bodies()["differential"]
    home = np.array([0, 0, 0, *far_goals.ARM])
    goals = robot.fkm(random_goals(robot, home, count, reach=far_goals.REACH, seed=far_goals.SEED))
    found = []
    for goal in goals:
        error = far_goals.follow(robot, goal, plant, 5.0, PERIOD).position_error
        found.append([np.sqrt((error**2).mean()), error[-round(1 / PERIOD) :].mean()])
    return np.array(found)


def main() -> None:
    """Print the table."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else COUNT
    columns = [
        Column("Where the base is, by"),
        *(Column(f"hand, {when}", "mm", ".1f") for when in ("way", "goal")),
    ]
    begin = time.perf_counter()
    rows = [[name, *(1e3 * errors(plant, count).mean(axis=0)).tolist()] for name, plant in plants().items()]
    print(Table(columns, rows).markdown())
    print(f"seed {far_goals.SEED}, {count} goals, {time.perf_counter() - begin:.0f} s in all")


if __name__ == "__main__":
    main()

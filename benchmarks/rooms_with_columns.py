"""A robot that drives among columns: how many of 100 random rooms it crosses to its goal, and that it touches nothing.

Each room has three square columns (0.3 … 0.5 m, turned at random) within 2 m of the start and 0.55 m from it. The goal
is the hand's pose at a random configuration (bases within ± 1.5 m, any heading, any arm) that is 10 cm clear of them
and in which the robot does not touch itself. `GuidedProportional` follows `DriveTo.pose(…, floor=…)`, and keeps
chassis, links and hand off the columns and off each other, and limits of joints, wheels and accelerations, as hard
constraints. Distances are those of `geometry.distance` between the robot's shapes and columns, and between those of its
pairs that are kept apart, at every fifth sample. Seed 2017.
"""

from __future__ import annotations

import math
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np
import yaml

import dqcontrol as dqc
from dqcontrol import laws
from dqcontrol.errors import UnreachableGoalError
from dqcontrol.geometry import FloorMap, distance
from dqcontrol.loop import Record
from dqcontrol.plants import Integrator
from dqcontrol.references import DriveTo, random_goals
from dqcontrol.references.ways_around import room_of

HOME = np.array([0, 0, 0, 0, -0.9, 0.9, 0.9, 0])
PERIOD, SEED, COUNT = 0.05, 2017, 100
COLUMNS, FREE, CLEAR, REACHED = 3, 0.55, 0.1, 1e-3
ACCELERATION, MARGIN = 2.0, 0.005


def random_room(robot: dqc.WholeBody, seed: int) -> tuple[FloorMap, np.ndarray]:
    """Return columns and the hand's pose at a configuration that is clear of them."""
    rng = np.random.default_rng([SEED, seed])
    polygons: list[np.ndarray] = []
    while len(polygons) < COLUMNS:
        middle, side, turn = rng.uniform(-2, 2, 2), rng.uniform(0.3, 0.5), rng.uniform(0, math.pi)
        spin = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
        corners = middle + 0.5 * side * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) @ spin.T
        if FloorMap((corners,)).clearance([[0.0, 0.0]])[0] > FREE:
            polygons.append(corners)
    floor = FloorMap(tuple(polygons))
    drawn = random_goals(robot, HOME, 200, reach=1.5, seed=seed)
    goal = next(q for q in drawn if room_of(floor, robot, q[None]) >= CLEAR and apart(robot, q) >= MARGIN)
    return floor, robot.fkm(goal)


def apart(robot: dqc.WholeBody, q: np.ndarray) -> float:
    """Return the least distance of the shapes that are kept apart, m."""
    assert robot.shapes is not None
    moved = robot.shapes.moved(robot, q)
    return min(distance(moved[a], moved[b]).distance for a, b in robot.shapes.pairs)


def law_among(floor: FloorMap, folder: Path) -> laws.GuidedProportional:
    """Return the law that keeps out of what stands on a floor, from its file."""
    file = folder / "room.yaml"
    file.write_text(yaml.safe_dump({"polygons": [each.tolist() for each in floor.polygons]}))
    columns = laws.MapObstacle(file=str(file))
    kept = laws.Constraints(
        margin=MARGIN, acceleration=ACCELERATION, obstacles={"columns": columns}, recovery=0.1
    )
    return laws.GuidedProportional(gain=1.0, constraints=kept)


def cross(robot: dqc.WholeBody, floor: FloorMap, goal: np.ndarray, folder: Path) -> Record:
    """Return a run to a goal."""
    way = DriveTo.pose(robot, HOME, goal, acceleration=ACCELERATION, floor=floor)
    law = law_among(floor, folder)
    return dqc.simulate(robot, way, law, Integrator(), HOME, PERIOD, way.duration + 3.0)


def least_distances(robot: dqc.WholeBody, floor: FloorMap, configurations: np.ndarray) -> tuple[float, float]:
    """Return how near the robot comes to the columns, and to itself, m."""
    columns, itself, boxes = math.inf, math.inf, floor.boxes()
    assert robot.shapes is not None
    for q in configurations:
        moved = robot.shapes.moved(robot, q)
        columns = min(columns, *(distance(shape, box).distance for shape in moved for box in boxes))
        itself = min(itself, apart(robot, q))
    return columns, itself


def main() -> None:
    """Print what became of the rooms."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else COUNT
    robot, begin, ends, least, worst = dqc.load_robot("little-john"), time.perf_counter(), Counter(), [], 0.0
    assert isinstance(robot, dqc.WholeBody)
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(count):
            floor, goal = random_room(robot, seed)
            try:
                record = cross(robot, floor, goal, Path(folder))
            except UnreachableGoalError as error:
                ends[str(error).partition("; ")[0].partition(" to any of")[0]] += 1
                continue
            least.append(least_distances(robot, floor, record.q[::5]))
            final = float(record.error[-20:].max())
            worst = max(worst, final)
            ends["reached" if final < REACHED else "not reached"] += 1
    print(f"{count} rooms: " + ", ".join(f"{n} {what}" for what, n in ends.most_common()))
    columns, itself = np.transpose(least)
    print(f"contacts: {(columns <= 0).sum()}, least distance {1e3 * columns.min():.0f} mm")
    print(f"contacts with itself: {(itself <= 0).sum()}, least distance {1e3 * itself.min():.0f} mm")
    print(f"worst final error {worst:.1e}; seed {SEED}, {time.perf_counter() - begin:.0f} s in all")


if __name__ == "__main__":
    main()

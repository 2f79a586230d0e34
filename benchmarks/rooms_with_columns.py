"""A robot that drives among columns: how many of 100 random rooms it crosses to its goal, and that it touches nothing.

Each room has three square columns (0.3 … 0.5 m, turned at random) within 2 m of the start and 0.55 m from it. The goal
is the hand's pose at a random configuration (bases within ± 1.5 m, any heading, any arm) that is 10 cm clear of them.
`GuidedProportional` follows `DriveTo.pose(…, floor=…)`, and keeps the columns out, and limits of joints, wheels and
accelerations, as hard constraints. Distances are those of `geometry.distance` between chassis, links (capsules of
25 mm) and columns, at every fifth sample. Seed 2017.

Then the same rooms with all links kept from the columns and from each other. Goals for which no configuration was found
in which they are apart, or no such way, are counted on their own: of the rest all should be reached.
"""

from __future__ import annotations

import math
import sys
import tempfile
import time
from collections import Counter
from itertools import pairwise
from pathlib import Path

import numpy as np
import yaml

import dqcontrol as dqc
from dqcontrol import algebra, constraints, laws
from dqcontrol.errors import UnreachableGoalError
from dqcontrol.geometry import Capsule, FloorMap, distance
from dqcontrol.loop import Record
from dqcontrol.plants import Integrator
from dqcontrol.references import DriveTo, random_goals
from dqcontrol.references.ways_around import room_of

HOME = np.array([0, 0, 0, 0, -0.9, 0.9, 0.9, 0])
PERIOD, SEED, COUNT = 0.05, 2017, 100
COLUMNS, FREE, CLEAR, REACHED = 3, 0.55, 0.1, 1e-3
ACCELERATION, LINK, APART = 2.0, 0.025, 0.01
KEPT = {"chassis and hand from columns": ["chassis", "hand"], "all links from columns and each other": None}


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
    goal = next(q for q in drawn if room_of(floor, robot, q[None]) >= CLEAR)
    return floor, robot.fkm(goal)


def law_among(floor: FloorMap, folder: Path, links: list[str] | None) -> laws.GuidedProportional:
    """Return the law that keeps these links, or all and from each other too, out of what stands on a floor."""
    file = folder / "room.yaml"
    file.write_text(yaml.safe_dump({"polygons": [each.tolist() for each in floor.polygons]}))
    kept = constraints.Constraints(
        acceleration=ACCELERATION,
        self_collision=links is None,
        world=dqc.World(bodies={"columns": dqc.world.Body(map=str(file))}),
        clear_of={"columns": constraints.ClearOf(links=links, margin=0.005)},
        recovery=0.1,
    )
    return laws.GuidedProportional(gain=1.0, constraints=kept)


def cross(robot: dqc.WholeBody, way: DriveTo, law: laws.GuidedProportional) -> Record:
    """Return a run to a goal."""
    return dqc.simulate(robot, way, law, Integrator(), HOME, PERIOD, way.duration + 6.0)


def way_through(robot: dqc.WholeBody, floor: FloorMap, goal: np.ndarray) -> DriveTo:
    """Return the plan."""
    return DriveTo.pose(robot, HOME, goal, acceleration=ACCELERATION, floor=floor)


def least_distance(robot: dqc.WholeBody, floor: FloorMap, configurations: np.ndarray) -> float:
    """Return how near chassis and links come to the columns, m."""
    least, boxes = math.inf, floor.boxes()
    assert robot.shapes is not None
    chassis = robot.shapes.shapes[0].shape
    for q in configurations:
        frames = robot.frames(q)
        places = algebra.translation(frames[3:])
        links = [Capsule(a, b, LINK) for a, b in pairwise(places)]
        for shape in (chassis.moved(frames[2]), *links):
            least = min(least, *(distance(shape, box).distance for box in boxes))
    return least


def is_apart(way: DriveTo) -> bool:
    """Return whether all pairs of links that are kept apart are so on the whole way."""
    assert way.robot.shapes is not None
    instants = way.configurations(np.arange(0.0, way.duration + PERIOD, PERIOD))
    return bool((way.robot.shapes.apart(way.robot, instants) > APART).all())


def main() -> None:
    """Print what became of the rooms."""
    count, robot = int(sys.argv[1]) if len(sys.argv) > 1 else COUNT, dqc.load_robot("little-john")
    assert isinstance(robot, dqc.WholeBody)
    for title, links in KEPT.items():
        begin, ends, least, worst = time.perf_counter(), Counter[str](), [], 0.0
        with tempfile.TemporaryDirectory() as folder:
            for seed in range(count):
                floor, goal = random_room(robot, seed)
                try:
                    way = way_through(robot, floor, goal)
                except UnreachableGoalError as error:
                    ends[str(error).partition("; ")[0].partition(" to any of")[0]] += 1
                    continue
                record = cross(robot, way, law_among(floor, Path(folder), links))
                least.append(least_distance(robot, floor, record.q[::5]))
                final = float(record.error[-20:].max())
                if final < REACHED:
                    worst = max(worst, final)
                    ends["reached"] += 1
                else:
                    ends["not reached" if is_apart(way) else "not reached, links not apart in the plan"] += 1
        print(f"{title}: {count} rooms: " + ", ".join(f"{n} {what}" for what, n in ends.most_common()))
        print(f"contacts: {sum(each <= 0 for each in least)}, least distance {1e3 * min(least):.0f} mm")
        print(f"worst final error of those reached {worst:.1e}; {time.perf_counter() - begin:.0f} s")
    print(f"seed {SEED}")


if __name__ == "__main__":
    main()

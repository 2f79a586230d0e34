"""Plans among shelves, tables, boxes and cages: how many are found, how long they take, and whether all are clear.

    python benchmarks/planning.py [--problems 20] [--edges 100000] [--guests 43] [--drives 20] [--door 1.05]

Seven types of scenes in the manner of MotionBenchMaker [Chamzas et al. 2022], made here: a Panda with its hand as a
capsule more, 5 mm of margin; start and goal are poses of its hand in or before the furniture, and each problem has
configurations for both that keep the margin. Judge: distances by `geometry` at 2000 configurations of each way. Then
random edges of 0.8 rad: certified against sampled every 0.05 rad, time of processor of both in one process, and
certified ones sampled 1000 times. Then scenes of balls, as in `reactive_scenes.py`, whose ways another ball crosses
that no plan foresees, or on which it stays; margins of 10 mm. Last a little-john, whose base drives: to between the
boards of a shelf, and out of a room through a door of 1.05 × its chassis and what is asked; there the same on a base
that steers, too.
"""

from __future__ import annotations

import argparse
import time
import warnings
from itertools import pairwise

import msgspec
import numpy as np
import reactive_scenes
from constraint_peers import PERIOD
from constraints import fenced

import dqcontrol as dqc
from dqcontrol import algebra
from dqcontrol.constraints.prepared_constraints import PreparedConstraints
from dqcontrol.errors import PlanError
from dqcontrol.geometry import Capsule, Sphere, distance
from dqcontrol.planning import CertifiedEdges, plan
from dqcontrol.robots import LinkShape, LinkShapes

MARGIN = 0.005  # m
SPEED = 0.25  # m/s, of guests
LINK = 0.16  # m: guests leave room for a link, and what is kept on both sides of it, between them and other balls
SHOULDER = 0.2  # m: guests stay so far from the axes of the first two links
CHASSIS = 0.33  # m: of a little-john, across
AT_GOAL = 2e-3  # of the entries of poses: 4 mm, 0.2°
Body = dqc.world.Body
FORWARDS, DOWN = algebra.rotation_from_rpy([0, np.pi / 2, 0]), algebra.rotation_from_rpy([np.pi, 0, 0])


def panda_with_hand() -> dqc.Robot:
    """Return a Panda whose hand and fingers are a capsule at its flange, kept away from links that can meet it."""
    arm = dqc.load_robot("panda")
    assert arm.shapes is not None
    hand = LinkShape("hand and fingers", 7, Capsule(np.array([0, 0, 0.14]), np.array([0, 0, 0.2]), 0.06))
    shapes = arm.shapes.shapes
    pairs = [(len(shapes), k) for k, each in enumerate(shapes) if each.frame <= 3]
    arm.shapes = LinkShapes((*shapes, hand), (*arm.shapes.pairs, *pairs))
    return arm


def beside(middle: np.ndarray, x: float, y: float, z: float) -> tuple[float, float, float]:
    return float(middle[0]) + x, float(middle[1]) + y, float(middle[2]) + z


def boards(x: float, heights: tuple[float, ...], depth: float, width: float) -> dict[str, Body]:
    """Return the boards and sides of a shelf in front of the robot."""
    found = {
        f"board {k}": Body(box=[depth, width, 0.02], position=(x, 0, height))
        for k, height in enumerate(heights)
    }
    tall = heights[-1] - heights[0]
    for k, side in enumerate((-0.5, 0.5)):
        middle = (x, side * (width + 0.02), 0.5 * (heights[0] + heights[-1]))
        found[f"side {k}"] = Body(box=[depth, 0.02, tall], position=middle)
    return found


def walls(middle: np.ndarray, size: np.ndarray) -> dict[str, Body]:
    """Return the walls and the bottom of an open box."""
    x, y, z = size
    found = {"bottom": Body(box=[x, y, 0.02], position=beside(middle, 0, 0, -0.5 * z))}
    for k, sign in enumerate((-1, 1)):
        found[f"front {k}"] = Body(box=[0.02, y, z], position=beside(middle, 0.5 * sign * x, 0, 0))
        found[f"side {k}"] = Body(box=[x, 0.02, z], position=beside(middle, 0, 0.5 * sign * y, 0))
    return found


def scene(kind: str, rng: np.random.Generator) -> tuple[dict[str, Body], tuple[np.ndarray, np.ndarray]]:
    """Return bodies, and poses of the hand's flange at start and goal."""
    floor = {"floor": Body(box=[3.0, 3.0, 0.02], position=(0, 0, -0.06))}

    def at(turn: np.ndarray, *place: float) -> np.ndarray:
        return algebra.pose(turn, np.array(place))

    near = rng.uniform(-0.02, 0.02, 4)
    if kind.startswith("shelf"):
        width, x = (0.8, 0.7) if kind == "shelf" else (0.5, 0.65)
        rows = (0.1, 0.4, 0.7, 1.0) if kind == "shelf" else (0.15, 0.42, 0.69, 0.96)
        low, high = rng.permutation(3)[:2]
        y = rng.uniform(-0.15, 0.15, 2) if kind == "shelf" else rng.uniform(-0.08, 0.08, 2)
        places = [
            at(FORWARDS, x - 0.25 + near[i], y[i], 0.5 * (rows[k] + rows[k + 1]))
            for i, k in enumerate((low, high))
        ]
        return floor | boards(x, rows, 0.3, width), (places[0], places[1])
    if kind == "table over":
        top = {"table": Body(box=[0.8, 1.2, 0.04], position=(0.75, 0, 0.3))}
        blocks = {
            f"block {k}": Body(box=[0.08, 0.08, 0.25], position=(0.5 + 0.1 * near[k], y, 0.45))
            for k, y in enumerate((-0.15, 0.0, 0.15))
        }
        return floor | top | blocks, (at(DOWN, 0.5, -0.3 + near[2], 0.6), at(DOWN, 0.5, 0.3 + near[3], 0.6))
    if kind == "table under":
        top = {"table": Body(box=[0.5, 0.9, 0.03], position=(0.7, 0, 0.5 + near[0]))}
        return floor | top, (at(FORWARDS, 0.4, 0.1 + near[1], 0.25), at(DOWN, 0.5, -0.1 + near[2], 0.72))
    if kind == "box":
        box = walls(np.array([0.5, 0.25, 0.12]), np.array([0.36, 0.36, 0.24]))
        return floor | box, (
            at(DOWN, 0.5 + near[0], 0.25 + near[1], 0.34),
            at(DOWN, 0.45, -0.3 + near[2], 0.4),
        )
    if kind == "two boxes":
        first = walls(np.array([0.5, 0.25, 0.12]), np.array([0.36, 0.36, 0.24]))
        other = walls(np.array([0.5, -0.25, 0.12]), np.array([0.36, 0.36, 0.24]))
        bodies = first | {f"other {name}": body for name, body in other.items()}
        return floor | bodies, (at(DOWN, 0.5 + near[0], 0.25, 0.34), at(DOWN, 0.5, -0.25 + near[1], 0.34))
    # a cage of bars around the place in front, open above
    bars = {
        f"bar {k}": Body(capsule=(0.012, 0.4), position=(0.52 + 0.21 * np.cos(a), 0.21 * np.sin(a), 0.2))
        for k, a in enumerate(np.linspace(0.0, 2 * np.pi, 12, endpoint=False))
    }
    return floor | bars, (at(DOWN, 0.52 + 0.5 * near[0], near[1], 0.4), at(DOWN, 0.3, 0.4 + near[2], 0.4))


def guest(way: dqc.planning.PlanTo, side: float, *, stays: bool) -> Body:
    """Return a ball of 50 mm that comes to the hand's way by half time, at 0.25 m/s, and that no plan foresees."""
    half, robot = 0.5 * way.duration, way.robot
    places = algebra.translation(robot.fkm(way.configurations([half - 0.01, half, half + 0.01])))
    x, y, _ = places[2] - places[0]
    across = side * np.array([-y, x, 0.0]) / max(np.hypot(x, y), 1e-9)
    x, y, z = places[1] - SPEED * half * across
    there, beyond = SPEED * half * across, SPEED * (way.duration + 4.0) * across
    path = [(0.0, 0.0, 0.0, 0.0), (half, *there), (way.duration + 4.0, *(there if stays else beyond))]
    return Body(sphere=0.05, position=(x, y, z), moves=dqc.world.Motion(path=path, announced=False))


def with_guest(
    given: dqc.constraints.Constraints, way: dqc.planning.PlanTo, *, stays: bool
) -> dqc.constraints.Constraints | None:
    """Return constraints with a guest that squeezes no link and leaves start and goal clear; None if none does."""
    assert given.world is not None
    standing = [(shape, LINK) for _, shape in given.world.shapes]
    assert way.robot.shapes is not None
    shoulder = way.robot.frames(way.plan.configurations[0])  # joints cannot take that out of a ball's way
    standing += [
        (Sphere(point, SHOULDER), 0.0)
        for each in way.robot.shapes.shapes
        if 0 < each.frame <= 2 and isinstance(each.shape, Capsule)
        for shape in [each.shape.moved(shoulder[each.frame - 1])]
        for point in np.linspace(shape.start, shape.end, 5)
    ]
    for side in (1.0, -1.0):
        ball = guest(way, side, stays=stays)
        assert ball.moves is not None
        times = np.linspace(0.0, way.duration + 4.0, 200)
        places = np.asarray(ball.position) + ball.moves.shifts(times)
        if any(
            distance(Sphere(place, 0.05), shape).distance < room
            for place in places
            for shape, room in standing
        ):
            continue
        found = msgspec.structs.replace(given, world=dqc.World(bodies=given.world.bodies | {"guest": ball}))
        ends, when = way.plan.configurations[[0, -1]], times[[0, -1]]
        kept = PreparedConstraints(found, way.robot, PERIOD, "measured")
        if (kept.values(ends, when) > kept.asked + kept.allowances).all():
            return found
    return None


def guests(count: int) -> None:
    """Follow plans while an unforeseen ball crosses their way, or stays on it, with and without planning again."""
    arm = dqc.load_robot("panda")
    ends = {
        (stays, again): [0, 0.0, np.inf] for stays in (False, True) for again in (None, dqc.planning.Again())
    }
    number = done = 0
    while done < count:
        balls, start, at_goal = reactive_scenes.scene(np.random.default_rng([11, number]), arm)
        given, goal = fenced(arm, balls, acceleration=10.0), arm.fkm(at_goal)
        number += 1
        kept = PreparedConstraints(given, arm, PERIOD, "measured")
        found = dqc.planning.PlanTo(plan(arm, kept, start, goal, effort=60_000))
        crossed = [with_guest(given, found, stays=stays) for stays in (False, True)]
        if None in crossed:
            continue
        done += 1
        for (stays, again), end in ends.items():
            keep = crossed[int(stays)]
            assert keep is not None
            law = dqc.laws.GuidedProportional(gain=2.0, pull=5.0, constraints=keep)
            way = dqc.planning.PlanTo(found.plan, again=again)
            duration = None if again else way.duration + 6.0
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", dqc.errors.NoteWarning)
                record = dqc.simulate(arm, way, law, dqc.plants.Integrator(), start, PERIOD, duration)
            last = arm.fkm(record.q[-1])
            end[0] += bool(np.abs(goal - np.sign(goal @ last) * last).max() < AT_GOAL)
            end[1] += record.readings["plan"].values[-1, 0] - 1
            everything = PreparedConstraints(keep, arm, PERIOD, "measured")
            room = (everything.values(record.q, record.time) - everything.asked).min()
            end[2] = min(end[2], float(room))
    print("| a ball | ways | reached | planned again | least room [mm] |")
    print("|---" * 5 + "|")
    for (stays, again), (reached, times, least) in ends.items():
        names = "stays" if stays else "crosses", "planned again where held" if again else "planned once"
        print(f"| {' | '.join(names)} | {reached} of {count} | {times:.0f} times | {1e3 * least:.2f} |")


KINDS = ("shelf", "shelf, narrow", "table over", "table under", "box", "two boxes", "cage")


def problem(
    kind: str, number: int, arm: dqc.Robot
) -> tuple[dqc.constraints.Constraints, np.ndarray, np.ndarray]:
    """Return constraints, a start configuration and the goal's pose, both of which can be kept clear."""
    rng = np.random.default_rng([9, KINDS.index(kind), number])
    while True:
        bodies, poses = scene(kind, rng)
        given = dqc.constraints.Constraints(world=dqc.World(bodies=bodies), clear_of="all", margin=MARGIN)
        edges, found = CertifiedEdges(arm, given, 1e-3), []
        for pose in poses:
            try:
                q = np.array([each.q for each in dqc.robots.postures(arm, pose)])
            except dqc.errors.ReachError:
                break
            clear = q[edges.room_at(q)[0] > 0]
            if not len(clear):
                break
            found.append(clear[rng.integers(len(clear))])
        if len(found) == 2:
            return given, found[0], poses[1]


def plans(count: int) -> None:
    arm = panda_with_hand()
    given, start, goal = problem("box", 0, arm)
    plan(arm, given, start, goal)  # compiles
    print(f"| {count} a type | found | median [ms] | p95 [ms] | edges, median | least room [mm] | too near |")
    print("|---" * 7 + "|")
    everything: list[float] = []
    whole, wrong = 0, 0
    for kind in KINDS:
        took, edges, rooms, near = [], [], [], 0
        for number in range(count):
            given, start, goal = problem(kind, number, arm)
            begin = time.process_time()
            try:
                way = plan(arm, given, start, goal, effort=60_000)
            except PlanError:
                took.append(time.process_time() - begin)
                continue
            took.append(time.process_time() - begin)
            edges.append(way.certificate.edges)
            q = np.vstack(
                [
                    way.way.at(np.linspace(0, way.length, 1000))[0],
                    *(np.linspace(a, b, 200) for a, b in pairwise(way.configurations)),
                ]
            )
            least = (way.kept.values(q, np.zeros(len(q))) - way.kept.asked).min()
            near += least < 0
            rooms.append(least)
        numbers = (1e3 * np.median(took), 1e3 * np.quantile(took, 0.95), np.median(edges), 1e3 * min(rooms))
        print(f"| {kind} | {len(edges)} | " + " | ".join(f"{each:.3g}" for each in numbers) + f" | {near} |")
        everything += took
        whole, wrong = whole + len(edges), wrong + near
    print(
        f"| all | {whole} of {count * len(KINDS)} | {1e3 * np.median(everything):.3g} | "
        f"{1e3 * np.quantile(everything, 0.95):.3g} | | | {wrong} |"
    )


def edges(count: int) -> None:
    """Certify random edges among furniture, beside sampling them, and sample the certified ones."""
    arm, rng = panda_with_hand(), np.random.default_rng(3)
    steps = int(np.ceil(0.8 / 0.05)) + 1
    certified = sampled = 0.0
    clear = wrong = missed = 0
    per_scene = 1000
    for number in range(max(1, count // per_scene)):
        kind = KINDS[number % len(KINDS)]
        given, _, _ = problem(kind, number, arm)
        found = CertifiedEdges(arm, given)
        lower, upper = arm.limits.lower, arm.limits.upper
        a = rng.uniform(lower, upper, (per_scene, 7))
        away = rng.normal(size=a.shape)
        b = np.clip(a + 0.8 * away / np.linalg.norm(away, axis=1)[:, None], lower, upper)
        begin = time.process_time()
        ends = found.clear(a, b)
        certified += time.process_time() - begin
        q = (a[:, None] + np.linspace(0, 1, steps)[:, None] * (b - a)[:, None]).reshape(-1, 7)
        begin = time.process_time()
        values = found.kept.values(q, np.zeros(len(q)))
        sampled += time.process_time() - begin
        passed = (values - found.kept.asked).min(axis=1).reshape(per_scene, steps).min(axis=1) >= 0
        missed += int((passed & ~ends.certified).sum())
        for k in np.flatnonzero(ends.certified):
            fine = a[k] + np.linspace(0, 1, 1000)[:, None] * (b[k] - a[k])
            wrong += bool((found.kept.values(fine, np.zeros(1000)) < found.kept.asked).any())
        clear += int(ends.certified.sum())
    print(
        f"{count} edges of 0.8 rad: {clear} certified, {wrong} of these below at one of 1000 samples; "
        f"{missed} that samples at 0.05 rad passed were not; time {certified / sampled:.2f} of all rows' samples"
    )


def shelf_drive(seed: int, _: float) -> tuple[dict[str, Body], float, np.ndarray, np.ndarray]:
    """Return bodies, a margin, a start somewhere and a configuration with the hand between two boards."""
    rng = np.random.default_rng([13, seed])
    shelf = {
        "lower": Body(box=(0.25, 0.8, 0.02), position=(2.0, 0.6, 0.12)),
        "upper": Body(box=(0.25, 0.8, 0.02), position=(2.0, 0.6, 0.45)),
        "back": Body(box=(0.02, 0.8, 0.5), position=(2.14, 0.6, 0.25)),
    }
    start = np.array([*rng.uniform(-1, 0.5, 2), rng.uniform(-np.pi, np.pi), 0, -0.9, 0.9, 0.9, 0])
    return shelf, 0.01, start, np.array([1.52, rng.uniform(0.4, 0.8), 0, 0, -0.49, 1.04, 0, 0])


def door_drive(seed: int, door: float) -> tuple[dict[str, Body], float, np.ndarray, np.ndarray]:
    """Return a room with a door so many times as wide as the chassis and what is asked, a start and a goal there."""
    rng = np.random.default_rng([12, seed])
    margin, angle, beside = (0.02, 0.01)[seed % 2], rng.uniform(-0.9, 0.9), rng.uniform(-0.4, 0.4)
    half = 0.5 * door * (CHASSIS + 2 * margin)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    sizes = {
        "left": (1.25, 0.5 * (2 + beside + half), 0.1, 2 - beside - half),
        "right": (1.25, 0.5 * (-2 + beside - half), 0.1, 2 + beside - half),
        "back": (-1.25, 0.0, 0.1, 4.0),
        "side": (0.0, 2.0, 2.6, 0.1),
        "other side": (0.0, -2.0, 2.6, 0.1),
    }
    room = {}
    for name, (x, y, length, width) in sizes.items():
        place = turn @ [x, y]
        room[name] = Body(
            box=(length, width, 1.5), position=(float(place[0]), float(place[1]), 0.75), rpy=(0, 0, angle)
        )
    goal = np.array(
        [*(turn @ [2.6, beside + rng.uniform(-0.2, 0.2)]), rng.uniform(-2, 2), 0.3, -0.6, 0.9, 0.7, 0]
    )
    return room, margin, np.array([0, 0, 0, 0, -0.9, 0.9, 0.9, 0]), goal


def little_car() -> dqc.Robot:
    """Return a little-john whose base steers as a car does, in arcs of 0.55 m."""
    own = dqc.load_robot("little-john")
    base = dqc.CarLikeBase(0.065, 0.13, wheelbase=0.3, steering_limit=0.6, rim_speed=1.0)
    car = dqc.WholeBody([base, *own.parts[1:]])
    car.shapes = own.shapes
    return car


def drives(count: int, door: float) -> None:
    """Plan ways of a base that drives and its arm, beside the same legs one after the other, and follow them."""
    turns, steers = dqc.load_robot("little-john"), little_car()
    print(
        f"| {count} each | found | one after the other [s] | together [s] | least room [mm] | off the way [rad, m] |"
    )
    print("|---" * 6 + "|")
    kinds = (
        ("to a shelf", shelf_drive, turns),
        ("through a door", door_drive, turns),
        ("steering, through a door", door_drive, steers),
    )
    for name, scene_of, robot in kinds:
        assert robot.shapes is not None
        apart, lasts, rooms, off = [], [], [], 0.0
        for seed in range(count):
            bodies, margin, start, goal = scene_of(seed, door)
            keep = dqc.constraints.Constraints(
                world=dqc.World(bodies=bodies),
                clear_of="all",
                margin=margin,
                self_margin=0.005,
                acceleration=5,
            )
            try:
                way = dqc.planning.drive_and_plan(robot, keep, start, dqc.DualQuaternion(robot.fkm(goal)))
            except PlanError:
                continue
            lasts.append(way.duration)
            legs = getattr(way, "legs", ())
            apart.append(sum(leg.end - leg.begin for leg in legs) or way.duration)
            law = dqc.laws.GuidedProportional(gain=1.0, constraints=keep)
            record = dqc.simulate(robot, way, law, dqc.plants.Integrator(), start, PERIOD)
            off = max(off, float(np.abs(record.q - way.configurations(record.time)).max()))
            for q in way.configurations(np.linspace(0, way.duration, 400)):
                frames = robot.frames(q)
                links = [
                    each.shape.moved(frames[each.frame - 1]) for each in robot.shapes.shapes if each.frame
                ]
                near = (distance(link, body.shapes[0]).distance for link in links for body in bodies.values())
                rooms.append(min(near) - margin)
        print(
            f"| {name} | {len(lasts)} | {np.median(apart):.3g} | {np.median(lasts):.3g} | {1e3 * min(rooms):.3g} "
            f"| {off:.1g} |"
        )


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--problems", type=int, default=20)
    parser.add_argument("--edges", type=int, default=100_000)
    parser.add_argument("--guests", type=int, default=43)
    parser.add_argument("--drives", type=int, default=20)
    parser.add_argument("--door", type=float, default=1.05)
    options = parser.parse_args()
    if options.problems:
        plans(options.problems)
    if options.edges:
        edges(options.edges)
    if options.guests:
        guests(options.guests)
    if options.drives:
        drives(options.drives, options.door)

"""Goals among obstacles: random rooms, a niche, a door with the arm folded, maps from files, and what is refused."""

import importlib.util
import math
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.errors import Error, FileFormatError, UnreachableGoalError, ValueRangeError
from dqcontrol.geometry import FloorMap, load_map
from dqcontrol.references import DriveTo
from dqcontrol.references.ways_around import WaysAround, across, folded_posture, room_of

SEED = 20261210
_file = Path(__file__).parents[2] / "benchmarks" / "rooms_with_columns.py"
_spec = importlib.util.spec_from_file_location("rooms_with_columns", _file)
assert _spec is not None
assert _spec.loader is not None
rooms = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(rooms)
ROBOT = dqc.load_robot("little-john")
HOME = rooms.HOME


def box(x0, x1, y0, y1):
    return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]], dtype=float)


@pytest.mark.parametrize(
    ("count", "least", "links"),
    [
        (2, 2, ["chassis", "hand"]),
        (1, 1, None),
        pytest.param(100, 90, ["chassis", "hand"], marks=pytest.mark.slow),
        pytest.param(100, 80, None, marks=pytest.mark.slow),
    ],
)
def test_random_rooms_are_crossed_without_contact(tmp_path, count, least, links):
    """With all links kept from each other too wherever there is a plan on which they are apart."""
    reached = 0
    for seed in range(count):
        floor, goal = rooms.random_room(ROBOT, seed)
        try:
            way = rooms.way_through(ROBOT, floor, goal)
        except UnreachableGoalError as error:
            print(seed, error)
            continue
        record = rooms.cross(ROBOT, way, rooms.law_among(floor, tmp_path, links))
        assert rooms.least_distance(ROBOT, floor, record.q[::5]) > 0
        arrived = bool((record.error[-20:] < 1e-3).all())
        assert arrived or not rooms.is_apart(way)
        reached += arrived
    assert reached >= least


@pytest.mark.slow
def test_parking_in_a_niche():
    """0.7 m wide, 0.85 m deep; the hand is to be at its far wall."""
    walls = (box(1.0, 1.85, 0.35, 2.0), box(1.0, 1.85, -2.0, -0.35), box(1.85, 2.0, -2.0, 2.0))
    floor = FloorMap(walls, height=1.0)
    goal = ROBOT.fkm([1.35, 0, 0, 0, -0.9, 0.9, 0.9, 0])
    way = DriveTo.pose(ROBOT, HOME, goal, floor=floor, clearance=0.03)
    q = way.configurations(np.linspace(0, way.duration, 300))
    assert rooms.least_distance(ROBOT, floor, q[::5]) > 0.01
    assert q[-1, 0] > 1.0
    np.testing.assert_allclose(
        dqc.algebra.translation(ROBOT.fkm(q[-1])), dqc.algebra.translation(goal), atol=1e-5
    )


@pytest.mark.slow
def test_through_a_door_the_arm_folds_itself():
    """0.6 m wide, and the arm is stretched out to the side: less than the robot takes."""
    door = (box(1.0, 1.1, 0.3, 2.5), box(1.0, 1.1, -2.5, -0.3))
    floor = FloorMap(door, height=1.5)
    start = np.array([0, 0, 0, 1.5, 0.9, 0.0, 0.0, 0])
    assert across(ROBOT, start) > 0.3
    folded = folded_posture(ROBOT, start)
    assert across(ROBOT, folded) < 0.25
    way = DriveTo.pose(ROBOT, start, ROBOT.fkm([2.0, 0.2, 0.3, *start[3:]]), floor=floor, clearance=0.02)
    assert way.folded is not None
    assert way.while_driving == (True, True)  # there is room for that before and behind the door
    q = way.configurations(np.linspace(0, way.duration, 400))
    assert rooms.least_distance(ROBOT, floor, q[::4]) > 0
    resting = replace(way, while_driving=(False, False))
    assert resting.duration > way.duration + 5.0
    q = resting.configurations(np.linspace(0, resting.duration, 400))
    passing = np.abs(q[:, 0] - 1.05) < 0.05
    assert passing.any()
    np.testing.assert_allclose(q[passing][:, 3:], np.broadcast_to(folded[3:], (passing.sum(), 5)), atol=1e-9)


def test_the_base_rests_while_the_arm_folds_where_a_column_is_in_its_reach():
    """It would sweep the column beside it by turning with the arm stretched out ahead."""
    floor = FloorMap((box(0.2, 0.4, 0.2, 0.4),), height=1.5)
    start = np.array([0, 0, 0, 0, 0.9, 0.0, 0.0, 0])
    goal = ROBOT.fkm([-0.3, 1.6, 1.6, 0.3, 0.9, 0.0, 0.0, 0])
    way = DriveTo.pose(ROBOT, start, goal, floor=floor, clearance=0.02)
    assert (way.folded is not None, way.while_driving) == (True, (False, True))
    at_once = replace(way, while_driving=(True, True))
    for each, clear in ((way, True), (at_once, False)):
        q = each.configurations(np.linspace(0, each.duration, 200))
        assert (room_of(floor, ROBOT, q) > 0.01) == clear


def door_ahead(width, angle, beside):
    """Return what stands left and right of a door, m, beyond x = 1.2 in axes that are turned, and those."""
    c, s = math.cos(angle), math.sin(angle)
    turn = np.array([[c, -s], [s, c]])
    half = 0.5 * width
    walls = box(1.2, 1.3, beside + half, beside + 4.0), box(1.2, 1.3, beside - 4.0, beside - half)
    return FloorMap(tuple(each @ turn.T for each in walls), height=1.5), turn


@pytest.mark.parametrize("seed", [0, *(pytest.param(k, marks=pytest.mark.slow) for k in range(1, 8))])
def test_doors_of_105_percent_of_the_chassis_and_its_clearance_are_passed(seed):
    rng = np.random.default_rng([5, seed])
    clearance, angle, beside = (0.02, 0.05)[seed % 2], rng.uniform(-0.9, 0.9), rng.uniform(-0.4, 0.4)
    width = 1.05 * 2 * (across(ROBOT, folded_posture(ROBOT, HOME)) + clearance)
    floor, turn = door_ahead(width, angle, beside)
    goal = HOME.copy()
    goal[:2], goal[2] = turn @ [2.6, beside + rng.uniform(-0.3, 0.3)], rng.uniform(-3, 3)
    way = DriveTo.pose(ROBOT, HOME, ROBOT.fkm(goal), floor=floor, clearance=clearance)
    q = way.configurations(np.linspace(0, way.duration, 600))
    assert rooms.least_distance(ROBOT, floor, q[::6]) > 0
    x, y = (q[:, :2] @ turn).T
    assert ((np.abs(x - 1.25) < 0.05) & (np.abs(y - beside) < 0.5 * width)).any()
    assert np.abs(np.diff(q, axis=0)).max() < 0.2  # no jump


def test_what_stands_in_the_way_is_said():
    closed = FloorMap(
        (box(-1, 1, 1.0, 1.1), box(-1, 1, -1.1, -1), box(1, 1.1, -1.1, 1.1), box(-1.1, -1, -1.1, 1.1))
    )
    beyond = ROBOT.fkm([2.5, 0, 0, *HOME[3:]])
    with pytest.raises(UnreachableGoalError, match=r"finds no way to any of .* folded it takes"):
        DriveTo.pose(ROBOT, HOME, beyond, floor=closed)
    hand = dqc.algebra.translation(beyond)[:2]
    inside = FloorMap((box(hand[0] - 0.2, hand[0] + 0.2, hand[1] - 0.2, hand[1] + 0.2),))
    with pytest.raises(UnreachableGoalError, match=r"pose: the goal \(.*\) m is inside what stands there"):
        DriveTo.pose(ROBOT, HOME, beyond, floor=inside)
    with pytest.raises(ValueRangeError, match=r"start: little-john is .* mm inside what stands there"):
        DriveTo.pose(ROBOT, HOME, beyond, floor=FloorMap((box(-0.1, 0.1, -0.1, 0.1),)))
    arm = dqc.load_robot("iiwa7")
    goal = arm.fkm(np.full(7, 0.5))
    with pytest.raises(Error, match="floor: expected a robot with one base, got iiwa7"):
        DriveTo.pose(arm, np.zeros(7), goal, floor=inside)


@pytest.mark.slow
def test_clearance_is_that_of_many_points():
    rng = np.random.default_rng(SEED)
    print("seed", SEED)
    floor = FloorMap(
        (
            box(0, 1, 0, 0.5),
            np.array([[2, 0], [3, 0.2], [2.2, 1.0]]),
            np.array([[0, 2], [2, 2], [0, 3], [0.3, 2.3]]),
        )
    )
    border = np.vstack(
        [
            a + np.linspace(0, 1, 2000)[:, None] * (b - a)
            for each in floor.polygons
            for a, b in zip(each, np.roll(each, -1, axis=0), strict=True)
        ]
    )
    points = rng.uniform(-1, 4, (200, 2))
    found = floor.clearance(points)
    np.testing.assert_allclose(
        np.abs(found), np.linalg.norm(points[:, None] - border, axis=2).min(axis=1), atol=1e-3
    )
    assert (floor.holds(points) == (found < 0)).all()
    assert floor.holds([[0.5, 0.25], [0.2, 2.6]]).tolist() == [True, True]
    lines = floor.line_clearance(points[0], points[1:])
    share = np.linspace(0, 1, 400)[:, None, None]
    dense = points[0] + share * (points[1:] - points[0])
    least = np.array([floor.clearance(dense[:, i]).min() for i in range(dense.shape[1])])
    np.testing.assert_allclose(lines, np.maximum(least, 0), atol=0.02)


def test_ways_go_round_a_wall():
    floor = FloorMap((box(1.0, 1.1, -1.0, 5.0),))
    ways = WaysAround(floor, np.zeros(2), 0.2, np.array([[-3.0, -3.0], [5.0, 7.0]]))
    via = ways.to(np.array([2.0, 0.0]))
    assert via is not None
    points = np.array([[0, 0], *via, [2, 0]])
    assert all(floor.line_clearance(a, b[None])[0] > 0.18 for a, b in pairwise(points))
    length = np.linalg.norm(np.diff(points, axis=0), axis=1).sum()
    assert 2 * math.hypot(1.0, 1.0) < length < 2.8 * math.hypot(1.0, 1.0)
    assert ways.to(np.array([0.5, 0.0])) == []
    assert ways.to(np.array([1.05, 0.0])) is None


def test_a_grid_becomes_rectangles_where_its_cells_are(tmp_path):
    """A PGM as ROS's map server writes it, turned and shifted; unknown cells are free."""
    cells = np.full((4, 6), 254, dtype=np.uint8)
    cells[0, 1:3] = cells[1, 1:3] = 0  # upper rows of the picture: large y
    cells[3, 5], cells[2, 0] = 0, 205
    (tmp_path / "room.pgm").write_bytes(b"P5\n6 4\n255\n" + cells.tobytes())
    (tmp_path / "room.yaml").write_text(
        "image: room.pgm\nresolution: 0.5\norigin: [1.0, 2.0, 0.0]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.2\n"
    )
    floor = load_map(tmp_path / "room.yaml")
    assert sorted(each.tolist() for each in floor.polygons) == [
        box(1.5, 2.5, 3.0, 4.0).tolist(),
        box(3.5, 4.0, 2.0, 2.5).tolist(),
    ]
    sizes = sorted((2 * each.row[1:4]).round(9).tolist() for each in floor.boxes())
    assert sizes == [[0.5, 0.5, 2.0], [1.0, 1.0, 2.0]]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("image: room.png\n", "resolution: is missing; a map without scale"),
        ("image: room.png\nresolution: 0\n", "resolution"),
        ("image: none.png\nresolution: 0.05\n", "image: .*none.png cannot be read"),
        ("walls: []\n", "is no map: expected 'polygons'"),
        ("polygons: [[[0, 0], [1, 1]]]\n", "polygons"),
        ("polygons: [[[0, 0], [1, 1], [2, 2]]]\n", r"polygons\[0\]: has no area"),
        (
            "polygons: [[[0, 0], [2, 2], [2, 0], [0, 1]]]\n",
            r"polygons\[0\]: crosses itself: the sides from corner 1 and from corner 3",
        ),
        (
            "polygons: [[[0, 0], [4, 0], [4, 1], [1, -1], [0, 3]]]\n",
            r"polygons\[0\]: crosses itself: the sides from corner 1 and from corner 3",
        ),
    ],
)
def test_bad_maps(tmp_path, text, message):
    (tmp_path / "room.yaml").write_text(text)
    with pytest.raises(FileFormatError, match=message):
        load_map(tmp_path / "room.yaml")


@pytest.mark.parametrize("turned", [1, -1])
def test_polygons_with_dents_and_slits_do_not_cross_themselves(turned):
    star = [[0, 0], [4, 0], [2, 1], [4, 2], [0, 2]]
    slit = [[0, 0], [4, 0], [4, 4], [0, 4], [0, 0], [1, 1], [1, 2], [2, 2], [2, 1], [1, 1]]  # round a hole
    FloorMap([np.array(each, dtype=float)[::turned] for each in (star, slit)])


def test_in_a_spec(tmp_path):
    """The reference plans around the map, the law keeps its columns out as constraints."""
    (tmp_path / "room.yaml").write_text("polygons: [[[0.9, -0.2], [1.2, -0.2], [1.2, 0.2], [0.9, 0.2]]]\n")
    spec = {
        "name": "room",
        "robot": "little-john",
        "start": HOME.tolist(),
        "reference": {
            "kind": "drive-to",
            "offset": {"translation": [2.0, 0.1, 0.0]},
            "acceleration": 2.0,
            "clear_of": ["room"],
        },
        "period": 0.05,
        "law": {"kind": "guided-proportional", "gain": 1.0},
        "constraints": {
            "self_collision": False,
            "clear_of": {"room": {"links": ["chassis", "hand"]}},
        },
        "world": {"room": {"map": str(tmp_path / "room.yaml")}},
        "plant": {"kind": "integrator"},
    }
    run = dqc.run(spec)
    assert run.error[-1] < 1e-3
    assert run.record.readings["constraint_distance"].values.min() > 0.01
    floor = load_map(tmp_path / "room.yaml")
    assert room_of(floor, ROBOT, run.record.q[::10]) > 0

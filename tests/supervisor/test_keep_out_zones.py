"""Zones that a mobile base keeps out of: judged by its way between samples, against distances by another program."""

import re

import numpy as np
import pytest
import yaml

import dqcontrol as dqc
from dqcontrol.errors import Error, ShapeError, ValueRangeError
from dqcontrol.geometry import FloorMap
from dqcontrol.supervisor import KeepOutZones, Supervisor
from dqcontrol.supervisor.interventions import IMPOSSIBLE, KEEP_OUT
from dqcontrol.supervisor.supervisor_layout import END, FINISH, GO, RESET, STOP
from dqcontrol.supervisor.supervisor_step import clearance
from dqcontrol.world import Body, Solid

T = 0.02
BASES = {
    "differential": dqc.DifferentialDrive(0.05, 0.15, rim_speed=0.8),
    "holonomic": dqc.HolonomicBase(speed=0.8, turn_rate=2.0),
    "mecanum": dqc.MecanumBase(wheel_radius=0.05, half_track=0.15, half_wheelbase=0.24, rim_speed=0.8),
    "car-like": dqc.CarLikeBase(0.05, 0.15, wheelbase=0.4, steering_limit=0.6, rim_speed=0.8),
}
WALL = [(1.2, -3.0), (1.6, -3.0), (1.6, 3.0), (1.2, 3.0)]
NOTCH = [(-3.0, 1.0), (3.0, 1.0), (3.0, 2.0), (0.2, 2.0), (0.2, 1.4), (-3.0, 1.4)]
COLUMN, RADIUS = (-0.9, -0.5), 0.25
WORLD = dqc.World(
    bodies={
        "floor": Body(plane=(0, 0, 1)),
        "wall": Body(box=[0.4, 6.0, 1.0], position=(1.4, 0.0, 0.5)),
        "notch": Body(
            box=[6.0, 0.4, 1.0],
            position=(0.0, 1.2, 0.5),
            parts=[Solid(box=[2.8, 0.6, 1.0], position=(1.6, 0.5, 0.0))],
        ),
        "column": Body(cylinder=(RADIUS, 1.0), position=(*COLUMN, 0.5)),
    }
)
KEEP = KeepOutZones(world=WORLD, footprint=0.25, margin=0.03)


def body(kind):
    base = BASES[kind.removesuffix(" unconstrained")]
    return dqc.WholeBody([base], form="unconstrained" if kind.endswith("unconstrained") else "constrained")


def distance(points):
    """Return how far points (N, 2) are from all zones, as the floor map and a square root have it."""
    floor = FloorMap((np.array(WALL), np.array(NOTCH)))
    return np.minimum(floor.clearance(points), np.linalg.norm(points - COLUMN, axis=1) - RADIUS)


def test_distances_are_those_of_the_floor_map():
    points = np.random.default_rng(1).uniform(-3.5, 3.5, (2000, 2))
    rows = KEEP.rows()
    found = np.array([clearance(rows, x, y) for x, y in points])
    expected = distance(points)
    np.testing.assert_allclose(found[expected > 0], expected[expected > 0], rtol=1e-12)
    assert (found[expected < 0] < 0).all()
    assert (expected < 0).sum() > 100


def drive(robot, prepared, wanted, requests=()):
    """Return points of the way, four a period, and interventions of a base that does what it is told."""
    q = np.zeros(3)
    state, way, codes = prepared.start(q), [], []
    for k, each in enumerate(wanted):
        u = prepared.command(q, each, state, request=dict(requests).get(k, GO))
        u = robot.feasible_inputs(q, u) if robot.form == "unconstrained" else u
        driven = robot.in_form("constrained")
        way += [driven.integrate(q, u, share * T)[:2] for share in np.linspace(0.25, 1.0, 4)]
        q = driven.integrate(q, u, T)
        codes.append(prepared.code(state))
    return np.array(way), np.array(codes)


QUICK = (("differential", 20.0), ("car-like", None))


@pytest.mark.parametrize(
    ("kind", "jerk"),
    [
        pytest.param(kind, jerk, marks=() if (kind, jerk) in QUICK else pytest.mark.slow)
        for kind in (*BASES, "differential unconstrained")
        for jerk in (None, 20.0)
    ],
)
def test_whatever_is_wanted_no_base_enters_a_zone(kind, jerk):
    robot, rng = body(kind), np.random.default_rng(2017)
    given = Supervisor(acceleration=1.0, jerk=jerk, ramp=0.1, slow_below=0.0, hold_below=0.0, keep_out=KEEP)
    prepared, kept, came_near = given.prepare(robot, T), 0.28, 0
    for _ in range(3):
        wanted = np.repeat(rng.uniform(-2, 2, (6, robot.input_size)), 60, axis=0)
        wanted[:, -1] *= rng.choice([0.1, 1.0])
        stops = [(150, rng.choice([STOP, FINISH, END])), (250, RESET)]
        way, codes = drive(robot, prepared, wanted, stops)
        assert distance(way).min() > kept - 1e-9
        # Rims of a drive whose rates it cannot all follow give way to a turn alone, those on rollers to a smoothed one.
        if robot.form == "constrained" and not (len(robot.rollers) and jerk):
            assert not (codes & IMPOSSIBLE).any()
        came_near += distance(way).min() < kept + 0.02
        assert bool((codes & KEEP_OUT).any()) or distance(way).min() > kept
    assert came_near


def test_a_base_brakes_as_late_as_it_may_and_drives_away_again():
    robot = body("differential")
    prepared = Supervisor(acceleration=1.0, ramp=0.0, slow_below=0.0, hold_below=0.0, keep_out=KEEP).prepare(
        robot, T
    )
    wanted = np.repeat([[0.8, 0.0], [-0.5, 0.0]], [150, 60], axis=0)
    way, codes = drive(robot, prepared, wanted)
    assert 0.0 <= 1.2 - 0.28 - way[:, 0].max() < 0.002
    assert "keep-out zone" in prepared.reasons(np.array(prepared.start(np.zeros(3)) * 0 + KEEP_OUT))
    begun = int(np.flatnonzero(codes & KEEP_OUT)[0])
    speed = np.diff(way[::4, 0]) / T
    assert speed[begun - 2] == pytest.approx(0.8)
    room = 1.2 - 0.28 - way[4 * begun - 1, 0]
    assert room < 0.8**2 / 2 + 2 * 0.8 * T  # braked at 1 m/s², and no earlier than two periods
    assert way[-1, 0] < 0.5
    assert not (codes[150:] & KEEP_OUT)[3:].any()


def test_zones_far_away_leave_every_bit():
    robot, rng = dqc.load_robot("little-john"), np.random.default_rng(3)
    q = np.array([0, 0, 0, 0, -0.9, 0.9, 0.9, 0])
    far = KeepOutZones(world=dqc.World(bodies={"far": Body(sphere=1.0, position=(50, 50, 0))}), footprint=0.2)
    free, bound = (Supervisor(keep_out=each).prepare(robot, T) for each in (None, far))
    states = free.start(q), bound.start(q)
    for _ in range(60):
        wanted = rng.uniform(-1, 1, 7)
        u = free.command(q, wanted, states[0])
        assert u.tobytes() == bound.command(q, wanted, states[1]).tobytes()
        q = robot.integrate(q, u, T)
    assert states[0].tobytes() == states[1].tobytes()


def test_a_base_that_a_localisation_moves_into_a_zone_stands_and_may_leave():
    robot = body("holonomic")
    prepared = Supervisor(ramp=0.0, slow_below=0.0, hold_below=0.0, base_jump=1.0, keep_out=KEEP).prepare(
        robot, T
    )
    state, inside = prepared.start([0.8, 0, 0]), np.array([1.0, 0, 0])
    assert prepared.command(inside, np.array([0.5, 0, 0]), state)[0] == 0.0
    assert "keep-out zone" in prepared.reasons(state)
    away = prepared.command(inside, np.array([-0.5, 0, 0]), state)
    assert away[0] < 0.0
    assert not prepared.is_stopped(state)


def test_an_arm_s_base_is_braked_in_the_run_of_a_spec(tmp_path):
    """The hand is asked beyond a wall of a map beside the spec: the base stops before it, and the record says why."""
    (tmp_path / "room.yaml").write_text(
        "polygons: [[[0.5, -2], [0.7, -2], [0.7, 2], [0.5, 2]], [[0.5, -2], [2, -2], [2, -2.2]]]"
    )
    spec = {
        "name": "wall",
        "robot": "little-john",
        "start": [0, 0, 0, 0, -0.9, 0.9, 0.9, 0],
        "period": T,
        "duration": 6.0,
        "reference": {"kind": "set-point", "offset": {"translation": [1.5, 0.0, 0.0]}},
        "law": {"kind": "feedback-linearization", "stiffness": 2.0, "damping": 2.0},
        "plant": {"kind": "integrator"},
        "supervisor": {"acceleration": 1.0, "keep_out": {"footprint": 0.15}},
        "world": {"room": {"map": "room.yaml"}},
    }
    (tmp_path / "spec.yaml").write_text(yaml.safe_dump(spec))
    record = dqc.run(tmp_path / "spec.yaml").record
    assert record.q[:, 0].max() <= 0.5 - 0.2 + 1e-9
    assert record.q[:, 0].max() > 0.25
    assert (record.readings["interventions"].values.astype(int) & KEEP_OUT).any()


@pytest.mark.parametrize(
    ("robot", "given", "error", "why"),
    [
        (
            "iiwa7",
            {},
            ShapeError,
            "supervisor.keep_out: is for robots whose first part is their only mobile base; iiwa7 is not",
        ),
        (
            "little-john",
            {"footprint": -1.0},
            ValueRangeError,
            "supervisor.keep_out.footprint: must be > 0, got -1",
        ),
        ("little-john", {"margin": -1.0}, ValueRangeError, "supervisor.keep_out.margin: must be ≥ 0, got -1"),
        (
            "little-john",
            {"clear_of": ["wal"]},
            Error,
            "supervisor.keep_out.clear_of: unknown name 'wal'; did you mean 'wall'",
        ),
        ("little-john", {"clear_of": ["floor"]}, ValueRangeError, "'floor' takes no place on the floor"),
        ("little-john", {"world": None}, ShapeError, "there is none; give 'world'"),
    ],
)
def test_what_is_wrong_is_said_in_a_line(robot, given, error, why):
    def prepare():
        zones = KeepOutZones(**{"world": WORLD, "footprint": 0.2, **given})
        Supervisor(keep_out=zones).prepare(dqc.load_robot(robot), T)

    with pytest.raises(error, match=re.escape(why)):
        prepare()


def test_a_base_without_shapes_needs_a_radius():
    cart = dqc.WholeBody([dqc.HolonomicBase(speed=0.5, turn_rate=1.0)], name="cart")
    with pytest.raises(ValueRangeError, match=r"keep_out.footprint: the base of cart has no shapes; give"):
        Supervisor(keep_out=KeepOutZones(world=WORLD)).prepare(cart, T)


def test_a_start_in_a_zone_is_refused():
    prepared = Supervisor(keep_out=KEEP).prepare(body("differential"), T)
    with pytest.raises(ValueRangeError, match=r"the base starts at \(1.3, 0\) m, -0.1 m from a zone"):
        prepared.start([1.3, 0, 0])

"""Parts of the supervisor on their own: polygons, braking of bases, returns, stops, what it was prepared with."""

import re

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol import algebra
from dqcontrol.contact import Tool
from dqcontrol.errors import Error, ShapeError, ValueRangeError
from dqcontrol.geometry import FloorMap
from dqcontrol.supervisor import KeepOutZones, LinkPoint, Supervisor, WorkspaceBox
from dqcontrol.supervisor.supervisor import _edges
from dqcontrol.supervisor.supervisor_layout import (
    BOX,
    HEAD,
    PAYLOAD_CENTER,
    PAYLOAD_WEIGHT,
    RESET,
    SENSOR_BIAS,
    STOP,
    state_layout,
    taken_apart,
)
from dqcontrol.supervisor.supervisor_step import _braking_shares, _keep_rims, clearance
from dqcontrol.world import Body

T = 0.01
FREE = {"slow_below": 0.0, "hold_below": 0.0, "ramp": 0.0}
LOOSE = FREE | {"tracking_error": 1e9, "jump": 1e9, "overspeed": 1e9, "frozen_after": 1e9}
ARM = dqc.load_robot("iiwa7")
Q0 = np.array([0.3, 0.6, -0.2, 1.6, 0.4, 0.6, 0.1])
DRIVE = dqc.WholeBody([dqc.DifferentialDrive(0.05, 0.15, rim_speed=0.8)])
CAR = dqc.WholeBody([dqc.CarLikeBase(0.05, 0.15, wheelbase=0.4, steering_limit=0.6, rim_speed=0.8)])
MECANUM = dqc.WholeBody(
    [dqc.MecanumBase(wheel_radius=0.05, half_track=0.15, half_wheelbase=0.24, rim_speed=0.8)]
)
WALL = dqc.World(bodies={"wall": Body(box=[0.4, 60.0, 1.0], position=(5.2, 0.0, 0.5))})  # from x = 5 on
KEEP = KeepOutZones(world=WALL, footprint=0.25, margin=0.03)
NEAREST = 5.0 - 0.28


def test_points_level_with_corners_are_in_a_polygon_or_not():
    """A diamond and, beside it, a triangle: what is level with two corners or one is counted once."""
    diamond = [(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)]
    triangle = [(3.0, 0.0), (4.0, -1.0), (4.0, 1.0)]
    rows = _edges(FloorMap((np.array(diamond), np.array(triangle))))
    side = np.sqrt(0.5)
    for (x, y), expected in {
        (0.0, 0.0): -side,
        (0.5, 0.0): -side / 2,
        (-0.5, 0.0): -side / 2,
        (2.0, 0.0): 1.0,
        (-2.0, 0.0): 1.0,
        (-3.0, 1.0): np.sqrt(5.0),
        (-3.0, -1.0): np.sqrt(5.0),
        (0.5, 1.0): np.sqrt(0.125),
        (3.5, 0.0): -side / 2,
        (3.9, 0.0): -0.1,
        (4.5, 0.0): 0.5,
        (4.5, 1.0): 0.5,
        (3.0, 1.0): side,
        (3.0, -1.0): side,
    }.items():
        assert clearance(rows, x, y) == pytest.approx(expected), (x, y)


@pytest.mark.parametrize(
    ("robot", "rate"),
    [(DRIVE, (0.5, 0.1)), (DRIVE, (0.1, 0.5)), *((MECANUM, np.roll([0.5, 0.1, 0.1], k)) for k in range(3))],
)
def test_a_base_brakes_all_its_inputs_by_the_share_of_the_one_that_takes_longest(robot, rate):
    prepared = Supervisor(acceleration=1.0, keep_out=KEEP, **FREE).prepare(robot, T)
    shares = np.zeros(len(rate))
    _braking_shares(prepared.bounds, np.array(rate), shares)
    assert shares == pytest.approx(T / 0.5)


@pytest.mark.parametrize(
    ("room", "share"), [(0.9, 0.5), (0.24, 0.125), (0.13, 0.125), (0.12, 0.0625), (0.06, 0.0)]
)
def test_a_base_near_a_zone_takes_the_half_the_quarter_down_to_the_first_share_below_a_tenth(room, share):
    """From rest it may reach 1 m/s² T, and stands again a period later; ``room`` is in what it moves meanwhile."""
    robot = dqc.WholeBody([dqc.HolonomicBase(speed=0.8, turn_rate=2.0)])
    prepared = Supervisor(acceleration=1.0, keep_out=KEEP, **FREE).prepare(robot, T)
    q = np.array([NEAREST - room * T * T, 0.0, 0.0])
    state = prepared.start(q)
    prepared.command(q, np.array([0.8, 0.0, 0.0]), state)
    assert prepared.rate(state)[0] == pytest.approx(share * T, abs=1e-12)


@pytest.mark.parametrize(
    ("robot", "wanted"), [(MECANUM, (0.5, 0.0, 0.6)), (CAR, (0.5, 0.2)), (DRIVE, (0.5, 0.2))]
)
def test_a_base_that_is_braked_for_a_zone_keeps_its_way(robot, wanted):
    """All inputs are mixed with braking by one share: so v and ω keep their ratio."""
    prepared = Supervisor(acceleration=1.0, keep_out=KEEP, **LOOSE).prepare(robot, T)
    q = np.array([NEAREST - 0.3, 0.0, 0.0])
    state = prepared.start(q)
    told, ratios = 0, []
    for _ in range(200):
        now = state_layout(state, 3, robot.input_size).rate.copy()
        u = prepared.command(q, np.array(wanted), state)
        if "keep-out zone" in prepared.reasons(state) and now[0] > 0.1:
            told += 1
            ratios.append(u[-1] / u[0])
        q = robot.integrate(q, u, T)
    assert told > 5
    assert ratios == pytest.approx([wanted[-1] / wanted[0]] * told, rel=0.2)
    assert abs(u).max() < 1e-2


def test_rims_on_rollers_are_braked_along_the_way_of_what_takes_longest():
    """Rates beyond a rim's limit are mixed with those that one share of braking leaves."""
    prepared = Supervisor(acceleration=[2.0, 2.0, 1.0], keep_out=KEEP, **FREE).prepare(MECANUM, T)
    state = prepared.start(np.zeros(3))
    memory = state_layout(state, 3, 3)
    memory.rate[:] = 0.1, 0.05, 1.2
    rates = np.array([0.5, 0.2, 1.5])
    _keep_rims(prepared.bounds, memory, rates)
    slowest = (1 - T * 1.0 / 1.2) * memory.rate  # ω takes longest
    share = (rates - slowest) / (np.array([0.5, 0.2, 1.5]) - slowest)
    assert share == pytest.approx([share[0]] * 3)
    assert 0 < share[0] < 1


def test_a_return_to_the_measured_joints_is_not_held_near_a_singularity():
    """The law is off meanwhile; and who was stopped near one may want to leave."""
    straight = np.array([0.3, 0.6, -0.2, 0.03, 0.4, 0.6, 0.1])
    prepared = Supervisor(
        acceleration=1.0, ramp=0.0, slow_below=0.1, hold_below=0.05, tracking_error=0.03
    ).prepare(ARM, T)
    state = prepared.start(straight)
    prepared.command(straight, np.zeros(7), state, request=STOP)
    for _ in range(5):
        prepared.command(straight, np.zeros(7), state)
    assert prepared.is_stopped(state)
    beside = straight - 0.02 * np.eye(7)[3]  # straighter still
    prepared.command(beside, np.zeros(7), state, request=RESET)
    told = set(prepared.reasons(state))
    for _ in range(200):
        prepared.command(beside, np.zeros(7), state)
        told |= set(prepared.reasons(state))
    assert "command returns to the measured joints" in told
    assert not any("singularity" in reason for reason in told)
    assert (
        abs(prepared.position(state) - beside).max() <= 0.015
    )  # half of the tracking error: the law may go on


def test_a_stop_brakes_as_fast_as_joints_can_whatever_hands_are_to_keep():
    prepared = Supervisor(acceleration=2.0, hand_acceleration=0.1, **LOOSE).prepare(ARM, T)
    state = prepared.start(Q0)
    q = Q0.copy()
    for _ in range(200):
        q = q + T * prepared.command(q, 0.3 * np.eye(7)[0], state)
    fastest = prepared.rate(state)[0]
    assert fastest > 0.1
    prepared.command(q, 0.3 * np.eye(7)[0], state, request=STOP)
    assert prepared.rate(state)[0] == pytest.approx(fastest - 2.0 * T)


@pytest.mark.parametrize("task", ["left", "absolute"])
def test_the_first_step_of_each_hand_is_from_where_it_stands(task):
    arms = dqc.load_robot("two-pandas").with_task(task)
    q = np.array([-0.1, -0.5, 0.1, -2.2, 0.1, 1.7, 0.8, 0.3, -0.7, -0.2, -2.1, -0.1, 1.5, 0.7])
    prepared = Supervisor(acceleration=9.0, hand_acceleration=5.0, **LOOSE).prepare(arms, T)
    state = prepared.start(q)
    prepared.command(q, np.full(14, 1e-4), state)
    assert prepared.reasons(state) == ()


def test_box_payload_and_bias_are_kept_beside_each_other():
    tool = Tool(mass=2.0, center=(0.1, 0.2, 0.3), force_bias=(1.0, 2.0, 3.0), torque_bias=(4.0, 5.0, 6.0))
    box = WorkspaceBox(lower=(-1.0, -2.0, -3.0), upper=(4.0, 5.0, 6.0))
    head = Supervisor(payload=tool, workspace=box).prepare(ARM, T).bounds.head
    assert len(head) == HEAD
    assert head[PAYLOAD_WEIGHT] == 9.81 * 2.0
    assert head[BOX : BOX + 6].tolist() == [-1.0, -2.0, -3.0, 4.0, 5.0, 6.0]
    assert head[PAYLOAD_CENTER : PAYLOAD_CENTER + 3].tolist() == [0.1, 0.2, 0.3]
    assert head[SENSOR_BIAS : SENSOR_BIAS + 6].tolist() == [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
    parts = taken_apart(*_started(payload=tool, workspace=box))
    assert parts.scratch.frames.shape == (8 * 8,)  # of seven joints and the end effector


def _started(**given):
    prepared = Supervisor(**given).prepare(ARM, T)
    return prepared.memory, prepared.start(Q0)


def test_a_base_that_steers_takes_no_more_acceleration_than_its_sharpest_curve_does():
    """ω = v over the turning radius there: so v's acceleration is at most that of ω times the radius."""
    radius = 0.4 / np.tan(0.6)
    for turning, expected in ((1.0, radius), (10.0, 2.0)):
        prepared = Supervisor(acceleration=[2.0, turning], **FREE).prepare(CAR, T)
        assert prepared.bounds.acceleration == pytest.approx([expected, turning])
    prepared = Supervisor(acceleration=[2.0, 0.1], **FREE).prepare(DRIVE, T)
    assert prepared.bounds.acceleration == pytest.approx([2.0, 0.1])


def test_where_it_would_start_outside_its_box_is_said_with_the_box():
    hand = algebra.translation(ARM.fkm(Q0))
    box = WorkspaceBox(lower=(-1.0, -2.0, -3.0), upper=(-0.5, 2.5, 3.5))
    why = f"starts at {hand.round(4)}, or a point of its links, outside [-1. -2. -3.] … [-0.5  2.5  3.5] m"
    with pytest.raises(ValueRangeError, match=re.escape(why)):
        Supervisor(workspace=box).prepare(ARM, T).start(Q0)


@pytest.mark.parametrize("field", ["velocity", "acceleration", "jerk", "tracking_error", "effort"])
@pytest.mark.parametrize("wrong", [0.0, -0.5])
def test_each_of_several_bounds_is_above_zero(field, wrong):
    with pytest.raises(Error, match=rf"{field}\[3\]: must be > 0, got {wrong:g}"):
        Supervisor(**{field: [1.0, 1.0, 1.0, wrong, 1.0, 1.0, 1.0]})


def test_a_margin_may_leave_a_joint_one_place():
    arm = dqc.SerialArm.from_dh(
        [0],
        [0],
        [0.3],
        [0],
        name="one",
        limits=dqc.robots.Limits(*(np.array([each]) for each in (-1.0, 1.0, 1.0, 9.0))),
    )
    prepared = Supervisor(position_margin=1.0, **FREE).prepare(arm, T)
    assert (prepared.bounds.lower[0], prepared.bounds.upper[0]) == (0.0, 0.0)
    with pytest.raises(ValueRangeError, match=r"position_margin: 1\.001 leaves"):
        Supervisor(position_margin=1.001, **FREE).prepare(arm, T)


def test_a_tree_that_drives_one_hand_may_bound_its_contact_force():
    arms = dqc.load_robot("two-pandas")
    assert Supervisor(contact_force=10.0).prepare(arms.with_task("left"), T).watches_wrench
    with pytest.raises(ValueRangeError, match="contact_force: is of one end effector"):
        Supervisor(contact_force=10.0).prepare(arms.with_task("relative"), T)


def test_zones_are_for_one_base_before_all_else():
    two = dqc.WholeBody([dqc.DifferentialDrive(0.05, 0.15, rim_speed=0.8)] * 2)
    for robot in (two, ARM):
        with pytest.raises(ShapeError, match="whose first part is their only mobile base"):
            Supervisor(keep_out=KEEP, velocity=1.0).prepare(robot, T)


def test_points_of_a_box_are_of_the_joints_named():
    names = ARM.joint_names
    points = [LinkPoint(joint=names[2], offset=(0.1, 0.2, 0.3)), LinkPoint(joint=names[5])]
    box = WorkspaceBox(lower=(-9.0, -9.0, -9.0), upper=(9.0, 9.0, 9.0), points=points)
    prepared = Supervisor(workspace=box).prepare(ARM, T)
    assert prepared.bounds.points.tolist() == [[2.0, 0.1, 0.2, 0.3], [5.0, 0.0, 0.0, 0.0]]


@pytest.mark.parametrize(
    ("field", "default", "least", "is_allowed_there"),
    [
        ("position_margin", 0.0, 0.0, True),
        ("slow_below", 0.04, 0.0, True),
        ("hold_below", 0.02, 0.0, True),
        ("ramp", 0.5, 0.0, True),
        ("measured_tolerance", 0.05, 0.0, True),
        ("jump", 0.05, 0.0, True),
        ("base_jump", 0.2, 0.0, True),
        ("acceleration", 10.0, 0.0, False),
        ("tracking_error", 0.3, 0.0, False),
        ("overspeed", 1.5, 0.0, False),
        ("frozen_after", 0.1, 0.0, False),
        ("velocity", None, 0.0, False),
        ("jerk", None, 0.0, False),
        ("stale_after", None, 0.0, False),
        ("hand_speed", None, 0.0, False),
        ("hand_acceleration", None, 0.0, False),
        ("effort", None, 0.0, False),
        ("contact_force", None, 0.0, False),
        ("contact_torque", None, 0.0, False),
        ("contact_effort", None, 0.0, False),
    ],
)
def test_defaults_and_bounds_are_those_of_the_page(field, default, least, is_allowed_there):
    assert getattr(Supervisor(), field) == default
    for value, is_allowed in ((least + 1e-9, True), (least, is_allowed_there), (least - 1e-9, False)):
        if is_allowed:
            assert getattr(Supervisor(**{field: value}), field) == value
        else:
            with pytest.raises(ValueRangeError, match=rf"{field}: must be "):
                Supervisor(**{field: value})


def test_defaults_and_bounds_of_zones_points_and_ramps():
    assert (KEEP.clear_of, KeepOutZones(world=WALL).margin, KeepOutZones(world=WALL).footprint) == (
        "all",
        0.05,
        None,
    )
    assert LinkPoint(joint="elbow").offset == (0.0, 0.0, 0.0)
    assert KeepOutZones(world=WALL, clear_of=["wall"], footprint=1e-9, margin=0.0).clear_of == ["wall"]
    for wrong in ({"clear_of": []}, {"footprint": 0.0}, {"margin": -1e-9}):
        with pytest.raises(Error, match=next(iter(wrong))):
            KeepOutZones(**{"world": WALL, **wrong})
    assert Supervisor(ramp=60.0).ramp == 60.0
    with pytest.raises(ValueRangeError, match="ramp"):
        Supervisor(ramp=60.001)

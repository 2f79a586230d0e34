"""Parts of the supervisor on their own: polygons, braking of bases, returns, stops, what it was prepared with."""

import re

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol import algebra
from dqcontrol.contact import Tool
from dqcontrol.errors import Error, ShapeError, ValueRangeError
from dqcontrol.geometry import FloorMap
from dqcontrol.references.ways_around import body_points
from dqcontrol.supervisor import KeepOutZones, LinkPoint, Supervisor, WorkspaceBox
from dqcontrol.supervisor.interventions import REASONS, list_interventions, stop_category
from dqcontrol.supervisor.supervisor import _edges
from dqcontrol.supervisor.supervisor_layout import (
    BAD,
    BOX,
    GO,
    HAND_ACCELERATION_LIMIT,
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
    """A rhombus and, beside it, a triangle: what is level with two corners or one is counted once."""
    rhombus = [(1.0, 0.0), (0.0, 3.0), (-1.0, 0.0), (0.0, -3.0)]
    triangle = [(3.0, 0.0), (4.0, -1.0), (4.0, 1.0)]
    rows = _edges(FloorMap((np.array(rhombus), np.array(triangle))))
    steep, side = np.sqrt(0.1), np.sqrt(0.5)
    for (x, y), expected in {
        (0.0, 0.0): -3 * steep,
        (0.5, 0.0): -1.5 * steep,
        (-0.5, 0.0): -1.5 * steep,
        (0.5, 1.0): -0.5 * steep,
        (-0.6, -1.1): -0.1 * steep,
        (0.6, 1.5): 0.3 * steep,
        (-0.4, 2.0): 0.2 * steep,
        (2.0, 0.0): 1.0,
        (-2.0, 0.0): 1.0,
        (-3.0, 1.0): 7 * steep,
        (-3.0, -1.0): 7 * steep,
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


def test_rims_on_rollers_beyond_what_braking_keeps_are_braked_in_full():
    prepared = Supervisor(acceleration=1.0, keep_out=KEEP, **FREE).prepare(MECANUM, T)
    memory = state_layout(prepared.start(np.zeros(3)), 3, 3)
    memory.rate[:] = 0.7, 0.1, 1.5  # as after a limit fell
    rates = memory.rate.copy()
    _keep_rims(prepared.bounds, memory, rates)
    assert rates == pytest.approx((1 - T * 1.0 / 1.5) * memory.rate)


def test_a_return_brings_in_what_started_beyond_its_limit():
    prepared = Supervisor(acceleration=1e3, **FREE | {"tracking_error": 0.03}).prepare(ARM, T)
    q = Q0.copy()
    q[6] = ARM.limits.upper[6] + 0.008
    state = prepared.start(q)
    prepared.command(q, np.zeros(7), state, request=STOP)
    for _ in range(3):
        prepared.command(q, np.zeros(7), state)
    assert prepared.rate(state)[6] == 0.0
    q[0] += 0.02
    prepared.command(q, np.zeros(7), state, request=RESET)
    while "command returns to the measured joints" not in prepared.reasons(state):
        prepared.command(q, np.zeros(7), state)
    assert prepared.position(state)[6] == pytest.approx(ARM.limits.upper[6], abs=1e-9)


def test_measured_speed_after_a_silence_is_that_of_the_way_since():
    prepared = Supervisor(acceleration=1e3, **LOOSE).prepare(ARM, T)
    state = prepared.start(Q0)
    for _ in range(9):
        prepared.command(Q0, np.zeros(7), state, age=1.0)
        state_layout(state, 7, 7).numbers[BAD] = 0.0
    prepared.command(Q0 + 0.01, np.zeros(7), state)
    assert state_layout(state, 7, 7).speed == pytest.approx(0.01 / (10 * T))


def test_joints_behind_a_base_are_watched_and_the_base_needs_no_target():
    robot = dqc.load_robot("little-john")
    q = np.array([0.0, 0.0, np.pi / 2, 0.0, -0.9, 0.9, 0.9, 0.0])
    prepared = Supervisor(acceleration=5.0, jump=9.0, overspeed=99.0, **FREE).prepare(robot, T)
    state, wanted = prepared.start(q), np.zeros(robot.input_size)
    wanted[0] = 0.3
    for _ in range(300):  # 0.9 m along y: x is where it was
        q = robot.integrate(q, prepared.command(q, wanted, state), T)
        assert prepared.reasons(state) in ((), ("acceleration limit",))
    assert q[1] > 0.8
    q[6] = robot.limits.upper[6] + 0.2
    prepared.command(q, np.zeros(robot.input_size), state)
    assert "measured joint beyond its limits" in prepared.reasons(state)


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


def test_stops_brake_and_leave_the_power_on_only_where_what_is_measured_can_be_trusted():
    """Category 2 holds under power: a wanted stop, a bad command, a program that is late; all else is category 1."""
    held = {"command not finite", "soft stop", "gap in time", "periods too long", "clock stands still"}
    codes = {text: bit for bit, text in REASONS.items()}
    assert {text for text, bit in codes.items() if stop_category(bit) == 2} == held
    assert {stop_category(bit) for text, bit in codes.items() if text not in held} == {None, 1}
    assert sorted(REASONS) == [2**i for i in range(27)], "they add up"


def test_interventions_are_told_bit_by_bit_from_their_first_sample_to_their_last():
    codes = {text: bit for bit, text in REASONS.items()}
    stop, box = codes["emergency stop"], codes["workspace box"]
    found = list_interventions([0.0, 0.1, 0.2, 0.3, 0.4], [box, stop + box, stop, 0.0, box])
    assert found == [
        (0.0, 0.1, "workspace box"),
        (0.1, 0.2, "emergency stop"),
        (0.4, 0.4, "workspace box"),
    ]


@pytest.mark.parametrize("field", ["effort", "contact_effort", "contact_force", "contact_torque"])
def test_what_is_watched_is_what_is_bounded(field):
    prepared = Supervisor(**{field: 5.0}).prepare(ARM, T)
    assert prepared.watches_effort is (field in ("effort", "contact_effort"))
    assert prepared.watches_wrench is (field in ("contact_force", "contact_torque"))


def test_a_payload_is_one_that_weighs_or_whose_sensor_has_a_bias_in_any_direction():
    assert not Supervisor(payload=Tool()).prepare(ARM, T).carries_payload
    assert Supervisor(payload=Tool(mass=0.1)).prepare(ARM, T).carries_payload
    for k in range(6):
        bias = np.eye(6)[k].tolist()
        tool = Tool(force_bias=tuple(bias[:3]), torque_bias=tuple(bias[3:]))
        assert Supervisor(payload=tool).prepare(ARM, T).carries_payload


def test_limits_alone_watch_nothing():
    alone = Supervisor(ramp=0.3, hand_speed=0.1, effort=5.0, velocity=0.7, acceleration=3.0).limits_alone()
    assert (alone.ramp, alone.slow_below, alone.hold_below) == (0.0, 0.0, 0.0)
    assert (alone.velocity, alone.acceleration, alone.hand_speed, alone.effort) == (0.7, 3.0, None, None)
    assert (alone.tracking_error, alone.jump, alone.frozen_after) == (1e9, 1e9, 1e9)


def test_a_jerk_beyond_all_needs_no_window():
    for jerk, window in ((1e14, 1), (2 * 10.0 / T, 1), (2 * 10.0 / (1.5 * T), 2)):
        assert Supervisor(jerk=jerk).prepare(ARM, T).window == window


@pytest.mark.parametrize(("name", "least", "most"), [("little-john", 0.165, 0.245), ("youbot", 0.25, 0.45)])
def test_the_footprint_is_that_of_the_shapes_of_the_base(name, least, most):
    """Little John's chassis: a cylinder of 0.165 m, 0.03 m ahead of the wheels' axis; youBot's is 0.58 m × 0.38 m."""
    robot = dqc.load_robot(name)
    body = body_points(robot, np.zeros(robot.configuration_size))
    parts = zip(body.points, body.radius, body.carried, strict=True)
    reach = [np.hypot(x, y) + radius for (x, y, _), radius, is_carried in parts if not is_carried]
    found = KeepOutZones(world=WALL).footprint_of(robot)
    assert found == max(reach)
    assert least <= found <= most


TWO = dqc.WholeBody([dqc.CarLikeBase(0.05, 0.15, wheelbase=0.4, steering_limit=0.6, rim_speed=0.8),
                     dqc.CarLikeBase(0.05, 0.15, wheelbase=0.2, steering_limit=0.6, rim_speed=0.5)])  # fmt: skip


def test_each_of_two_bases_has_its_own_sharpest_curve():
    prepared = Supervisor(acceleration=[2.0, 1.0, 2.0, 1.5], **FREE).prepare(TWO, T)
    radii = np.array([0.4, 0.2]) / np.tan(0.6)
    assert prepared.bounds.acceleration == pytest.approx([radii[0], 1.0, 1.5 * radii[1], 1.5])


def test_both_inputs_of_each_of_two_bases_are_brought_within_reach_by_one_share():
    drives = dqc.WholeBody([dqc.DifferentialDrive(0.05, 0.15, rim_speed=0.8)] * 2)
    prepared = Supervisor(acceleration=1.0, **LOOSE).prepare(drives, T)
    state, wanted = prepared.start(np.zeros(6)), np.array([0.3, 0.1, 0.02, 0.4])
    prepared.command(np.zeros(6), wanted, state)
    assert prepared.rate(state) == pytest.approx(np.r_[wanted[:2] * T / 0.3, wanted[2:] * T / 0.4], abs=1e-12)


@pytest.mark.parametrize("slow", [0, 1])
@pytest.mark.parametrize("form", ["constrained", "unconstrained"])
def test_a_rim_beyond_a_limit_that_fell_is_told_of_its_own_base(slow, form):
    """The one that drives: whatever the other's limit is."""
    robot = dqc.WholeBody([dqc.DifferentialDrive(0.05, 0.15, rim_speed=0.8)] * 2, form=form)
    prepared = Supervisor(acceleration=1.0, **LOOSE).prepare(robot, T)
    size = robot.input_size // 2
    q, wanted = np.zeros(6), np.zeros(2 * size)
    wanted[size] = 0.5  # the second drives ahead
    state = prepared.start(q)
    for _ in range(80):
        prepared.command(q, wanted, state)
    assert prepared.reasons(state) == ()
    prepared.bounds.velocity[slow * size : (slow + 1) * size] = 0.2
    prepared.command(q, wanted, state)
    assert ("limits that cannot be kept together" in prepared.reasons(state)) == (slow == 1)


def test_the_box_of_an_arm_on_a_base_is_about_where_the_base_is():
    robot = dqc.load_robot("little-john")
    q = np.array([2.0, 1.0, 0.7, 0.0, -0.9, 0.9, 0.9, 0.0])
    hand = algebra.translation(robot.fkm(q))
    box = WorkspaceBox(lower=tuple(hand - 0.1), upper=tuple(hand + 0.1))
    prepared = Supervisor(workspace=box, acceleration=1.0, **LOOSE).prepare(robot, T)
    state, wanted = prepared.start(q), np.zeros(robot.input_size)
    wanted[0], wanted[3] = 0.3, -0.2  # the base is taken to stand where it is
    for _ in range(40):
        u = prepared.command(q, wanted, state)
        q = robot.integrate(q, u, T)
        assert "limits that cannot be kept together" not in prepared.reasons(state)
        if abs(algebra.translation(robot.fkm(q)) - hand).max() < 0.06:
            assert not {"workspace box"} & set(prepared.reasons(state))
    assert q[4] < -0.95


def test_a_base_that_cannot_stop_before_a_zone_says_so():
    robot = dqc.WholeBody([dqc.HolonomicBase(speed=0.8, turn_rate=2.0)])
    prepared = Supervisor(acceleration=1.0, keep_out=KEEP, **LOOSE).prepare(robot, T)
    q = np.array([NEAREST - 0.01, 0.0, 0.0])
    state = prepared.start(q)
    memory = state_layout(state, 3, 3)
    memory.rate[0] = memory.past[:, 0] = memory.sent_rate[0] = 0.5
    prepared.command(q, np.array([0.5, 0.0, 0.0]), state)
    assert prepared.reasons(state) == ("limits that cannot be kept together", "keep-out zone")
    far = prepared.start(np.zeros(3))
    prepared.command(np.zeros(3), np.array([0.005, 0.0, 0.0]), far)
    assert prepared.reasons(far) == ()


COLUMN = dqc.World(bodies={"column": Body(cylinder=(0.25, 1.0), position=(2.0, 1.0, 0.5))})


def test_a_single_disc_is_a_zone():
    robot = dqc.WholeBody([dqc.HolonomicBase(speed=0.8, turn_rate=2.0)])
    zones = KeepOutZones(world=COLUMN, footprint=0.25, margin=0.0)
    prepared = Supervisor(acceleration=1.0, keep_out=zones, **LOOSE).prepare(robot, T)
    for x, y, is_refused in ((2.0, 1.0, True), (2.0, 1.49, True), (2.0, 1.51, False), (1.0, 2.0, False)):
        if is_refused:
            with pytest.raises(ValueRangeError, match="nearer than its footprint"):
                prepared.start([x, y, 0.0])
        else:
            prepared.start([x, y, 0.0])
    q, way = np.array([2.0, -1.0, 1.0]), []
    state = prepared.start(q)
    for _ in range(500):
        q = robot.integrate(q, prepared.command(q, np.array([0.0, 0.5, 0.0]), state), T)
        way.append(q[1])
    assert max(way) < 0.5
    assert max(way) > 0.5 - 0.005


@pytest.mark.parametrize("command", [(0.15, 0.0), (0.18, 0.01)])
@pytest.mark.parametrize("acceleration", [1.0, 1e3])
def test_a_hand_that_moves_along_z_keeps_its_speed_too(command, acceleration):
    """Below its limit nothing is told, however long it takes to brake."""
    arm = dqc.SerialArm.from_dh([0, 0], [0, 0], [0, 0], [0, 0], ["prismatic"] * 2, name="lift")
    given = LOOSE | {"acceleration": acceleration, "velocity": 9.0, "hand_speed": 0.2}
    prepared = Supervisor(**given).prepare(arm, T)
    q = np.array([0.5, 0.4])
    state = prepared.start(q)
    for _ in range(40):
        u = prepared.command(q, np.array(command), state)
        q = q + T * u
        assert prepared.reasons(state) in ((), ("acceleration limit",))
    assert prepared.reasons(state) == ()
    assert u == pytest.approx(command)


def test_a_return_keeps_the_speed_of_the_hand():
    given = FREE | {"hand_speed": 0.05, "tracking_error": 0.2, "jump": 9.0, "overspeed": 99.0}
    prepared = Supervisor(acceleration=50.0, **given).prepare(ARM, T)
    state = prepared.start(Q0)
    prepared.command(Q0, np.zeros(7), state, request=STOP)
    for _ in range(3):
        prepared.command(Q0, np.zeros(7), state)
    away = Q0 + 0.19 * np.eye(7)[1]
    prepared.command(away, np.zeros(7), state, request=RESET)
    places = [ARM.fkm(prepared.position(state))]
    told = set()
    for _ in range(100):
        prepared.command(away, np.zeros(7), state)
        told |= set(prepared.reasons(state))
        places.append(ARM.fkm(prepared.position(state)))
    speed = np.linalg.norm(np.diff(algebra.translation(np.array(places)), axis=0), axis=1) / T
    assert "command returns to the measured joints" in told
    assert 0.049 < speed.max() < 0.0501


def test_a_reset_ends_a_hold():
    near, elbow = np.array([0.3, 0.6, -0.2, 0.0, 0.4, 0.6, 0.1]), np.eye(7)[3]
    prepared = Supervisor(acceleration=1e3, **LOOSE | {"slow_below": 0.1, "hold_below": 0.05}).prepare(ARM, T)
    bent = near + np.linspace(0.02, 1.0, 400)[:, None] * elbow
    values = np.linalg.svd(ARM.hand_jacobian(bent), compute_uv=False)[:, -1]
    held, slowed = (bent[int(np.argmin(np.abs(values - value)))] for value in (0.045, 0.065))
    state = prepared.start(held)
    for request, q, why in (
        (GO, held, "held"),
        (GO, slowed, "held"),
        (STOP, slowed, None),
        (GO, slowed, None),
        (RESET, slowed, None),
        (GO, slowed, "slowed"),
    ):
        prepared.command(q, -1.0 * elbow, state, request=request)
        assert why is None or f"{why} near a singularity" in prepared.reasons(state)


@pytest.mark.parametrize("wanted", [0.0751, 0.3, 1.0, 1.7])
def test_a_hand_that_turns_moves_as_fast_as_it_may_however_fast_it_is_wanted(wanted):
    """Its chord is shorter than its way: scaled once by that, it would be too fast and be braked to half its speed."""
    given = FREE | {"hand_speed": 0.05, "tracking_error": 9.0, "jump": 9.0, "overspeed": 99.0}
    prepared = Supervisor(acceleration=5.0, **given).prepare(ARM, T)
    state, q = prepared.start(Q0), Q0.copy()
    places = []
    for _ in range(60):
        q = q + T * prepared.command(q, wanted * np.eye(7)[1], state)
        places.append(algebra.translation(ARM.fkm(q)))
    speed = np.linalg.norm(np.diff(places, axis=0), axis=1) / T
    assert speed[20:] == pytest.approx(0.05, rel=1e-9)


def on_a_circle():
    """Return a supervisor, its state and the joints of a hand that goes 0.5 m/s on a circle of 0.5 m."""
    arm = dqc.SerialArm.from_dh(
        [0, 0], [0, 0], [0, 0], [np.pi / 2, 0], ["revolute", "prismatic"], name="crane"
    )
    prepared = Supervisor(acceleration=1e3, velocity=9.0, hand_acceleration=0.7, **LOOSE).prepare(arm, T)
    q = np.array([0.0, 0.5])
    state = prepared.start(q)
    for _ in range(400):
        q = q + T * prepared.command(q, np.array([1.0, 0.0]), state)
    return prepared, state, q


@pytest.mark.parametrize(("change", "share"), [(-0.25, 0.8), (1.3, 1.2 / 1.3), (-0.15, 1.0), (1.1, 1.0)])
def test_a_hand_on_a_circle_takes_what_its_bend_leaves_of_its_acceleration(change, share):
    """ω² r = 0.5 m/s² inwards of 0.7 allowed: 0.2 are left to pull it in, 1.2 to let it out."""
    prepared, state, q = on_a_circle()
    assert prepared.rate(state) == pytest.approx([1.0, 0.0])
    prepared.command(q, np.array([1.0, change * T]), state)
    assert prepared.rate(state)[1] == pytest.approx(share * change * T, rel=0.02)
    assert ("hand acceleration limit" in prepared.reasons(state)) == (share < 1)


@pytest.mark.parametrize("wanted", [(1.0, -0.0025), (1.004, 0.0)])
def test_a_bend_that_is_run_through_too_fast_is_not_made_worse(wanted):
    """What would pull the hand further in, or make it faster, waits; what lets it out is taken."""
    prepared, state, q = on_a_circle()
    prepared.bounds.head[HAND_ACCELERATION_LIMIT] = 0.4
    prepared.command(q, np.array(wanted), state)
    assert prepared.rate(state) == pytest.approx([1.0, 0.0], abs=2e-5)


@pytest.mark.parametrize("coordinate", range(6))
def test_each_base_that_jumps_any_way_is_told(coordinate):
    drives = dqc.WholeBody([dqc.DifferentialDrive(0.05, 0.15, rim_speed=0.8)] * 2)
    prepared = Supervisor(acceleration=1.0, **FREE).prepare(drives, T)
    state = prepared.start(np.zeros(6))
    prepared.command(0.9 * np.eye(6)[coordinate], np.zeros(4), state)
    assert prepared.reasons(state) == ("measured base jumped",)


@pytest.mark.parametrize("jerk", [None, 20.0, 100.0])
def test_a_hand_comes_as_near_to_the_side_of_its_box_with_jerk_as_without(jerk):
    arm = dqc.SerialArm.from_dh([0, 0], [0, 0], [0, 0], [0, 0], ["prismatic"] * 2, name="lift")
    box = WorkspaceBox(lower=(-1.0, -1.0, -1.0), upper=(1.0, 1.0, 1.0))
    given = LOOSE | {"acceleration": 2.0, "velocity": 9.0, "workspace": box, "jerk": jerk}
    prepared = Supervisor(**given).prepare(arm, T)
    q = np.array([0.3, 0.2])
    state, fastest = prepared.start(q), 0.0
    for _ in range(400):
        u = prepared.command(q, np.array([0.4, 0.1]), state)
        q, fastest = q + T * u, max(fastest, u.sum())
        if u.sum() < fastest - 1e-6 and fastest == pytest.approx(0.5):
            break
    left = 1.0 - q.sum()  # where it begins to brake: 0.5²/(2 · 2.5) m, and what jerk takes
    for _ in range(600):
        q = q + T * prepared.command(q, np.array([0.4, 0.1]), state)
    assert 1.0 - 2e-3 < q.sum() <= 1.0 + 1e-9
    window = 0.0 if jerk is None else prepared.window * T
    assert left < 0.5**2 / (2 * 2.5) + 0.5 * (window + 3 * T)

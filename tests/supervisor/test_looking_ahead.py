"""What the supervisor looks ahead for, against closed forms and small steps: box, speed, singularities, zones."""

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol import algebra
from dqcontrol.errors import ValueRangeError
from dqcontrol.limits.rates import fastest_stoppable
from dqcontrol.supervisor import KeepOutZones, LinkPoint, Supervisor, WorkspaceBox
from dqcontrol.supervisor.interventions import REASONS
from dqcontrol.supervisor.supervisor_geometry import _distance
from dqcontrol.supervisor.supervisor_layout import (
    HAND_ACCELERATION_LIMIT,
    HANDS,
    INDEX,
    state_layout,
    taken_apart,
)
from dqcontrol.supervisor.supervisor_step import _stays_clear
from dqcontrol.world import Body

T = 0.01
LOOSE = {
    "slow_below": 0.0, "hold_below": 0.0, "ramp": 0.0, "acceleration": 1e6,
    "tracking_error": 1e9, "jump": 1e9, "overspeed": 1e9, "frozen_after": 1e9,
}  # fmt: skip
ARM = dqc.load_robot("iiwa7")
SLIDES = dqc.SerialArm.from_dh(  # two sliding joints along x: the hand is at x = q₁ + q₂
    [np.pi / 2, 0], [0, 0], [0, 0], [0, np.pi / 2], ["prismatic"] * 2, base=[0.5, 0.5, 0.5, 0.5, 0, 0, 0, 0]
)


def box(robot, q, axis, side, room):
    """Return a box that is wide but for one side, so far from the hand."""
    hand = algebra.translation(robot.fkm(q))
    corners = np.array([hand - 9.0, hand + 9.0])
    corners[side, axis] = hand[axis] + (2 * side - 1) * room
    return {"lower": tuple(corners[0]), "upper": tuple(corners[1])}


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("side", range(2))
def test_a_start_is_refused_from_the_side_of_the_box_on(axis, side):
    """Of the hand, and of a point that stands 3 m off a link, where its frame takes it."""
    rng = np.random.default_rng([axis, side])
    q = rng.uniform(0.5 * ARM.limits.lower, 0.5 * ARM.limits.upper)
    names = ARM.joint_names
    for joint in (2, 5):
        frame = ARM.frames(q)[joint]
        out = np.zeros(3)
        out[axis] = 3.0 * (2 * side - 1)
        turn = algebra.matrix_from_rotation(algebra.rotation(frame))
        offset = turn.T @ out + rng.uniform(-0.1, 0.1, 3)
        place = algebra.translation(frame) + turn @ offset
        away = (2 * side - 1) * (place - algebra.translation(ARM.fkm(q)))[axis]
        for points, room in (([], 0.0), ([LinkPoint(joint=names[joint], offset=tuple(offset))], away)):
            for more in (1e-9, -1e-9):
                given = WorkspaceBox(**box(ARM, q, axis, side, room + more), points=points)
                prepared = Supervisor(workspace=given, **LOOSE).prepare(ARM, T)
                if more > 0:
                    state = prepared.start(q)
                else:
                    with pytest.raises(ValueRangeError, match="outside"):
                        prepared.start(q)
                    continue
                # The same side where it is measured, with what is tolerated.
                prepared.bounds.head[:] = (
                    Supervisor(
                        workspace=WorkspaceBox(**box(ARM, q, axis, side, room - 0.05 + 1e-9), points=points),
                        **LOOSE,
                    )
                    .prepare(ARM, T)
                    .bounds.head
                )
                prepared.command(q, np.zeros(7), state)
                assert not prepared.is_stopped(state)
                prepared.bounds.head[:] = (
                    Supervisor(
                        workspace=WorkspaceBox(**box(ARM, q, axis, side, room - 0.05 - 1e-9), points=points),
                        **LOOSE,
                    )
                    .prepare(ARM, T)
                    .bounds.head
                )
                prepared.command(q, np.zeros(7), state)
                assert prepared.describe_stop(state) == "stop category 1: measured hand outside the workspace"


def slide(**options):
    return Supervisor(velocity=2.0, **LOOSE | options).prepare(SLIDES, T)


@pytest.mark.parametrize("side", [0, 1])
def test_the_largest_share_from_which_braking_ends_in_the_box_is_sent(side):
    """Of what is wanted beyond full braking: all, a half, a quarter, an eighth or nothing."""
    sign, seen = 2 * side - 1, set()
    for whole in (0.3, 0.3071, 0.3137):
        given = WorkspaceBox(**box(SLIDES, [0.1, 0.2], 0, side, whole))
        prepared = slide(acceleration=5.0, workspace=given)
        state, position, rate = prepared.start([0.1, 0.2]), 0.0, 0.0
        for _ in range(70):
            wanted = np.clip(1.5, rate - 5.0 * T, rate + 5.0 * T)
            safe, share = max(rate - 5.0 * T, 0.0), 1.0
            fastest = fastest_stoppable(whole - position, 5.0, T) * (1 + 1e-9)
            while share and safe + share * (wanted - safe) > fastest:
                share = 0.5 * share if share > 0.2 else 0.0
            prepared.command(prepared.position(state).copy(), np.array([sign * 1.5, 0.0]), state)
            rate = safe + share * (wanted - safe)
            assert prepared.rate(state) == pytest.approx([sign * rate, 0.0], abs=1e-9)
            assert ("workspace box" in prepared.reasons(state)) == (share < 1.0)
            assert "limits that cannot be kept together" not in prepared.reasons(state)
            position += T * rate
            seen.add(share)
    assert seen == {1.0, 0.5, 0.25, 0.125, 0.0}


def test_hands_keep_their_speed_while_joints_brake_but_for_a_tenth():
    """v₁ + v₂ is the hand's speed; the second joint brakes at once, the first by 0.02 m/s a period."""
    for first, is_kept in ((0.1299, True), (0.1301, False)):
        prepared = slide(acceleration=[2.0, 100.0], hand_speed=0.1)
        state = prepared.start([0.0, 0.0])
        memory = state_layout(state, 2, 2)
        memory.rate[:] = memory.past[:] = memory.sent_rate[:] = 0.115, -0.025
        prepared.command(np.zeros(2), np.array([first, 0.09 - first]), state)
        assert prepared.reasons(state) == (() if is_kept else ("hand speed limit",))
        assert prepared.rate(state)[0] == pytest.approx(first if is_kept else 0.5 * (first + 0.095))


@pytest.mark.parametrize("limit", ["hand speed limit", "workspace box"])
def test_what_even_braking_cannot_keep_is_said_by_its_name(limit):
    given = {"hand_speed": 0.1}
    if limit == "workspace box":
        given = {"workspace": WorkspaceBox(**box(SLIDES, [0.0, 0.0], 0, 1, 0.01))}
    prepared = slide(acceleration=1.0, **given)
    state = prepared.start([0.0, 0.0])
    memory = state_layout(state, 2, 2)
    memory.rate[0] = memory.past[:, 0] = memory.sent_rate[0] = 0.5
    prepared.command(np.zeros(2), np.zeros(2), state)
    assert prepared.reasons(state) == tuple(
        sorted(
            {limit, "acceleration limit", "limits that cannot be kept together"},
            key=list(REASONS.values()).index,
        )
    )
    assert prepared.rate(state) == pytest.approx([0.49, 0.0])


@pytest.mark.parametrize(("speed", "told"), [(0.1 - 1e-9, False), (0.1 + 1e-9, True), (0.3, True)])
def test_a_command_is_scaled_to_the_hand_s_speed(speed, told):
    prepared = slide(hand_speed=0.1)
    state = prepared.start([0.0, 0.0])
    wanted = np.array([3.0, -2.0]) * speed
    prepared.command(np.zeros(2), wanted, state)
    assert ("hand speed limit" in prepared.reasons(state)) == told
    assert prepared.rate(state) == pytest.approx(wanted * min(1.0, 0.1 / speed), abs=1e-9)


def test_the_hand_s_acceleration_is_kept_by_a_share_of_the_change():
    """ẍ of two periods: what is sent before, and one share of the change of both joints."""
    prepared, rng = slide(hand_acceleration=0.5), np.random.default_rng(2)
    state, before, acted = prepared.start([0.0, 0.0]), np.zeros(2), 0
    for _ in range(60):
        wanted = before + rng.uniform(-0.02, 0.02, 2)
        prepared.command(prepared.position(state).copy(), wanted, state)
        change = abs((wanted - before).sum()) / T
        share = min(1.0, 0.5 / change)
        acted += share < 1
        assert ("hand acceleration limit" in prepared.reasons(state)) == (share < 1)
        assert prepared.rate(state) == pytest.approx(before + share * (wanted - before), abs=1e-9)
        before = prepared.rate(state).copy()
    assert 10 < acted < 50


ELBOWS = np.linspace(0.02, 1.6, 4000)
STRAIGHTER = np.tile([0.3, 0.6, -0.2, 0.0, 0.4, 0.6, 0.1], (4000, 1))
STRAIGHTER[:, 3] = ELBOWS
SMALLEST = np.linalg.svd(ARM.hand_jacobian(STRAIGHTER), compute_uv=False)[:, -1]


@pytest.mark.parametrize("value", [0.1005, 0.0995, 0.09, 0.075, 0.06, 0.0505, 0.0495, 0.03])
def test_rates_towards_a_singularity_are_scaled_by_how_far_it_is(value):
    """From 1 at 0.1 to 0 at 0.05; those away from it, and those that stay, are free."""
    k = int(np.argmin(np.abs(SMALLEST - value)))
    q, here = STRAIGHTER[k], SMALLEST[k]
    options = LOOSE | {"slow_below": 0.1, "hold_below": 0.05}
    for wanted in (np.r_[0.2, 0, 0, -0.3, 0, 0, 0.1], np.r_[0.2, 0, 0, 0.3, 0, 0, 0.1], np.zeros(7)):
        prepared = Supervisor(**options).prepare(ARM, T)
        state = prepared.start(q)
        prepared.command(q, wanted, state)
        scale = np.clip((here - 0.05) / 0.05, 0.0, 1.0) if wanted[3] < 0 else 1.0
        assert prepared.rate(state) == pytest.approx(scale * wanted, abs=1e-7)
        told = {1.0: (), 0.0: ("held near a singularity",)}.get(scale, ("slowed near a singularity",))
        assert prepared.reasons(state) == told


@pytest.mark.parametrize(("between", "told"), [(0.0745, "held"), (0.0755, "slowed")])
def test_a_hold_ends_at_the_mean_of_both_bounds(between, told):
    prepared = Supervisor(**LOOSE | {"slow_below": 0.1, "hold_below": 0.05}).prepare(ARM, T)
    towards = np.r_[0, 0, 0, -0.1, 0, 0, 0]
    state = prepared.start(STRAIGHTER[-1])
    for value, why in (
        (0.0495, "held"),
        (0.06, "held"),
        (between, told),
        (0.06, told),
        (0.2, ""),
        (0.06, "slowed"),
    ):
        prepared.command(STRAIGHTER[int(np.argmin(np.abs(SMALLEST - value)))], towards, state)
        assert prepared.reasons(state) == ((f"{why} near a singularity",) if why else ())


BASES = {
    "differential": dqc.DifferentialDrive(0.05, 0.15, rim_speed=0.8),
    "holonomic": dqc.HolonomicBase(speed=0.8, turn_rate=2.0),
    "mecanum": dqc.MecanumBase(wheel_radius=0.05, half_track=0.15, half_wheelbase=0.24, rim_speed=0.8),
}
WALL = dqc.World(bodies={"wall": Body(box=[0.4, 60.0, 1.0], position=(5.2, 0.0, 0.5))})  # from x = 5 on
WALLS = WALL, dqc.World(bodies={"wall": Body(box=[60.0, 0.4, 1.0], position=(0.0, 5.2, 0.5))})


def way_of(robot, rate, rates, share, past, acceleration):
    """Return the inputs, as smoothed, of a base that brakes after one period at these rates."""

    def shares(of):
        found = np.minimum(1.0, acceleration * T / np.maximum(np.abs(of), 1e-300))
        if len(robot.drives):
            found[:2] = found[:2].min()
        if len(robot.rollers):
            found[:] = found.min()
        return found

    safe = rate * (1 - shares(rate))
    asked = safe + share * (rates - safe)
    window, brakes = len(past), shares(asked)
    count = int(np.ceil(1 / brakes.min())) + window
    sequence = [*past, *(asked * np.maximum(1 - k * brakes, 0.0) for k in range(count))]
    return [np.mean(sequence[k + 1 : k + 1 + window], axis=0) for k in range(count)]


@pytest.mark.parametrize(("jerk", "axis"), [(None, 0), (30.0, 0), (None, 1)])
@pytest.mark.parametrize("kind", BASES)
def test_a_base_keeps_clear_if_its_way_in_small_steps_does(kind, jerk, axis):
    """To half a millimetre: what is missing between two samples is bounded by their way and turn."""
    robot, rng = dqc.WholeBody([BASES[kind]]), np.random.default_rng(7)
    m, acceleration = robot.input_size, np.array([1.0, 1.5, 2.0])[: robot.input_size]
    given = Supervisor(
        **LOOSE | {"acceleration": acceleration.tolist(), "jerk": jerk},
        keep_out=KeepOutZones(world=WALLS[axis], footprint=0.25, margin=0.03),
    )
    prepared = given.prepare(robot, T)
    for _ in range(8):
        heading = rng.uniform(-np.pi, np.pi)
        state = prepared.start([0.0, 0.0, heading])
        memory = state_layout(state, 3, m)
        fastest = np.array([0.5, 1.5]) if m == 2 else np.array([0.5, 0.5, 1.5])
        memory.past[:] = fastest * rng.uniform(0.3, 1.0, m) + 0.05 * rng.uniform(-1, 1, memory.past.shape)
        row = int(rng.integers(len(memory.past)))
        memory.numbers[INDEX] = row  # the oldest
        past = np.roll(memory.past, -row, axis=0)
        memory.rate[:] = past[-1]
        rates = memory.rate + acceleration * T * rng.uniform(-1, 1, m)
        share = float(rng.choice([1.0, 0.5, 0.0]))
        q, farthest = np.array([0.0, 0.0, heading]), 0.0
        for u in way_of(robot, memory.rate.copy(), rates, share, past, acceleration):
            for part in np.linspace(0, 1, 11)[1:]:
                farthest = max(farthest, robot.integrate(q, u, part * T)[axis])
            q = robot.integrate(q, u, T)
        parts = taken_apart(prepared.memory, state)
        for room, is_clear in ((5e-4, True), (-1e-9, False)):
            parts.memory.good[axis] = 5.0 - 0.28 - farthest - room
            parts.scratch.rates[:] = rates
            if farthest > 0:
                assert _stays_clear(parts, share) == is_clear


@pytest.mark.parametrize(("speed", "is_kept"), [(0.1999, True), (0.2002, False)])
def test_bases_that_brake_for_more_than_twenty_thousand_periods_go_no_faster(speed, is_kept):
    robot = dqc.WholeBody([BASES["holonomic"]])
    given = Supervisor(
        **LOOSE | {"acceleration": 1e-3}, keep_out=KeepOutZones(world=WALL, footprint=0.25, margin=0.03)
    )
    prepared = given.prepare(robot, T)
    state = prepared.start([-300.0, 0.0, 0.0])
    memory = state_layout(state, 3, 3)
    memory.rate[0] = memory.past[:, 0] = memory.sent_rate[0] = speed
    prepared.command(np.array([-300.0, 0.0, 0.0]), np.array([0.3, 0.0, 0.0]), state)
    assert (prepared.rate(state)[0] > speed) == is_kept


@pytest.mark.parametrize("frames", [["left"], ["left", "right"]])
def test_the_largest_share_of_a_change_that_keeps_the_hands_acceleration(frames):
    """The largest s in 0 … 1 with |c + s d| ≤ limit, or that of the least acceleration; of two hands the less."""
    arms = dqc.load_robot("two-pandas").with_task("absolute" if len(frames) > 1 else "left")
    q = np.array([-0.1, -0.5, 0.1, -2.2, 0.1, 1.7, 0.8, 0.3, -0.7, -0.2, -2.1, -0.1, 1.5, 0.7])
    prepared, rng = Supervisor(**LOOSE, hand_acceleration=2.0).prepare(arms, T), np.random.default_rng(8)
    state, seen = prepared.start(q), set()

    def hands(at):
        return np.array([algebra.translation(arms.fkm(at, name)) for name in frames])

    places, before = [hands(q)] * 2, np.zeros(14)
    for k in range(80):
        wanted = before + rng.uniform(-0.06, 0.06, 14) if k % 8 else rng.uniform(-0.8, 0.8, 14)
        now = prepared.position(state).copy()
        if k == 40:  # a change that finds the hands in a bend that they run through too fast
            prepared.bounds.head[HAND_ACCELERATION_LIMIT] = 0.2
        limit, shares = prepared.bounds.head[HAND_ACCELERATION_LIMIT], []
        along, changed = hands(now + T * before), hands(now + T * wanted)
        for was, here, straight, bent in zip(places[-2], places[-1], along, changed, strict=True):
            c, d = (straight - 2 * here + was) / T**2, (bent - straight) / T**2
            roots = np.roots([d @ d, 2 * c @ d, c @ c - limit**2])
            best = roots.real.max()  # of a pair the least acceleration
            shares.append(1.0 if (c + d) @ (c + d) <= limit**2 else float(np.clip(best, 0.0, 1.0)))
        prepared.command(now, wanted, state)
        share = min(shares)
        seen.add("kept" if share == 1 else "shared" if share > 0 else "not")
        assert prepared.rate(state) == pytest.approx(before + share * (wanted - before), abs=1e-7)
        assert ("hand acceleration limit" in prepared.reasons(state)) == (share < 1)
        before = prepared.rate(state).copy()
        places.append(hands(prepared.position(state)))
    assert seen >= {"kept", "shared"}


@pytest.mark.parametrize(("away", "is_allowed"), [(0.25 + 1e-9, True), (0.25 - 1e-9, False)])
def test_a_base_starts_no_nearer_to_a_zone_than_its_footprint(away, is_allowed):
    robot = dqc.WholeBody([BASES["holonomic"]])
    prepared = Supervisor(keep_out=KeepOutZones(world=WALL, footprint=0.25, margin=0.03), **LOOSE).prepare(
        robot, T
    )
    if is_allowed:
        assert len(prepared.start([5.0 - away, 0.0, 0.0]))
    else:
        with pytest.raises(ValueRangeError, match="nearer than its footprint"):
            prepared.start([5.0 - away, 0.0, 0.0])


def test_what_is_no_number_is_no_distance():
    head = np.zeros(HANDS + 1)
    head[HANDS] = 2
    places = np.zeros(6)
    others = np.array([3.0, 0.0, 4.0, 0.0, 12.0, 5.0])
    assert _distance(head, places, others) == 13.0
    for k in range(6):
        lost = others.copy()
        lost[k] = np.nan
        assert not _distance(head, places, lost) <= np.inf


@pytest.mark.parametrize(("speed", "is_kept"), [(0.2, True), (0.2004, False)])
def test_hands_that_brake_for_more_than_two_thousand_periods_go_no_faster(speed, is_kept):
    prepared = slide(acceleration=0.01, hand_speed=9.0)
    state = prepared.start([0.0, 0.0])
    memory = state_layout(state, 2, 2)
    memory.rate[0] = memory.past[:, 0] = memory.sent_rate[0] = speed
    prepared.command(np.zeros(2), np.array([0.3, 0.0]), state)
    assert (prepared.rate(state)[0] > speed) == is_kept

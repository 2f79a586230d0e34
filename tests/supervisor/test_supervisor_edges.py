"""Each threshold of the supervisor's watch at its edge: what is just allowed, and what is just not."""

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.contact import Tool
from dqcontrol.errors import ShapeError, ValueRangeError
from dqcontrol.limits.rates import fastest_stoppable
from dqcontrol.supervisor import Supervisor
from dqcontrol.supervisor.supervisor_layout import END, GO, RESET, STOP
from dqcontrol.supervisor.supervisor_step import _moved

T = 0.01
Q0 = np.array([0.3, 0.6, -0.2, 1.6, 0.4, 0.6, 0.1])
ONE, STILL = np.eye(7)[0], np.zeros(7)
FREE = {"slow_below": 0.0, "hold_below": 0.0, "ramp": 0.0, "acceleration": 1e6}
LOOSE = FREE | {"tracking_error": 1e9, "jump": 1e9, "overspeed": 1e9, "frozen_after": 1e9}
ARM = dqc.load_robot("iiwa7")
FASTEST = ARM.limits.velocity[0]


def started(period=T, **options):
    """Return a supervisor of the arm, and the state of one that has not moved yet."""
    supervisor = Supervisor(**FREE | options).prepare(ARM, period)
    return supervisor, supervisor.start(Q0)


def reasons_of(supervisor, state, q, wanted=STILL, **options):
    """Step once; return the reasons."""
    supervisor.command(np.asarray(q, dtype=float), wanted, state, **options)
    return supervisor.reasons(state)


def first_stop(supervisor, state, measured, wanted=STILL, count=400, **options):
    """Return the number of the step that stops, counted from 1, and why; ``measured`` takes number and command."""
    for k in range(1, count + 1):
        given = {name: value(k) if callable(value) else value for name, value in options.items()}
        supervisor.command(measured(k, supervisor.position(state).copy()), wanted, state, **given)
        if supervisor.is_stopped(state):
            return k, supervisor.describe_stop(state).partition(": ")[2]
    return None, ""


def follows(k, command):
    return command


@pytest.mark.parametrize(
    ("elapsed", "still", "told"),
    [(0.05, 0, ()), (0.0501, 0, ("gap in time",)), (T, 0.05, ()), (T, 0.0501, ("clock stands still",))],
)
def test_gaps_and_clocks_that_stand_still_are_told_beyond_fifty_milliseconds(elapsed, still, told):
    supervisor, state = started()
    supervisor.step(Q0, STILL, state, 0.0, 0, np.empty(7), elapsed, still=still)
    assert supervisor.reasons(state) == told


@pytest.mark.parametrize(
    ("period", "late", "stops"), [(T, 2.5, 55), (T, 1.99, None), (1e-3, 12.4, None), (1e-3, 12.6, 236)]
)
def test_periods_are_too_long_by_a_mean_of_fifty(period, late, stops):
    """Beyond 2 periods, and a quarter of 50 ms: mean − late decays by 0.98 a step, from 1 − late."""
    supervisor, state = started(period)
    assert first_stop(supervisor, state, follows, elapsed=late * period)[0] == stops
    if stops:
        reasons_of(supervisor, state, Q0, request=RESET)
        assert first_stop(supervisor, state, follows, elapsed=late * period)[0] == stops


@pytest.mark.parametrize(
    ("options", "share", "silent"),
    [({}, 1.5, 1), ({"overspeed": 0.5}, 1.0, 1), ({}, 1.5, 2), ({"jump": 0.2}, 1.5, 1)],
)
def test_a_measured_joint_jumps_beyond_what_its_speed_and_the_jump_allow(options, share, silent):
    """In the time since it was measured last."""
    way = share * FASTEST * silent * T + options.get("jump", 0.05)
    for more, told in ((-1e-9, "measured joint too fast"), (1e-9, "measured joint jumped")):
        supervisor, state = started(tracking_error=9.0, **options)
        for _ in range(silent - 1):
            reasons_of(supervisor, state, Q0, age=1.0)
        assert reasons_of(supervisor, state, Q0 + (way + more) * ONE) == (told,)


def test_a_limit_lowered_meanwhile_makes_no_jump_and_no_overspeed_of_the_speed_sent():
    supervisor, state = started(tracking_error=9.0, acceleration=0.1, velocity=1.0)
    first_stop(supervisor, state, follows, ONE, 400)
    assert supervisor.rate(state)[0] == pytest.approx(0.4)
    supervisor.bounds.velocity[:] = 0.01
    assert first_stop(supervisor, state, follows, ONE, 20) == (None, "")
    way = 1.5 * supervisor.rate(state)[0] * T + 0.05
    q = supervisor.position(state).copy() - supervisor.rate(state) * T  # where it was measured last
    assert "measured joint jumped" not in reasons_of(supervisor, state.copy(), q + (way - 1e-9) * ONE)
    assert "measured joint jumped" in reasons_of(supervisor, state.copy(), q + (way + 1e-9) * ONE)


@pytest.mark.parametrize("elapsed", [3.0, -1.0, np.nan])
def test_after_a_gap_joints_may_have_moved(elapsed):
    supervisor, state = started(tracking_error=9.0)
    assert reasons_of(supervisor, state, Q0 + ONE, elapsed=elapsed) == ("gap in time",)


def test_a_gap_allows_no_more_than_joints_can_move_in_it():
    supervisor, state = started(tracking_error=99.0)
    assert "measured joint jumped" in reasons_of(
        supervisor, state, Q0 + (1.5 * FASTEST * 3 + 0.06) * ONE, elapsed=3.0
    )


@pytest.mark.parametrize(("period", "stops"), [(0.001, 22), (0.005, 4), (0.01, 2), (0.02, 2)])
def test_measured_speeds_are_smoothed_over_twenty_milliseconds_or_two_periods(period, stops):
    """4 rad/s, of which 1 − (1 − share)ᵏ is seen, and 1.5 times the limit and 0.1 rad/s are allowed."""
    share = min(period / max(0.02, 2 * period), 1.0)
    assert stops == np.ceil(np.log(1 - (1.5 * FASTEST + 0.1) / 4.0) / np.log(1 - share))
    found = first_stop(
        *started(period, tracking_error=9.0, jump=9.0), lambda k, q: Q0 - 4.0 * k * period * ONE
    )
    assert found == (stops, "measured joint too fast")
    supervisor, state = started(period, tracking_error=9.0, jump=9.0)
    reasons_of(supervisor, state, Q0, elapsed=0.0)  # in no time nothing is learnt of a speed
    found = first_stop(supervisor, state, lambda k, q: Q0 - 4.0 * k * period * ONE)
    assert found == (stops, "measured joint too fast")


@pytest.mark.parametrize(
    ("period", "speed", "age", "stops"),
    [(T, 0.5, 0.0, 11), (T, 0.11, 0.0, 20), (T, -0.11, 0.0, 20), (T, 0.5, 0.012, 12), (0.05, 0.5, 0.0, 6)],
)
def test_a_joint_is_frozen_after_a_tenth_of_a_second_and_a_fiftieth_of_a_radian(period, speed, age, stops):
    """At step k it has not changed for k T less its age, and was told to move by (k − 1) T v; 5 periods at least."""
    found = first_stop(*started(period), lambda k, q: Q0, speed * ONE, age=age)
    assert found == (stops, "measured joint frozen while commanded to move")


def test_a_joint_that_moved_before_counts_as_frozen_from_then_on():
    supervisor, state = started(tracking_error=9.0)
    moved = lambda k, q: Q0 + 1e-4 * min(k, 30) * ONE  # noqa: E731
    assert first_stop(supervisor, state, moved, 0.5 * ONE) == (
        41,
        "measured joint frozen while commanded to move",
    )
    supervisor, state = started()
    first_stop(supervisor, state, follows, 0.5 * ONE, 30)
    stays = supervisor.position(state).copy()
    reasons_of(supervisor, state, stays, -0.5 * ONE)
    assert first_stop(supervisor, state, lambda k, q: stays, -0.5 * ONE)[0] == 11


@pytest.mark.parametrize("margin", [0.0, 0.1])
@pytest.mark.parametrize(
    ("beyond", "told"), [(0.05 - 1e-9, ()), (0.05 + 1e-9, ("measured joint beyond its limits",))]
)
def test_measured_joints_may_be_a_twentieth_beyond_the_robot_s_limits(margin, beyond, told):
    for limits, sign in ((ARM.limits.lower, -1), (ARM.limits.upper, 1)):
        supervisor, state = started(
            **{k: v for k, v in LOOSE.items() if k not in FREE}, position_margin=margin
        )
        q = Q0.copy()
        q[5] = limits[5] + sign * beyond
        assert reasons_of(supervisor, state, q) == told


@pytest.mark.parametrize(("effort", "told"), [(50.0, ()), (-50.0, ()), (50.001, ("joint effort too large",))])
def test_an_effort_stops_beyond_its_bound(effort, told):
    assert reasons_of(*started(effort=50.0), Q0, effort=effort * ONE) == told


@pytest.mark.parametrize(("rate", "stops"), [(39.0, None), (41.0, 74), (-41.0, 74)])
def test_efforts_are_compared_with_their_mean_over_a_fifth_of_a_second(rate, stops):
    """One that grows by r a second leads its mean by 0.2 s · r (1 − 0.95ᵏ) after k steps: 8 N·m at 40 N·m/s."""
    found = first_stop(*started(contact_effort=8.0), follows, effort=lambda k: rate * T * k * ONE)
    assert found[0] == stops


def test_the_mean_of_efforts_is_never_further_away_than_the_effort():
    supervisor, state = started(contact_effort=8.0, stale_after=1.0)
    for effort in (0.0, 7.0, 0.0, -7.0):
        assert reasons_of(supervisor, state, Q0, effort=effort * ONE, elapsed=0.5) == ()


@pytest.mark.parametrize(
    ("wrench", "told"),
    [
        ([18.0, -24.0, 0, 0, 0, 0], ()),
        ([0, 18.0, -24.001, 0, 0, 0], ("contact",)),
        ([24.001, 0, 18.0, 0, 0, 0], ("contact",)),
        ([0, 0, 0, 2.4, 3.2, 0], ()),
        ([0, 0, 0, 0, -2.4, 3.201], ("contact",)),
        ([0, 0, 0, 3.201, 0, 2.4], ("contact",)),
        ([0, 0, 0, np.nan, 0, 0], ("measurement stale or impossible",)),
    ],
)
def test_forces_and_torques_stop_beyond_their_bound(wrench, told):
    supervisor, state = started(contact_force=30.0, contact_torque=4.0)
    assert reasons_of(supervisor, state, Q0, wrench=np.array(wrench)) == told


@pytest.mark.parametrize(
    ("q", "age", "told"),
    [
        (Q0, 1.5 * T, ()),
        (Q0, 1.501 * T, ("measurement stale or impossible",)),
        (Q0 + 0.9e6 * ONE, 0.0, ("measured joint jumped",)),
        (Q0 - 1.1e6 * ONE, 0.0, ("measurement stale or impossible",)),
    ],
)
def test_what_counts_as_measured(q, age, told):
    supervisor, state = started()
    assert reasons_of(supervisor, state, q, age=age) == told
    assert not supervisor.is_stopped(state), "one bad sample brakes"
    assert reasons_of(supervisor, state, Q0) == ()
    assert reasons_of(supervisor, state, q, age=age) == told
    assert not supervisor.is_stopped(state), "only two in a row stop"
    reasons_of(supervisor, state, q, age=age)
    assert supervisor.is_stopped(state) == bool(told)


@pytest.mark.parametrize("sign", [-1, 1])
def test_a_tracking_error_stops_beyond_its_bound_and_is_returned_from_to_half_of_it(sign):
    options = LOOSE | {"tracking_error": 0.2, "acceleration": 5.0}
    supervisor, state = started(**options)
    assert reasons_of(supervisor, state, Q0 + sign * (0.2 - 1e-9) * ONE) == ()
    away = Q0 + sign * (0.2 + 1e-9) * ONE
    assert reasons_of(supervisor, state, away) == ("tracking error too large",)
    reasons_of(supervisor, state, away, request=RESET)
    before = np.inf
    for _ in range(200):
        before = np.abs(away - supervisor.position(state)).max()
        found = reasons_of(supervisor, state, away)
        assert ("command returns to the measured joints" in found) == (before > 0.1)
    assert before <= 0.1


def test_a_reset_begins_anew():
    """With the ramp of a start, and without the soft stop that was asked for."""
    supervisor, state = started(ramp=0.2, acceleration=50.0)
    for request in (GO, RESET):
        for k in range(1, 41):
            q = supervisor.position(state).copy()
            assert reasons_of(supervisor, state, q, 0.4 * ONE, request=request if k == 1 else GO) == ()
            assert supervisor.rate(state)[0] == pytest.approx(0.4 * min(k * T / 0.2, 1.0))
        q = supervisor.position(state).copy()
        assert reasons_of(supervisor, state, q, 0.4 * ONE, request=END) == ("soft stop",), "from its begin on"
        assert first_stop(supervisor, state, follows, 0.4 * ONE) == (20, "soft stop")


def test_what_happens_at_rest_is_no_reason_of_a_stop_but_an_emergency_is():
    supervisor, state = started(acceleration=5.0)
    first_stop(supervisor, state, follows, 0.5 * ONE, 20)
    reasons_of(supervisor, state, supervisor.position(state).copy(), request=STOP)
    reasons_of(supervisor, state, supervisor.position(state).copy(), elapsed=1.0)
    assert supervisor.describe_stop(state) == "stop category 1: emergency stop, gap in time", "it moves yet"
    supervisor, state = started()
    reasons_of(supervisor, state, Q0, elapsed=1.0)
    reasons_of(supervisor, state, Q0, np.full(7, np.nan))
    reasons_of(supervisor, state, Q0, np.full(7, np.nan))
    assert supervisor.describe_stop(state) == "stop category 2: gap in time"
    reasons_of(supervisor, state, Q0, request=STOP)
    assert supervisor.describe_stop(state) == "stop category 1: emergency stop, gap in time"


def test_both_inputs_of_a_drive_take_the_same_share_of_their_change():
    """0.01 m/s and 0.02 rad/s a period are allowed: what needs more time than the other decides."""
    base = dqc.WholeBody([dqc.DifferentialDrive(0.05, 0.15, rim_speed=0.8)])
    supervisor = Supervisor(**FREE | {"acceleration": [1.0, 2.0]}).prepare(base, T)
    state, acts = supervisor.start(np.zeros(3)), ("acceleration limit",)
    for wanted, rates, told in (
        ([0.5, 0.3], [0.01, 0.006], acts),
        ([0.11, 0.806], [0.0125, 0.026], acts),
        ([0.0225, 0.046], [0.0225, 0.046], ()),
        ([0.0, 0.056], [0.0125, 0.046 + 0.01 / 2.25], acts),
    ):
        q = np.r_[supervisor.position(state)[0], 0.0, supervisor.position(state)[1]]
        assert reasons_of(supervisor, state, q, np.array(wanted)) == told
        assert supervisor.rate(state) == pytest.approx(rates, abs=1e-12)


def test_rims_on_rollers_keep_their_speed_by_a_mix_with_braking_along_the_way():
    """Each sample is on the way from braking, the same share of all three rates, to what acceleration allows."""
    base = dqc.WholeBody(
        [dqc.MecanumBase(wheel_radius=0.05, half_track=0.15, half_wheelbase=0.24, rim_speed=0.8)]
    )
    assert base.rollers[:, 1].tolist() == [2.0] * len(base.rollers)
    acceleration = np.array([2.0, 1.0, 3.0])
    supervisor = Supervisor(**FREE | {"acceleration": acceleration.tolist()}).prepare(base, T)
    q, acted, rng = np.zeros(3), 0, np.random.default_rng(4)
    state, before = supervisor.start(q), np.zeros(3)

    def loads(rates):
        c, s = np.cos(q[2]), np.sin(q[2])
        own = np.array([c * rates[0] + s * rates[1], c * rates[1] - s * rates[0], rates[2]])
        return np.abs(base.rollers[:, 2:] @ own)

    for wanted in np.repeat(rng.uniform(-1.5, 1.5, (12, 3)), 25, axis=0):
        asked = wanted / max(loads(wanted).max(), (np.abs(wanted) / base.limits.velocity).max(), 1.0)
        asked = np.clip(asked, before - acceleration * T, before + acceleration * T)
        found = reasons_of(supervisor, state, q, wanted)
        rates = supervisor.rate(state).copy()
        assert loads(rates).max() <= 1 + 1e-9
        if loads(asked).max() > 1 + 1e-9:
            acted += 1
            braked = before * (1 - min(1.0, (acceleration * T / np.maximum(np.abs(before), 1e-12)).min()))
            share = (rates - braked) @ (asked - braked) / ((asked - braked) @ (asked - braked))
            np.testing.assert_allclose(rates, braked + share * (asked - braked), atol=1e-9)
            assert 0 < share < 1
            assert loads(rates).max() > 1 - 1e-9, "no more than needed"
            assert "velocity limit" in found
        else:
            np.testing.assert_allclose(rates, asked, atol=1e-9)
        q, before = base.integrate(q, rates, T), rates
    assert acted > 10


@pytest.mark.parametrize("sign", [-1, 1])
def test_a_return_is_as_quick_as_braking_in_time_allows(sign):
    supervisor, state = started(**LOOSE | {"tracking_error": 0.2, "acceleration": 5.0})
    away = Q0 + sign * 0.9 * ONE
    reasons_of(supervisor, state, away)
    rate, returned = 0.0, 0
    for k in range(200):
        room = sign * (away - supervisor.position(state))[0]
        found = reasons_of(supervisor, state, away, request=RESET if k == 0 else GO)
        if "command returns to the measured joints" not in found:
            break
        rate = min(fastest_stoppable(room, 5.0, T), rate + 5.0 * T, FASTEST)
        returned += 1
        assert supervisor.rate(state) == pytest.approx(sign * rate * ONE, abs=1e-12)
    assert returned > 50


@pytest.mark.parametrize("side", [-1, 1])
def test_a_start_beyond_a_limit_comes_back_as_quickly_as_it_can_stop_and_rests_while_stopped(side):
    q = Q0.copy()
    q[5] = (ARM.limits.lower if side < 0 else ARM.limits.upper)[5] + side * 0.0099
    for ramp, request in ((0.0, GO), (0.5, GO), (0.0, STOP)):
        supervisor = Supervisor(**LOOSE | {"ramp": ramp, "acceleration": 1.0}).prepare(ARM, T)
        state, rate, scale, beyond = supervisor.start(q), 0.0, 0.0, 0.0099
        for _ in range(10):
            supervisor.command(q, STILL, state, request=request)
            scale = min(scale + T / ramp, 1.0) if ramp else 1.0
            rate = min(scale * fastest_stoppable(beyond, 1.0, T), rate + T) if request == GO else 0.0
            assert supervisor.rate(state)[5] == pytest.approx(-side * rate, abs=1e-12)
            assert "limits that cannot be kept together" in supervisor.reasons(state)
            beyond -= T * rate


@pytest.mark.parametrize("side", [-1, 1])
def test_a_joint_brakes_before_its_limit_as_late_as_it_can(side):
    q = Q0.copy()
    q[5] = (ARM.limits.lower if side < 0 else ARM.limits.upper)[5] - side * 0.3
    supervisor = Supervisor(**LOOSE | {"acceleration": 5.0}).prepare(ARM, T)
    state, rate, room = supervisor.start(q), 0.0, 0.3
    for _ in range(100):
        found = reasons_of(supervisor, state, q, side * 1.2 * np.eye(7)[5])
        fastest = fastest_stoppable(room, 5.0, T)
        assert ("position limit" in found) == (fastest < 1.2 - 1e-9)
        rate = min(1.2, fastest, rate + 5.0 * T)
        assert supervisor.rate(state)[5] == pytest.approx(side * rate, abs=1e-9)
        room -= T * rate
    limit = (supervisor.bounds.lower if side < 0 else supervisor.bounds.upper)[5]
    assert side * (limit - supervisor.position(state)[5]) >= 0.0, "by no rounding beyond it"


@pytest.mark.parametrize(
    "sizes",
    [{"measured": 6}, {"measured": 8}, {"wanted": 6}, {"out": 8}, {"effort": 6}, {"wrench": 5}, {"state": 7}],
    ids=str,
)
def test_sizes_that_do_not_fit_are_refused(sizes):
    supervisor, state = started()
    given = {"measured": 7, "wanted": 7, "out": 7, "effort": 7, "wrench": 6, "state": 0} | sizes
    arrays = {name: np.zeros(size) for name, size in given.items()}
    state = np.concatenate([state, arrays["state"]])
    with pytest.raises(ShapeError, match="expected 7 measured"):
        supervisor.step(
            arrays["measured"],
            arrays["wanted"],
            state,
            0.0,
            GO,
            arrays["out"],
            None,
            arrays["effort"],
            arrays["wrench"],
        )


def test_it_rests_once_it_is_stopped_and_moves_no_more():
    supervisor, state = started(acceleration=5.0)
    out = np.empty(7)
    assert not supervisor.step(Q0, STILL, state, 0.0, GO, out), "at rest, but not stopped"
    for _ in range(20):
        supervisor.step(supervisor.position(state).copy(), 0.1 * ONE, state, 0.0, GO, out)
    rests = [supervisor.step(supervisor.position(state).copy(), ONE, state, 0.0, STOP, out) for _ in range(3)]
    assert rests == [False, True, True], "0.1 rad/s less 0.05 a period"


def test_limits_that_moved_are_said_not_to_be_kept():
    supervisor, state = started(acceleration=5.0, **{k: v for k, v in LOOSE.items() if k not in FREE})
    first_stop(supervisor, state, follows, 0.5 * ONE, 30)
    for name, value in (("velocity", 0.44), ("upper", None), ("lower", None)):
        bounds, other = supervisor.bounds, state.copy()
        kept = getattr(bounds, name).copy()
        sent = supervisor.position(state)[0]
        getattr(bounds, name)[0] = value or (sent - 0.1 if name == "upper" else sent + 0.1)
        found = reasons_of(supervisor, other, supervisor.position(state).copy(), 0.5 * ONE)
        assert "limits that cannot be kept together" in found
        getattr(bounds, name)[:] = kept
    supervisor.bounds.velocity[0] = 0.46
    assert "limits that cannot be kept together" not in reasons_of(
        supervisor, state, supervisor.position(state).copy(), 0.5 * ONE
    )


def test_what_a_sensor_shows_without_load_is_no_contact():
    bias = np.array([9.0, -8.0, 7.0, 1.0, -2.0, 3.0])
    tool = Tool(mass=0.0, force_bias=tuple(bias[:3]), torque_bias=tuple(bias[3:]))
    for k in range(6):
        supervisor, state = started(contact_force=2.0, contact_torque=0.5, payload=tool)
        assert reasons_of(supervisor, state, Q0, wrench=bias + 0.49 * np.eye(6)[k]) == ()
        assert reasons_of(supervisor, state, Q0, wrench=bias + 2.01 * np.eye(6)[k]) == ("contact",)


def test_a_joint_that_stays_where_it_is_told_to_come_back_to_is_not_frozen():
    """Only a command that goes away from it says that it should have moved."""
    supervisor, state = started(tracking_error=9.0)
    for k in range(1, 12):  # moves on by itself, each time to another place
        reasons_of(supervisor, state, Q0 + 0.02 * k * ONE)
    stays = Q0 + 0.22 * ONE
    assert first_stop(supervisor, state, lambda k, q: stays, 0.5 * ONE, 40) == (None, "")
    assert 0.15 < supervisor.position(state)[0] - Q0[0] < 0.22


def test_limits_the_wrong_way_round_let_a_joint_stand():
    supervisor, state = started(**{name: value for name, value in LOOSE.items() if name not in FREE})
    supervisor.bounds.lower[0], supervisor.bounds.upper[0] = Q0[0] + 0.02, Q0[0] - 0.02
    assert "limits that cannot be kept together" in reasons_of(supervisor, state, Q0, 0.5 * ONE)
    assert supervisor.rate(state).tolist() == [0.0] * 7


@pytest.mark.parametrize("base", [dqc.DifferentialDrive(0.05, 0.15, rim_speed=0.8), dqc.MecanumBase(
    wheel_radius=0.05, half_track=0.15, half_wheelbase=0.24, rim_speed=0.8)], ids=["drive", "rollers"])  # fmt: skip
def test_a_rim_at_its_limit_breaks_none(base):
    robot = dqc.WholeBody([base])
    supervisor = Supervisor(**LOOSE).prepare(robot, T)
    rng = np.random.default_rng(5)
    for _ in range(20):
        wanted = rng.choice([-1, 1], robot.input_size) * rng.uniform(1, 3, robot.input_size)
        state = supervisor.start(np.zeros(3))
        assert reasons_of(supervisor, state, np.zeros(3), wanted) == ("velocity limit",)
        supervisor.bounds.velocity[:] *= 1 - 1e-6
        supervisor.bounds.rollers[:, 2:] *= 1 + 1e-6
        assert "limits that cannot be kept together" not in reasons_of(supervisor, state, np.zeros(3), wanted)
        supervisor.bounds.acceleration[:] = 1e-9  # it cannot follow limits that become lower
        supervisor.bounds.velocity[:] *= 1 - 1e-6
        supervisor.bounds.rollers[:, 2:] *= 1 + 1e-6
        assert "limits that cannot be kept together" in reasons_of(supervisor, state, np.zeros(3), wanted)
        supervisor = Supervisor(**LOOSE).prepare(robot, T)


def test_a_base_that_steers_does_not_turn_on_the_spot():
    base = dqc.CarLikeBase(0.05, 0.15, wheelbase=0.4, steering_limit=0.6, rim_speed=0.8)
    robot = dqc.WholeBody([base])
    supervisor = Supervisor(**LOOSE).prepare(robot, T)
    radius = robot.drives[0, 4]
    for v, omega, is_free in ((0.0, 1.0, False), (0.2, 5.0, False), (0.2, 0.1 / radius, True)):
        state = supervisor.start(np.zeros(3))
        reasons_of(supervisor, state, np.zeros(3), np.array([v, omega]))
        sent = supervisor.rate(state)
        assert abs(sent[1]) <= abs(sent[0]) / radius * (1 + 1e-12)
        assert (sent.tolist() == [v, omega]) == is_free


@pytest.mark.parametrize(
    ("position", "way", "after"),
    [
        (0.5, 0.5, 1.0),
        (0.5, 0.5 + 5e-10, 1.0),
        (0.5, 0.5 + 2e-9, 1.5 - 0.5 + 2e-9),
        (-0.5, -0.5 - 5e-10, -1.0),
        (-0.5, -0.5 - 2e-9, -1.0 - 2e-9),
        (1.0, 1e-10, 1.0),
        (-1.0, -1e-10, -1.0),
        (1.1, 0.1, 1.2),
        (1.0 + 2e-10, 1e-10, 1.0 + 3e-10),
        (-1.0 - 2e-10, -1e-10, -1.0 - 3e-10),
        (1.1, -0.1 + 1e-10, 1.0 + 1e-10),
        (0.1, 0.2, 0.3),
    ],
)
def test_what_ends_beyond_a_limit_by_rounding_ends_on_it(position, way, after):
    assert _moved(position, way, -1.0, 1.0) == pytest.approx(after, rel=0, abs=1e-15)


@pytest.mark.parametrize(("beyond", "told"), [(5e-10, False), (4e-9, True)])
def test_a_start_beyond_a_limit_by_rounding_breaks_none(beyond, told):
    for limits, sign in ((ARM.limits.lower, -1), (ARM.limits.upper, 1)):
        q = Q0.copy()
        q[5] = limits[5] + sign * beyond
        supervisor = Supervisor(**LOOSE).prepare(ARM, T)
        supervisor.bounds.acceleration[:] = 1e-9
        state = supervisor.start(q)
        assert ("limits that cannot be kept together" in reasons_of(supervisor, state, q)) == told


@pytest.mark.parametrize("speed", [0.1, 0.3, 0.7, 1.1])
def test_a_mean_of_equal_rates_is_no_faster_than_their_limit(speed):
    supervisor, state = started(velocity=speed, acceleration=5.0, jerk=135.0)
    assert supervisor.window == 8
    for _ in range(60):
        reasons_of(supervisor, state, supervisor.position(state).copy(), 9.0 * ONE)
    assert (supervisor.rate(state) <= speed).all()
    assert supervisor.rate(state)[0] == pytest.approx(speed)
    assert "limits that cannot be kept together" not in supervisor.reasons(state)


def test_at_a_bound_itself_all_is_well():
    """Of jumps where none is allowed and no time has passed, of tracking, and of a joint that rests at its limit."""
    supervisor, state = started(jump=0.0)
    assert reasons_of(supervisor, state, Q0, elapsed=0.0) == ()
    supervisor = Supervisor(**LOOSE | {"tracking_error": 0.25}).prepare(ARM, T)
    state = supervisor.start(np.zeros(7))
    assert reasons_of(supervisor, state, 0.25 * ONE) == ()
    reasons_of(supervisor, state, 0.125 * ONE, request=STOP)
    assert reasons_of(supervisor, state, 0.125 * ONE, request=RESET) == ()
    for limits in (ARM.limits.lower, ARM.limits.upper):
        supervisor = Supervisor(**LOOSE, measured_tolerance=0.0).prepare(ARM, T)
        assert reasons_of(supervisor, supervisor.start(limits), limits) == ()
    supervisor, state = started(contact_effort=8.0)
    for effort in (0.0, 8.0):
        assert reasons_of(supervisor, state, Q0, effort=effort * ONE) == ()


def test_bounds_of_parameters_and_starts():
    def window(periods):
        return Supervisor(acceleration=5.0, jerk=10.0 / (T * periods)).prepare(ARM, T).window

    assert window(10_000) == 10_000
    with pytest.raises(ValueRangeError, match="smooths over 10001 periods; at most 10000"):
        window(10_001)
    assert Supervisor(ramp=60.0).ramp == 60.0
    supervisor, q = Supervisor(**FREE).prepare(ARM, T), Q0.copy()
    for limits, sign in ((ARM.limits.lower, -1), (ARM.limits.upper, 1)):
        q[5] = limits[5] + sign * 0.0099
        assert len(supervisor.start(q))
        q[5] = limits[5] + sign * 0.0101
        with pytest.raises(ValueRangeError, match="outside"):
            supervisor.start(q)

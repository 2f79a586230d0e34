"""The supervisor: no output beyond its limits whatever comes in, stops in time, starts again."""

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol import algebra
from dqcontrol.contact import Tool
from dqcontrol.errors import ShapeError, UnknownNameError, ValueRangeError
from dqcontrol.limits.rates import fastest_stoppable
from dqcontrol.supervisor import LinkPoint, Supervisor, WorkspaceBox
from dqcontrol.supervisor.interventions import IMPOSSIBLE
from dqcontrol.supervisor.supervisor_layout import END, FINISH, GO, RESET, STOP

T = 0.01
Q0 = np.array([0.3, 0.6, -0.2, 1.6, 0.4, 0.6, 0.1])
SEED = 20261121
WISH = np.array([0.5, 0.5, 0.5, -0.5, 0.5, 0.5, 0.5])
FREE = {"slow_below": 0.0, "hold_below": 0.0, "ramp": 0.0}


@pytest.fixture(scope="module")
def arm():
    return dqc.load_robot("iiwa7")


def follow(supervisor, state, wanted, count, **options):
    """Let the joints be where the command is, for some periods with one wish; return positions, rates, reasons."""
    positions, rates, reasons = [], [], set()
    for _ in range(count):
        supervisor.command(supervisor.position(state).copy(), np.array(wanted, dtype=float), state, **options)
        positions.append(supervisor.position(state).copy())
        rates.append(supervisor.rate(state).copy())
        reasons |= set(supervisor.reasons(state))
    return np.array(positions), np.array(rates), reasons


def test_rates_from_which_braking_ends_in_time():
    """Against braking step by step, and one that starts a little faster does not end in time."""
    print(f"seed {SEED}")
    rng = np.random.default_rng(SEED)
    rate_of = fastest_stoppable
    for room, a, period in zip(
        10 ** rng.uniform(-6, 1, 300),
        10 ** rng.uniform(-1, 2, 300),
        10 ** rng.uniform(-3, -1.5, 300),
        strict=True,
    ):

        def distance(v, a=a, period=period):
            total = 0.0
            while v > 0:
                total, v = total + period * v, v - a * period
            return total

        fastest = rate_of(room, a, period)
        assert distance(fastest) == pytest.approx(room, rel=1e-9)
        assert distance(fastest * (1 + 1e-6)) > room
    assert rate_of(0.0, 1.0, T) == rate_of(-1.0, 1.0, T) == rate_of(1.0, 0.0, T) == 0
    assert rate_of(np.inf, 1.0, T) == np.inf
    assert rate_of(0.5, np.inf, T) == pytest.approx(0.5 / T)


def test_a_limit_is_reached_and_not_crossed(arm):
    supervisor = Supervisor(acceleration=3.0, tracking_error=10.0, **FREE).prepare(arm, T)
    positions, rates, reasons = follow(supervisor, supervisor.start(Q0), [1.7, 0, 0, 0, 0, 0, 0], 400)
    upper = arm.limits.upper[0]
    assert positions[-1, 0] == pytest.approx(upper, abs=1e-6)
    assert positions.max(axis=0)[0] <= upper
    assert np.abs(np.diff(rates, axis=0)).max() <= 3.0 * T * (1 + 1e-9)
    assert rates[:, 0].max() == pytest.approx(1.7)
    assert "position limit" in reasons
    assert (positions[:, 1:] == Q0[1:]).all()


@pytest.mark.parametrize("kind", ["NaN", "stale"])
def test_a_lost_measurement_stops_within_two_periods(arm, kind):
    supervisor = Supervisor(acceleration=5.0, **FREE).prepare(arm, T)
    state = supervisor.start(Q0)
    _, rates, _ = follow(supervisor, state, WISH, 50)
    assert (rates[-1] == WISH).all()
    last = supervisor.position(state).copy()
    bad = last.copy()
    if kind == "NaN":
        bad[3] = np.nan
    speeds, stopped = [], False
    for k in range(20):
        age = 2 * T + k * T if kind == "stale" else 0.0
        stopped = supervisor.step(bad, WISH, state, age, GO, np.empty(7))
        speeds.append(supervisor.rate(state)[0])
    assert speeds == pytest.approx(np.maximum(0.5 - 0.05 * np.arange(1, 21), 0), abs=1e-12)
    assert stopped
    assert supervisor.is_stopped(state)
    assert supervisor.reasons(state) == ("measurement stale or impossible",)
    _, rates, _ = follow(supervisor, state, WISH, 5)
    assert (rates == 0).all(), "it stays until reset"
    follow(supervisor, state, WISH, 1, request=RESET)
    _, rates, _ = follow(supervisor, state, WISH, 50)
    assert (rates[-1] == WISH).all()
    assert not supervisor.is_stopped(state)


def test_one_bad_sample_brakes_one_period_and_is_told(arm):
    supervisor = Supervisor(acceleration=5.0, **FREE).prepare(arm, T)
    state = supervisor.start(Q0)
    follow(supervisor, state, WISH, 50)
    q = supervisor.position(state).copy()
    supervisor.command(q, np.full(7, np.nan), state)
    assert supervisor.reasons(state) == ("command not finite",)
    assert supervisor.rate(state) == pytest.approx(0.9 * WISH)
    supervisor.command(supervisor.position(state).copy(), WISH, state)
    assert supervisor.rate(state) == pytest.approx(WISH)
    assert not supervisor.is_stopped(state)


def test_a_tracking_error_stops_and_a_reset_goes_to_where_the_robot_is(arm):
    supervisor = Supervisor(acceleration=5.0, tracking_error=0.2, **FREE).prepare(arm, T)
    state, blocked = supervisor.start(Q0), Q0.copy()
    for k in range(200):
        supervisor.command(blocked + 1e-9 * k, WISH, state)  # encoders live, though the joints do not move
    assert supervisor.reasons(state) == ("tracking error too large",)
    assert supervisor.stop_category(state) == 1
    assert supervisor.describe_stop(state) == "stop category 1: tracking error too large"
    gap = np.abs(supervisor.position(state) - blocked)
    assert 0.2 < gap.max() < 0.2 + 0.5**2 / (2 * 5.0) + 2 * 0.5 * T, "braking and no more"
    supervisor.command(blocked, np.zeros(7), state, request=RESET)
    for _ in range(200):
        assert "tracking error too large" not in supervisor.reasons(state)
        supervisor.command(blocked, np.zeros(7), state)
    assert np.abs(supervisor.position(state) - blocked).max() <= 0.1
    assert not supervisor.is_stopped(state)


def test_emergency_stop_and_reset(arm):
    supervisor = Supervisor(acceleration=5.0, **FREE).prepare(arm, T)
    state = supervisor.start(Q0)
    follow(supervisor, state, WISH, 50)
    _, rates, reasons = follow(supervisor, state, WISH, 20, request=STOP)
    assert (rates[10:] == 0).all()
    assert reasons == {"emergency stop"}
    follow(supervisor, state, WISH, 1, request=STOP)
    follow(supervisor, state, WISH, 1)
    assert supervisor.is_stopped(state), "released is not reset"
    _, rates, _ = follow(supervisor, state, WISH, 2, request=RESET)
    assert rates[-1, 0] > 0


def test_a_reset_while_moving_is_ignored(arm):
    supervisor = Supervisor(acceleration=5.0, **FREE).prepare(arm, T)
    state = supervisor.start(Q0)
    follow(supervisor, state, WISH, 50)
    follow(supervisor, state, WISH, 1, request=STOP)
    _, rates, _ = follow(supervisor, state, WISH, 5, request=RESET)
    assert supervisor.is_stopped(state)
    assert (np.diff(rates[:, 0]) < 0).all()


def test_soft_start_and_soft_stop(arm):
    supervisor = Supervisor(acceleration=50.0, ramp=0.2, slow_below=0.0, hold_below=0.0).prepare(arm, T)
    state = supervisor.start(Q0)
    _, rates, _ = follow(supervisor, state, [0.4] * 7, 40)
    assert rates[:, 0] == pytest.approx(0.4 * np.minimum(np.arange(1, 41) * T / 0.2, 1))
    follow(supervisor, state, [0.4] * 7, 1, request=END)
    _, rates, reasons = follow(supervisor, state, [0.4] * 7, 25)
    assert rates[:18, 0] == pytest.approx(0.4 * (1 - np.arange(2, 20) * T / 0.2), abs=1e-9)
    assert (rates[20:] == 0).all()
    assert reasons == {"soft stop"}
    assert supervisor.is_stopped(state)


def test_the_hand_stays_in_its_box(arm):
    hand = algebra.translation(arm.fkm(Q0))
    box = WorkspaceBox(lower=tuple(hand - (0.3, 0.3, 0.1)), upper=tuple(hand + np.array([0.3, 0.3, 0.05])))
    print(f"seed {SEED}")
    rng = np.random.default_rng(SEED)
    for acceleration in (1.0, 10.0):
        supervisor = Supervisor(acceleration=acceleration, workspace=box, tracking_error=9.0, **FREE).prepare(
            arm, T
        )
        state, near = supervisor.start(Q0), []
        for _ in range(15):
            positions, rates, reasons = follow(supervisor, state, rng.uniform(-1, 1, 7), 60)
            hands = algebra.translation(arm.fkm(positions))
            assert (hands >= np.array(box.lower) - 1e-9).all()
            assert (hands <= np.array(box.upper) + 1e-9).all()
            assert np.abs(np.diff(rates, axis=0)).max() <= acceleration * T * (1 + 1e-9)
            near.append("workspace box" in reasons)
        assert any(near), "it went to the sides"


def test_it_holds_near_a_singularity_and_leaves_again(arm):
    """The elbow straightens: joint 4 to 0."""
    supervisor = Supervisor(slow_below=0.1, hold_below=0.05, ramp=0.0).prepare(arm, T)
    state = supervisor.start(Q0)
    positions, rates, reasons = follow(supervisor, state, [0, 0, 0, -0.5, 0, 0, 0], 600)
    smallest = np.linalg.svd(arm.hand_jacobian(positions), compute_uv=False)[:, -1]
    assert "slowed near a singularity" in reasons
    assert smallest.min() > 0.05
    assert np.abs(rates[-1]).max() < 0.01 * 0.5
    _, rates, reasons = follow(supervisor, state, [0, 0, 0, 0.5, 0, 0, 0], 30)
    assert rates[-1, 3] == pytest.approx(0.5), "the way out is free"
    assert not reasons & {"slowed near a singularity", "held near a singularity"}


def test_a_hold_lasts_until_well_away(arm):
    """Within the hold and a little out of it motions towards are held; beyond the middle they are slowed."""
    supervisor = Supervisor(
        slow_below=0.1, hold_below=0.05, ramp=0.0, tracking_error=9.0, jump=9.0, overspeed=1e3
    )
    supervisor = supervisor.prepare(arm, T)
    state = supervisor.start(Q0)
    elbows = np.linspace(0.05, 1.5, 3000)
    configurations = np.tile(Q0, (3000, 1))
    configurations[:, 3] = elbows
    smallest = np.linalg.svd(arm.hand_jacobian(configurations), compute_uv=False)[:, -1]
    towards = np.array([0, 0, 0, -0.1, 0, 0, 0])
    for value, told in (
        (0.06, "slowed"),
        (0.045, "held"),
        (0.06, "held"),
        (0.08, "slowed"),
        (0.06, "slowed"),
    ):
        q = configurations[np.argmin(np.abs(smallest - value))]
        supervisor.command(q, towards, state)
        assert any(reason.startswith(told) for reason in supervisor.reasons(state)), value


def test_jerk(arm):
    supervisor = Supervisor(acceleration=5.0, jerk=100.0, **FREE).prepare(arm, T)
    state = supervisor.start(Q0)
    rng = np.random.default_rng(SEED)
    rates = np.vstack([follow(supervisor, state, rng.uniform(-1, 1, 7), 30)[1] for _ in range(20)])
    assert np.abs(np.diff(rates, axis=0)).max() <= 5.0 * T * (1 + 1e-9)
    jerk = np.abs(np.diff(rates, n=2, axis=0)) / T**2
    assert 50 < jerk.max() <= 100.0 * (1 + 1e-9)


def test_commands_from_measured_joints(arm):
    """Where u holds the arm against its weight, the position command stands still: no limit acts."""
    supervisor = Supervisor(tracking_error=0.2, **FREE).prepare(arm, T, command_mode="measured")
    state = supervisor.start(Q0)
    u = np.zeros(7)
    for k in range(30):
        sag = 0.1 * min(k / 20, 1)
        u = supervisor.command(Q0 - sag, np.full(7, sag / T), state)  # 10 rad/s in the end
    assert supervisor.code(state) == 0
    assert u == pytest.approx(0.1 / T)
    assert supervisor.position(state) == pytest.approx(Q0)


def test_an_unlimited_command_passes_unchanged(arm):
    supervisor = Supervisor(acceleration=1e6, **FREE).prepare(arm, T)
    state, u = supervisor.start(Q0), np.array([0.1, -0.2, 0.3, 0, 0.5, -0.6, 0.7])
    assert supervisor.command(Q0, u, state).tolist() == u.tolist()
    assert supervisor.code(state) == 0


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"velocity": 0.0}, "supervisor.velocity: must be > 0, got 0"),
        ({"velocity": [1.0, 2.0]}, r"supervisor.velocity: expected one number or 7, got shape \(2,\)"),
        ({"acceleration": float("nan")}, "supervisor.acceleration: must be finite, got nan"),
        ({"jerk": 1e-3}, "supervisor.jerk: smooths over 2000000 periods; at most 10000"),
        ({"jerk": 5e-324}, "supervisor.jerk: smooths over inf periods; at most 10000: allow more jerk"),
        ({"jerk": 1e-300}, "supervisor.jerk: smooths over .* periods; at most 10000"),
        ({"jerk": 1.0, "acceleration": 1e308}, "supervisor.jerk: smooths over inf periods"),
        ({"position_margin": -1.0}, "supervisor.position_margin: must be ≥ 0, got -1"),
        ({"position_margin": float("nan")}, "supervisor.position_margin: must be finite, got nan"),
        ({"ramp": float("nan")}, "supervisor.ramp: must be finite, got nan"),
        ({"ramp": 61.0}, "supervisor.ramp: must be ≤ 60, got 61"),
        ({"stale_after": float("nan")}, "supervisor.stale_after: must be finite, got nan"),
        ({"stale_after": 0.0}, "supervisor.stale_after: must be > 0, got 0"),
        ({"slow_below": float("nan")}, "supervisor.slow_below: must be finite, got nan"),
        ({"hold_below": -0.1}, "supervisor.hold_below: must be ≥ 0, got -0.1"),
        ({"hand_speed": 0.0}, "supervisor.hand_speed: must be > 0, got 0"),
        ({"hand_acceleration": -1.0}, "supervisor.hand_acceleration: must be > 0, got -1"),
        ({"measured_tolerance": -1.0}, "supervisor.measured_tolerance: must be ≥ 0, got -1"),
        ({"overspeed": float("inf")}, "supervisor.overspeed: must be finite, got inf"),
        ({"jump": float("nan")}, "supervisor.jump: must be finite, got nan"),
        ({"frozen_after": 0.0}, "supervisor.frozen_after: must be > 0, got 0"),
        ({"effort": [1.0, 2.0]}, r"supervisor.effort: expected one number or 7, got shape \(2,\)"),
        ({"contact_force": -1.0}, "supervisor.contact_force: must be > 0, got -1"),
        (
            {"payload": lambda: Tool(mass=-1.0)},
            "tool.mass: must be ≥ 0, got -1",
        ),
        (
            {"payload": lambda: Tool(mass=1.0, center=(0.0, np.nan, 0.0))},
            r"tool.center\[1\]: must be finite",
        ),
        (
            {"workspace": WorkspaceBox(lower=(0, 0, 0), upper=(1, 1, 1), points=[LinkPoint(joint="elbo")])},
            r"supervisor.workspace.points\[0\].joint: unknown name 'elbo'",
        ),
        ({"position_margin": 2.5}, "supervisor.position_margin: 2.5 leaves .* no room"),
        ({"tracking_error": -1.0}, "supervisor.tracking_error: must be > 0, got -1"),
        ({"slow_below": 0.01}, "supervisor.slow_below: must be ≥ hold_below 0.02, got 0.01"),
        (
            {"workspace": WorkspaceBox(lower=(0, 0, 1), upper=(1, 1, 1))},
            r"supervisor.workspace: lower \[0. 0. 1.\] must be below upper",
        ),
    ],
)
def test_parameters_that_are_not_allowed(arm, parameters, message):
    def prepare():
        made = {name: each() if callable(each) else each for name, each in parameters.items()}
        Supervisor(**made).prepare(arm, T)

    with pytest.raises((ValueRangeError, ShapeError, UnknownNameError), match=message):
        prepare()


def test_starts_that_are_not_allowed(arm):
    supervisor = Supervisor(workspace=WorkspaceBox(lower=(0, 0, 0), upper=(0.1, 0.1, 0.1))).prepare(arm, T)
    with pytest.raises(ValueRangeError, match=r"supervisor.workspace: the end effector starts at"):
        supervisor.start(Q0)
    with pytest.raises(ValueRangeError, match=r"q: \S+ is 9, outside -2.967 … 2.967"):
        supervisor.start([9, 0, 0, 1, 0, 0, 0])
    free = Supervisor().prepare(arm, T)
    state = free.start(Q0)
    with pytest.raises(ShapeError, match="expected 7 measured and 7 wanted"):
        free.command(Q0[:3], np.zeros(7), state)


def test_a_robot_without_velocity_limits_needs_some(arm):
    unlimited = dqc.SerialArm.from_dh([0, 0], [0, 0], [0.3, 0.3], [0, 0], name="two")
    with pytest.raises(
        ValueRangeError, match=r"supervisor.velocity: two has no limits of its own; give them here"
    ):
        Supervisor().prepare(unlimited, T)
    state = Supervisor(velocity=1.0, hold_below=0, slow_below=0).prepare(unlimited, T).start([0.0, 1.0])
    assert len(state)


def test_a_start_a_little_beyond_a_limit_comes_in_without_a_step(arm):
    beyond = Q0.copy()
    beyond[3] = arm.limits.upper[3] + 0.0099
    supervisor = Supervisor(acceleration=5.0, **FREE).prepare(arm, T)
    state = supervisor.start(beyond)
    positions, rates, reasons = follow(supervisor, state, np.zeros(7), 60)
    assert "limits that cannot be kept together" in reasons
    path = np.vstack([beyond, positions])
    assert np.abs(np.diff(path, axis=0)).max() <= 5.0 * T**2 * 20, "no step"
    assert np.diff(path[:, 3]).max() <= 0
    assert np.abs(np.diff(rates, axis=0)).max() <= 5.0 * T * (1 + 1e-9)
    assert positions[-1, 3] <= arm.limits.upper[3] + 1e-12
    assert not supervisor.code(state) & IMPOSSIBLE


def test_limits_that_move_meanwhile_are_come_to_within_the_acceleration(arm):
    """A lower speed, and a position limit nearer than the joint can stop: it brakes, comes back, and that is said."""
    for jerk in (None, 200.0):
        supervisor = Supervisor(acceleration=5.0, jerk=jerk, tracking_error=9.0, **FREE).prepare(arm, T)
        state = supervisor.start(Q0)
        _, before, _ = follow(supervisor, state, WISH, 60)
        supervisor.bounds.velocity[:] = 0.1
        supervisor.bounds.upper[0] = supervisor.position(state)[0] + 0.001
        _, rates, _ = follow(supervisor, state, WISH, 1)
        assert supervisor.code(state) & IMPOSSIBLE
        assert rates[0, 0] > 0.1
        more, later, _ = follow(supervisor, state, WISH, 200)
        assert np.abs(np.diff(np.vstack([before, rates, later]), axis=0)).max() <= 5.0 * T * (1 + 1e-9)
        assert (more[-1] <= supervisor.bounds.upper + 1e-12).all()
        assert np.abs(later[-1]).max() <= 0.1
        assert not supervisor.code(state) & IMPOSSIBLE


def test_the_largest_numbers_leave_no_trace(arm):
    """With periods of seconds and joints counted from what is measured, T · 1e308 is infinite."""
    supervisor = Supervisor(ramp=0.5, frozen_after=1e9).prepare(arm, 2.0, command_mode="measured")
    state = supervisor.start(Q0)
    for wanted in (np.finfo(float).max, -np.finfo(float).max, 1e30):
        for _ in range(3):
            assert np.isfinite(
                supervisor.command(supervisor.position(state).copy(), np.full(7, wanted), state)
            ).all()
    huge = Supervisor(
        velocity=1e30, acceleration=1e30, tracking_error=1e30, position_margin=0.0, overspeed=1e30
    )
    huge = huge.prepare(arm, T)
    assert np.isfinite(huge.command(Q0, np.full(7, 1e30), huge.start(Q0))).all()


@pytest.mark.parametrize(
    ("elapsed", "told"),
    [(3.0, True), (0.051, True), (-0.001, True), (np.nan, True), (0.03, False), (0.0, False)],
)
def test_a_gap_in_time_stops_and_needs_a_reset(arm, elapsed, told):
    supervisor = Supervisor(acceleration=5.0, **FREE).prepare(arm, T)
    state = supervisor.start(Q0)
    follow(supervisor, state, WISH, 50)
    _, rates, _ = follow(supervisor, state, WISH, 1, elapsed=elapsed)
    assert supervisor.is_stopped(state) == told
    assert rates[0] == pytest.approx((0.9 if told else 1.0) * WISH), (
        "brakes from there, within the acceleration"
    )
    if told:
        assert supervisor.describe_stop(state) == "stop category 2: gap in time"
        follow(supervisor, state, WISH, 30)
        assert not supervisor.rate(state).any()
        _, rates, _ = follow(supervisor, state, WISH, 2, request=RESET)
        assert rates[-1, 0] > 0


def test_its_own_period_is_watched(arm):
    supervisor = Supervisor(**FREE).prepare(arm, T)
    state = supervisor.start(Q0)
    follow(supervisor, state, WISH * 0.1, 300, elapsed=1.8 * T)
    assert not supervisor.is_stopped(state)
    follow(supervisor, state, WISH * 0.1, 300, elapsed=2.5 * T)
    assert supervisor.describe_stop(state) == "stop category 2: periods too long"


def drive_to(supervisor, state, q, disturbed, count=60, wish=WISH, **options):
    """Move for a while, then measure something else, as a function of the step and the honest joints says."""
    follow(supervisor, state, wish, 60)
    k = 0
    for k in range(count):
        supervisor.command(disturbed(k, supervisor.position(state).copy()), wish, state, **options)
        if supervisor.is_stopped(state):
            break
    return k, supervisor.describe_stop(state)


def test_what_is_measured_is_supervised(arm):
    """Each fault of the encoders stops with its own name, soon; the honest robot beside it does not."""

    def start(**options):
        supervisor = Supervisor(acceleration=5.0, tracking_error=9.0, **FREE | options).prepare(arm, T)
        return supervisor, supervisor.start(Q0)

    def ramp(speed, joint=0):
        return lambda k, q: q + np.eye(7)[joint] * speed * T * (k + 1)

    drive_to(*start(), Q0, lambda k, q: q)
    still = np.zeros(7)
    k, told = drive_to(*start(), Q0, lambda k, q: q + 0.12)
    assert (k, told) == (1, "stop category 1: measured joint jumped"), "the second sample, 20 ms later"
    k, told = drive_to(*start(), Q0, ramp(4.0))
    assert told == "stop category 1: measured joint too fast"
    assert k < 10
    k, told = drive_to(*start(), Q0, lambda k, q: Q0, wish=0.2 * WISH)
    frozen = Q0.copy()
    k, told = drive_to(*start(jump=9.0, overspeed=1e3), Q0, lambda k, q: frozen, wish=0.2 * WISH)
    assert told == "stop category 1: measured joint frozen while commanded to move"
    assert k <= 21, "0.02 rad at 0.1 rad/s, or 0.1 s"
    k, told = drive_to(*start(jump=9.0, overspeed=1e3), Q0, lambda k, q: frozen, wish=still)
    assert told == "", "a robot that is told to stand still may"
    beyond = Q0.copy()
    beyond[3] = arm.limits.upper[3] + 0.297
    k, told = drive_to(*start(jump=9.0, overspeed=1e3), Q0, lambda k, q: beyond + 1e-6 * k)
    assert (k, told) == (0, "stop category 1: measured joint beyond its limits")
    hand = algebra.translation(arm.fkm(Q0))
    box = WorkspaceBox(lower=tuple(hand - 0.1), upper=tuple(hand + 0.1))
    away = Q0 + np.array([0, 0.4, 0, 0, 0, 0, 0])
    assert np.abs(algebra.translation(arm.fkm(away)) - hand).max() > 0.15
    k, told = drive_to(
        *start(jump=9.0, overspeed=1e3, workspace=box), Q0, lambda k, q: away + 1e-6 * k, wish=still
    )
    assert (k, told) == (0, "stop category 1: measured hand outside the workspace")


def test_a_silent_robot_is_not_a_frozen_one(arm):
    """Its last measurement grows old, and only that stops."""
    supervisor = Supervisor(stale_after=0.4, tracking_error=9.0, acceleration=5.0, **FREE).prepare(arm, T)
    state = supervisor.start(Q0)
    follow(supervisor, state, 0.2 * WISH, 60)
    last, k = supervisor.position(state).copy(), 0
    while not supervisor.is_stopped(state):
        k += 1
        supervisor.command(last, 0.2 * WISH, state, age=k * T)
    assert supervisor.describe_stop(state) == "stop category 1: measurement stale or impossible"
    assert k == 42


def test_a_period_and_a_half_is_never_a_gap(arm):
    """However young measurements must be."""
    supervisor = Supervisor(stale_after=0.1 * T, **FREE).prepare(arm, T)
    state = supervisor.start(Q0)
    follow(supervisor, state, 0.2 * WISH, 60, elapsed=1.4 * T)
    assert not supervisor.is_stopped(state)


def test_one_spike_of_an_encoder_brakes_one_period(arm):
    supervisor = Supervisor(acceleration=5.0, **FREE).prepare(arm, T)
    state = supervisor.start(Q0)
    follow(supervisor, state, WISH, 50)
    supervisor.command(supervisor.position(state) + 0.2, WISH, state)
    assert supervisor.reasons(state) == ("measured joint jumped",)
    assert supervisor.rate(state) == pytest.approx(0.9 * WISH)
    follow(supervisor, state, WISH, 3)
    assert not supervisor.is_stopped(state)


def test_efforts_and_contact_stop(arm):
    def step(supervisor, state, **measured):
        supervisor.command(supervisor.position(state).copy(), 0.1 * WISH, state, **measured)
        return supervisor.describe_stop(state)

    one = np.eye(7)[2]
    supervisor = Supervisor(effort=50.0, contact_effort=8.0, contact_force=30.0, contact_torque=4.0, **FREE)
    supervisor = supervisor.prepare(arm, T)
    heavy, state = 40.0 * one, supervisor.start(Q0)
    for k in range(30):
        assert step(supervisor, state, effort=heavy + 0.1 * k * one) == "", "gravity is no contact"
    assert step(supervisor, state, effort=heavy + 7.0 * one) == ""
    assert step(supervisor, state, effort=-heavy) == "stop category 1: contact"
    state = supervisor.start(Q0)
    assert step(supervisor, state, effort=51.0 * one) == "stop category 1: joint effort too large"
    for wrench, told in (
        ([0, 20.0, 20.0, 0, 0, 0], ""),
        ([0, 22.0, 22.0, 0, 0, 0], "stop category 1: contact"),
        ([0, 0, 0, 0, 0, -4.1], "stop category 1: contact"),
    ):
        assert step(supervisor, supervisor.start(Q0), wrench=np.array(wrench)) == told
    state = supervisor.start(Q0)
    for _ in range(2):
        step(supervisor, state, effort=np.full(7, np.nan))
    assert supervisor.describe_stop(state) == "stop category 1: measurement stale or impossible"


def test_the_hand_keeps_its_speed_and_acceleration(arm):
    supervisor = Supervisor(
        acceleration=10.0, hand_speed=0.1, hand_acceleration=0.5, tracking_error=9.0, **FREE
    ).prepare(arm, T)
    state, rng, seen = supervisor.start(Q0), np.random.default_rng(SEED), set()
    print(f"seed {SEED}")
    hands = [algebra.translation(arm.fkm(Q0))] * 2
    for _ in range(12):
        positions, rates, reasons = follow(supervisor, state, rng.uniform(-0.6, 0.6, 7), 60)
        hands += list(algebra.translation(arm.fkm(positions)))
        seen |= reasons
        assert np.abs(np.diff(rates, axis=0)).max() <= 10.0 * T * (1 + 1e-9)
    path = np.array(hands)
    speeds = np.linalg.norm(np.diff(path, axis=0), axis=1) / T
    bends = np.linalg.norm(np.diff(path, n=2, axis=0), axis=1) / T**2
    assert 0.09 < speeds.max() <= 0.1 * (1 + 1e-9)
    assert np.quantile(bends, 0.95) <= 0.5 * 1.01, np.quantile(bends, [0.5, 0.9, 0.95, 0.99, 1])
    assert {"hand speed limit", "hand acceleration limit"} <= seen
    _, rates, _ = follow(supervisor, state, WISH, 40, request=FINISH)
    assert not rates[-1].any()


def test_points_of_links_stay_in_the_box(arm):
    """The second joint lowers the elbow, far below the hand, which alone would let it pass."""
    floor = algebra.translation(arm.frames(Q0)[3])[2] - 0.03
    sides = {"lower": (-3.0, -3.0, floor), "upper": (3.0, 3.0, 3.0)}

    def lowest(*points):
        box = WorkspaceBox(**sides, points=list(points))
        supervisor = Supervisor(workspace=box, tracking_error=9.0, **FREE).prepare(arm, T)
        positions, _, reasons = follow(supervisor, supervisor.start(Q0), [0, 0.4, 0, 0, 0, 0, 0], 120)
        assert algebra.translation(arm.fkm(positions))[:, 2].min() > floor + 0.05, "the hand is higher"
        return min(algebra.translation(arm.frames(q)[3])[2] for q in positions), reasons

    free, _ = lowest()
    assert free < floor - 0.02
    kept, reasons = lowest(LinkPoint(joint="joint_4"))
    assert floor - 1e-9 <= kept < floor + 0.01
    assert "workspace box" in reasons
    x, y, z = algebra.matrix_from_rotation(algebra.rotation(arm.frames(Q0)[3]))[2]  # 1 cm below the elbow
    below, _ = lowest(LinkPoint(joint="joint_4", offset=(-0.01 * x, -0.01 * y, -0.01 * z)))
    assert kept + 0.005 < below < kept + 0.015


@pytest.mark.parametrize("jerk", [20.0, 100.0])
def test_the_hand_stays_in_its_box_with_jerk(jerk):
    """Rates from before come out of the smoothing while it brakes already."""
    arm = dqc.load_robot("ur5")
    q = np.array([0.3, -1.2, 1.4, -0.6, 0.5, 0.2])
    hand = algebra.translation(arm.fkm(q))
    rng = np.random.default_rng(SEED)
    print(f"seed {SEED}")
    for _ in range(6):
        lower, upper = hand - rng.uniform(0.02, 0.2, 3), hand + rng.uniform(0.02, 0.2, 3)
        box = WorkspaceBox(lower=tuple(lower), upper=tuple(upper))
        supervisor = Supervisor(
            acceleration=5.0, jerk=jerk, workspace=box, tracking_error=9.0, **FREE
        ).prepare(arm, T)
        state = supervisor.start(q)
        for _ in range(4):
            positions, _, reasons = follow(supervisor, state, rng.uniform(-2, 2, 6), 60)
            hands = algebra.translation(arm.fkm(positions))
            assert (hands >= lower - 1e-9).all()
            assert (hands <= upper + 1e-9).all()
            assert "limits that cannot be kept together" not in reasons


def test_weight_and_bias_of_a_declared_payload_are_no_contact(arm):
    """Held still however it is turned, it is felt as nothing; a push of 10 N on top as 10 N."""
    rng, mass, center = np.random.default_rng(SEED), 3.0, np.array([0.02, -0.03, 0.15])
    print(f"seed {SEED}")
    bias = np.array([0.5, -0.4, 1.0, 0.05, 0.02, -0.03])
    payload = Tool(mass=mass, center=tuple(center), force_bias=tuple(bias[:3]), torque_bias=tuple(bias[3:]))
    bounds = {"contact_force": 10.0, "contact_torque": 1.0, "payload": payload}
    supervisor = Supervisor(**bounds, **FREE).prepare(arm, T)
    bare = Supervisor(**bounds | {"payload": None}, **FREE).prepare(arm, T)

    def feels(one, q, wrench):
        state = one.start(q)
        one.command(q, np.zeros(7), state, wrench=wrench)
        return one.describe_stop(state) == "stop category 1: contact"

    for q in rng.uniform(0.9 * arm.limits.lower, 0.9 * arm.limits.upper, (10, 7)):
        turned = algebra.matrix_from_rotation(algebra.rotation(arm.fkm(q)))
        weight = turned.T @ [0.0, 0.0, -9.81 * mass]
        held = np.concatenate([weight, np.cross(center, weight)]) + bias
        push = rng.standard_normal(3)
        push /= np.linalg.norm(push)
        assert feels(bare, q, held)
        for size, is_felt in ((0.0, False), (9.999, False), (10.001, True)):
            assert feels(supervisor, q, held + np.append(size * push, np.zeros(3))) == is_felt
        for size, is_felt in ((0.999, False), (1.001, True)):
            assert feels(supervisor, q, held + np.append(np.zeros(3), size * push)) == is_felt


@pytest.mark.parametrize("form", ["constrained", "unconstrained"])
def test_a_localisation_that_jumps_stops_and_one_that_corrects_itself_does_not(form):
    body = dqc.load_robot("little-john").in_form(form)
    supervisor = Supervisor(acceleration=5.0, **FREE).prepare(body, 0.05)
    q, forwards = np.array([3.0, 5.0, 0.7, 0, -0.9, 0.9, 0.9, 0]), np.zeros(body.input_size)
    forwards[0] = 0.3

    def drive(state, places):
        for place in places:
            supervisor.command(q + np.append(place, np.zeros(5)), forwards, state)
        return supervisor.describe_stop(state)

    for k in range(3):
        corrected, jumped = np.zeros((2, 10, 3))
        corrected[3:, k], jumped[3:, k] = 0.19, -1.0
        assert drive(supervisor.start(q), corrected) == ""
        state = supervisor.start(q)
        assert drive(state, jumped[:4]) == "", "one sample brakes"
        assert supervisor.reasons(state) == ("measured base jumped",)
        assert drive(state, jumped[4:5]) == "stop category 1: measured base jumped"


@pytest.mark.parametrize(("slack", "told"), [(0.08, ""), (0.12, "stop category 1: measured joint too fast")])
def test_measured_joints_may_be_a_tenth_of_a_radian_a_second_beyond_the_overspeed(arm, slack, told):
    """For the noise of encoders; the joint goes at 1.5 times its limit and the slack, as it was asked to measure."""
    supervisor = Supervisor(acceleration=5.0, tracking_error=9.0, jump=9.0, **FREE).prepare(arm, T)
    speed = 1.5 * arm.limits.velocity[0] + slack
    path = lambda k, q: np.r_[-1.5 + speed * T * k, q[1:]]  # noqa: E731
    state = supervisor.start(np.r_[-1.5, Q0[1:]])
    reasons = set()
    for k in range(60):
        supervisor.command(path(k, supervisor.position(state).copy()), np.zeros(7), state)
        reasons.add(supervisor.describe_stop(state))
    assert reasons - {""} == ({told} if told else set())

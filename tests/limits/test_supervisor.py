"""The supervisor: no output beyond its limits whatever comes in, stops in time, starts again."""

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol import algebra
from dqcontrol.errors import ShapeError, ValueRangeError
from dqcontrol.limits import Supervisor, WorkspaceBox
from dqcontrol.limits.supervisor import supervisor_layout as at
from dqcontrol.limits.supervisor.braking import fastest_stoppable
from dqcontrol.limits.supervisor.prepared_supervisor import END, GO, RESET, STOP

T = 0.01
Q0 = np.array([0.3, 0.6, -0.2, 1.6, 0.4, 0.6, 0.1])
SEED = 20261121
WISH = np.array([0.5, 0.5, 0.5, -0.5, 0.5, 0.5, 0.5])
FREE = {"slow_below": 0.0, "hold_below": 0.0, "ramp": 0.0}


@pytest.fixture(scope="module")
def arm():
    return dqc.load_robot("iiwa7")


@pytest.fixture(scope="module")
def driving():
    arm = dqc.load_robot("iiwa7")
    limits = dqc.robots.Limits(arm.limits.lower, arm.limits.upper, arm.limits.velocity, arm.limits.effort)
    assert np.isfinite(limits.velocity).all()
    return dqc.WholeBody([dqc.DifferentialDrive(wheel_radius=0.04, half_track=0.13), arm])


def follow(supervisor, state, wanted, count, **options):
    """Let the joints be where the command is, for some periods with one wish; return positions, rates, reasons."""
    positions, rates, reasons = [], [], set()
    for _ in range(count):
        supervisor.command(supervisor.position(state).copy(), np.array(wanted, dtype=float), state, **options)
        positions.append(supervisor.position(state).copy())
        rates.append(supervisor.rate(state).copy())
        reasons |= set(supervisor.reasons(state))
    return np.array(positions), np.array(rates), reasons


def wild(rng, shape, scale):
    """Return numbers of all sizes, with jumps, NaN and infinities among them."""
    values = scale * rng.standard_normal(shape) * 10.0 ** rng.choice([-3, 0, 0, 0, 3], shape)
    strange = rng.random(shape) < 0.003
    kinds = np.array([np.nan, np.inf, -np.inf, 1e308, -1e308, 0.0])
    values[strange] = kinds[rng.integers(0, len(kinds), strange.sum())]
    return values


def limit_set(rng, robot, prepared):
    """Overwrite limits with random ones, zero and infinite ones among them; return them."""
    m, head = robot.input_size, at.HEAD
    parameters = prepared.parameters
    joints = parameters[head + 5 * m : head + 6 * m] != 0
    lower, upper = np.sort(rng.uniform(-3, 3, (2, m)), axis=0)
    same = rng.random(m) < 0.1
    upper[same] = lower[same]
    without = (rng.random(m) < 0.1) | ~joints
    lower[without], upper[without] = -np.inf, np.inf
    acceleration = rng.choice([0.0, 0.1, 5.0, 100.0, np.inf, 1e-9], m)
    velocity = rng.choice([0.0, 0.05, 1.0, 20.0, 1e6], m)
    parameters[head : head + m] = acceleration
    parameters[head + m : head + 2 * m], parameters[head + 2 * m : head + 3 * m] = lower, upper
    parameters[head + 3 * m : head + 4 * m] = rng.choice([0.0, 0.3, 10.0, np.inf], m)
    parameters[head + 6 * m : head + 7 * m] = velocity
    parameters[at.FROM_MEASURED] = rng.integers(2)
    return lower, upper, velocity, acceleration


def fuzz(robot, seed, episodes, length):
    """Feed anything to a supervisor with any limits; return how many commands were checked and how many moved."""
    print(f"seed {seed}")
    rng = np.random.default_rng(seed)
    n, m, moving = robot.configuration_size, robot.input_size, 0
    for _ in range(episodes):
        jerk = float(rng.choice([200.0, 2000.0])) if rng.random() < 0.3 else None
        singular = rng.choice([0.0, 0.05, 0.2])
        prepared = Supervisor(
            velocity=1.0,
            acceleration=10.0,
            jerk=jerk,
            slow_below=singular,
            hold_below=0.4 * singular,
            ramp=0.05,
        ).prepare(robot, T)
        lower, upper, velocity, acceleration = limit_set(rng, robot, prepared)
        coordinates = robot.input_coordinates
        q = rng.uniform(-1, 1, n)
        limited = np.isfinite(lower)
        q[coordinates[limited]] = rng.uniform(lower[limited], upper[limited])
        state = prepared.start(q)
        # mostly near what is commanded, so that it goes on; else anything
        honest = rng.random() < 0.7
        noise, wanted = wild(rng, (length, n), 1e-3), wild(rng, (length, m), rng.choice([0.1, 1.0, 30.0]))
        hold = rng.integers(1, 40)
        wanted = np.repeat(wanted[::hold], hold, axis=0)[:length]
        requests = rng.choice([GO, END, STOP, RESET], length, p=[0.97, 0.002, 0.003, 0.025])
        ages = rng.choice(
            [0.0, T, 5 * T, np.nan, np.inf, -1.0], length, p=[0.9, 0.08, 0.005, 0.005, 0.005, 0.005]
        )
        outputs, positions, rates = np.empty((length, m)), np.empty((length, m)), np.empty((length, m))
        measured = q.copy()
        for k in range(length):
            if honest:
                measured[coordinates] = prepared.position(state)
                measured += np.clip(noise[k], -1e300, np.inf)
            else:
                measured = np.clip(noise[k], -1e300, 1e300) * 3e3
            prepared.step(measured, wanted[k], state, float(ages[k]), int(requests[k]), outputs[k])
            positions[k], rates[k] = prepared.position(state), prepared.rate(state)
            measured = np.nan_to_num(measured, nan=0.0, posinf=0.0, neginf=0.0)
        assert np.isfinite(outputs).all()
        assert np.isfinite(positions).all()
        assert ((lower <= positions) & (positions <= upper)).all()
        assert (np.abs(rates) <= velocity).all()
        before = np.vstack([np.zeros(m), rates[:-1]])
        slack = 1e-9 * np.maximum(1.0, np.abs(rates))
        assert (np.abs(rates - before) <= acceleration * T + slack).all()
        for row in robot.drives:
            first = int(row[0])
            rim = np.abs(rates[:, first]) + row[3] * np.abs(rates[:, first + 1])
            assert (rim <= velocity[first] * (1 + 1e-9)).all()
        moved = np.diff(positions, axis=0, prepend=q[coordinates][None])
        joints = prepared.parameters[at.HEAD + 5 * m : at.HEAD + 6 * m] != 0
        assert moved[:, joints] == pytest.approx((T * rates)[:, joints], abs=1e-9, rel=1e-9)
        moving += int((np.abs(rates).max(axis=1) > 0).sum())
    return episodes * length, moving


@pytest.mark.parametrize("which", ["arm", "driving"])
def test_nothing_leaves_beyond_the_limits(which, request):
    count, moving = fuzz(request.getfixturevalue(which), SEED, 40, 500)
    assert moving > 0.15 * count, "most stand still: the test would see little"


@pytest.mark.slow
def test_nothing_leaves_beyond_the_limits_in_a_million_samples(arm):
    count, moving = fuzz(arm, SEED + 1, 1000, 1000)
    assert count == 1_000_000
    assert moving > 0.15 * count


def test_rates_from_which_braking_ends_in_time():
    """Against braking step by step, and one that starts a little faster does not end in time."""
    print(f"seed {SEED}")
    rng = np.random.default_rng(SEED)
    rate_of = fastest_stoppable
    for room, a, dt in zip(
        10 ** rng.uniform(-6, 1, 300),
        10 ** rng.uniform(-1, 2, 300),
        10 ** rng.uniform(-3, -1.5, 300),
        strict=True,
    ):

        def distance(v, a=a, dt=dt):
            total = 0.0
            while v > 0:
                total, v = total + dt * v, v - a * dt
            return total

        fastest = rate_of(room, a, dt)
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
    for _ in range(200):
        supervisor.command(blocked, WISH, state)
    assert supervisor.reasons(state) == ("tracking error too large",)
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
    supervisor = Supervisor(slow_below=0.1, hold_below=0.05, ramp=0.0, tracking_error=9.0).prepare(arm, T)
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
    sagged, u = Q0 - 0.1, np.zeros(7)
    for _ in range(20):
        u = supervisor.command(sagged, np.full(7, 0.1 / T), state)  # 10 rad/s
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
    with pytest.raises((ValueRangeError, ShapeError), match=message):
        Supervisor(**parameters).prepare(arm, T)


def test_starts_that_are_not_allowed(arm):
    supervisor = Supervisor(workspace=WorkspaceBox(lower=(0, 0, 0), upper=(0.1, 0.1, 0.1))).prepare(arm, T)
    with pytest.raises(ValueRangeError, match=r"supervisor.workspace: the hand starts at"):
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

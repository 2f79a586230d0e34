"""The compiled plants against closed forms."""

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol import algebra
from dqcontrol.errors import Error, ShapeError, UnknownNameError, ValueRangeError
from dqcontrol.laws import Proportional
from dqcontrol.loop import close_loop
from dqcontrol.plants import Integrator, Servo
from dqcontrol.references import SetPoint
from dqcontrol.robots import Limits

SEED = 20260715
T = 0.008
N = 3


@pytest.fixture
def arm(make_arm):
    return make_arm(N)


def drive(plant, robot, q0, commands, seed=0, period=T):
    """Return true and measured configurations after each command."""
    live = plant.start(robot, q0, period, len(commands), seed)
    q, measured = [], []
    for u in commands:
        live.step(u)
        q.append(live.q.copy())
        measured.append(live.measured.copy())
    return np.array(q), np.array(measured)


def random_commands(count, n=N):
    return np.random.default_rng(SEED).normal(size=(count, n))


def test_integrator_adds_up(arm):
    commands, q0 = random_commands(500), np.array([0.1, -0.2, 0.3])
    q, measured = drive(Integrator(), arm, q0, commands)
    assert q == pytest.approx(q0 + T * np.cumsum(commands, axis=0), abs=1e-13)
    assert np.array_equal(q, measured)


@pytest.mark.parametrize("tau", [0.001, 0.05, 2.0])
def test_lag_at_constant_speed(arm, tau):
    """The target is ahead by T u (a + … + aᵏ), a = exp(−T/τ)."""
    u, q0, k = np.array([0.5, -1.0, 2.0]), np.full(N, 0.1), np.arange(1, 401)[:, None]
    q, measured = drive(Servo(time_constant=tau), arm, q0, np.tile(u, (400, 1)))
    a = np.exp(-T / tau)
    assert q == pytest.approx(q0 + k * T * u - T * u * a * (1 - a**k) / (1 - a), abs=1e-12)
    assert np.array_equal(q, measured)


def test_lag_is_that_of_a_differential_equation(arm):
    """The joint follows q̇ = (target − q)/τ whatever the period: one long step is many short ones."""
    target = 0.7
    long, _ = drive(Servo(time_constant=0.05), arm, np.zeros(N), [np.full(N, target / 0.04)], period=0.04)
    short, _ = drive(
        Servo(time_constant=0.05),
        arm,
        np.zeros(N),
        [np.full(N, target / 1e-3)] + [np.zeros(N)] * 39,
        period=1e-3,
    )
    assert long[-1] == pytest.approx(target * (1 - np.exp(-0.04 / 0.05)), abs=1e-14)
    assert short[-1] == pytest.approx(long[-1], abs=1e-14)


def test_measured_mode_starts_each_target_from_the_measured_position(arm):
    u, tau = np.array([0.5, -1.0, 2.0]), 0.05
    q, _ = drive(Servo(command_mode="measured", time_constant=tau), arm, np.zeros(N), np.tile(u, (50, 1)))
    assert q == pytest.approx(np.arange(1, 51)[:, None] * T * u * (1 - np.exp(-T / tau)), abs=1e-13)


@pytest.mark.parametrize("delay", [0, 1, 2, 5])
@pytest.mark.parametrize("mode", ["integrated", "measured"])
def test_delay_is_exact_in_samples(arm, delay, mode):
    commands = random_commands(60)
    plain = Servo()
    late = Servo(delay=delay * T)
    q, _ = drive(plain, arm, np.full(N, 0.2), commands)
    q_late, _ = drive(late, arm, np.full(N, 0.2), commands)
    assert q_late[:delay] == pytest.approx(0.2, abs=1e-15)
    assert np.array_equal(q_late[delay:], q[: len(q) - delay])
    moved, _ = drive(
        Servo(command_mode=mode, delay=delay * T), arm, np.zeros(N), commands[:1].repeat(20, axis=0)
    )
    assert np.flatnonzero(np.abs(moved[:, 0]) > 1e-9)[0] == delay


@pytest.mark.parametrize("delay", [2001 * T, 1e9, 1.7e308])
def test_a_delay_of_endless_periods_is_refused(arm, delay):
    with pytest.raises(ValueRangeError, match=r"plant\.delay: must be ≤ 2,000 periods of .* s, got"):
        Servo(delay=delay).start(arm, np.zeros(N), T, 10, 0)
    with pytest.raises(ValueRangeError, match=r"plant\.delay: must be ≤ 2,000 periods of"):
        Servo(delay=delay).linear_model(arm, np.zeros(N), T)


def test_encoder_steps(arm):
    step = 2e-3
    commands = random_commands(300)
    q, measured = drive(Servo(encoder_resolution=step), arm, np.zeros(N), commands)
    smooth, _ = drive(Servo(), arm, np.zeros(N), commands)
    assert np.array_equal(q, smooth), "in integrated mode the encoder moves nothing"
    assert measured / step == pytest.approx(np.round(measured / step), abs=1e-9)
    assert np.abs(measured - q).max() <= step / 2 * (1 + 1e-9)
    assert np.abs(measured - q).max() > 0.4 * step


def test_encoder_noise_is_white_and_seeded(arm):
    plant, commands = Servo(encoder_noise=1e-3), random_commands(4000)
    q, measured = drive(plant, arm, np.zeros(N), commands, seed=5)
    noise = (measured - q) / 1e-3
    count = noise.size
    assert abs(noise.mean()) < 4 / np.sqrt(count)
    assert noise.std() == pytest.approx(1, abs=4 / np.sqrt(2 * count))
    flat = noise - noise.mean()
    assert abs((flat[1:] * flat[:-1]).mean()) < 4 / np.sqrt(count)
    assert abs((flat[:, 0] * flat[:, 1]).mean()) < 4 / np.sqrt(len(flat))
    again = drive(plant, arm, np.zeros(N), commands, seed=5)[1]
    assert np.array_equal(measured, again)
    other = drive(plant, arm, np.zeros(N), commands, seed=6)[1]
    assert not np.isclose(measured, other, atol=1e-9).any(axis=1).all()


def test_targets_move_no_faster_than_the_joints_may(make_arm):
    inf = np.full(N, np.inf)
    arm = make_arm(N, limits=Limits(-inf, inf, np.array([0.5, 1.0, np.inf]), inf))
    commands = 3 * random_commands(200)
    q, _ = drive(Servo(), arm, np.zeros(N), commands)
    clipped = np.clip(commands, [-0.5, -1, -np.inf], [0.5, 1, np.inf])
    wanted, _ = drive(Servo(rate_limit=False), arm, np.zeros(N), clipped)
    free, _ = drive(Servo(rate_limit=False), arm, np.zeros(N), commands)
    assert np.array_equal(q, wanted)
    assert np.abs(free - q).max() > 0.1


@pytest.mark.parametrize("mode", ["integrated", "measured"])
def test_targets_do_not_leave_the_position_limits(make_arm, mode):
    """Without them the target runs on, and the way back begins late."""
    inf = np.full(N, np.inf)
    lower, upper = np.array([-0.5, -np.inf, -1.0]), np.array([0.5, 1.0, np.inf])
    arm = make_arm(N, limits=Limits(lower, upper, inf, inf))
    commands = np.repeat([[20.0, 20.0, -20.0], [-9.0, -9.0, 9.0]], 150, axis=0)
    live = Servo(command_mode=mode).start(arm, np.zeros(N), T, 300, 0)
    targets = []
    for u in commands:
        live.step(u)
        targets.append(live.state[:N].copy())
        assert (live.q >= lower).all()
        assert (live.q <= upper).all()
    assert (np.array(targets) >= lower).all()
    assert (np.array(targets) <= upper).all()
    if mode == "integrated":
        assert np.array_equal(targets[149], [0.5, 1.0, -1.0])
        assert targets[150] == pytest.approx(targets[149] + T * commands[150], abs=1e-15)
    free, _ = drive(Servo(command_mode=mode, position_limit=False), arm, np.zeros(N), commands)
    assert free[149, 0] > 2.0


def test_two_arms_sag_as_each_alone():
    left, right = dqc.load_robot("panda"), dqc.load_robot("iiwa7")
    q0, u = np.array([0.1, -0.5, 0.2, -2.0, 0.3, 1.6, 0.7] + [0.3] * 7), np.linspace(-0.5, 0.5, 14)
    plant, commands = Servo(sag=1.0), np.tile(u, (100, 1))
    both, _ = drive(plant, dqc.TwoArms(left, right), q0, commands)
    alone = [
        drive(plant, arm, q0[k : k + 7], commands[:, k : k + 7])[0] for arm, k in ((left, 0), (right, 7))
    ]
    assert np.abs(both - np.hstack(alone)).max() < 1e-12
    stiff, _ = drive(Servo(), dqc.TwoArms(left, right), q0, commands)
    assert np.abs(both - stiff).max() > 1e-3


@pytest.mark.parametrize("delay", [0, 3])
@pytest.mark.parametrize("stiffness", [500.0, [300.0, 500.0, 800.0, 200.0, 400.0, 600.0]])
def test_at_rest_under_gravity_until_commanded(make_arm, delay, stiffness):
    """Integrated mode starts in balance and stays; a joint at rest hangs α K⁻¹ τ_g(q) below its target."""
    arm = make_arm(6, (2,), mass=4.0)
    q0, alpha = np.array([0.3, -0.5, 0.1, 0.7, 0.2, -0.4]), 0.8
    plant = Servo(sag=alpha, stiffness=stiffness, delay=delay * T)
    sag0 = alpha * arm.gravity_forces(q0) / np.array(stiffness)
    assert np.abs(sag0).max() > 1e-3
    q, _ = drive(plant, arm, q0, np.zeros((500, 6)))
    assert np.abs(q - q0).max() < 1e-14
    u = np.random.default_rng(SEED).normal(size=6)
    q, _ = drive(plant, arm, q0, np.concatenate([np.tile(u, (50, 1)), np.zeros((1500, 6))]))
    target = q0 + sag0 + 50 * T * u
    assert q[-1] == pytest.approx(target - alpha * arm.gravity_forces(q[-1]) / np.array(stiffness), abs=1e-12)
    assert np.abs(q[-1] - q0 - 50 * T * u).max() > 1e-4, "the sag depends on the configuration"


def test_gravity_points_where_it_is_told(make_arm):
    arm, q0 = make_arm(6, mass=4.0), np.full(6, 0.3)
    for gravity in ((0.0, 0.0, 0.0), (9.81, 0.0, 0.0), (1.0, -2.0, 3.0)):
        live = Servo(command_mode="measured", sag=1.0, gravity=gravity).start(arm, q0, T, 1, 0)
        live.step(np.zeros(6))
        sag = arm.gravity_forces(q0, gravity) / 500
        assert live.q == pytest.approx(q0 - sag * (1 - np.exp(-T / 0.05)), abs=1e-14)


@pytest.mark.usefixtures("without_growth")
@pytest.mark.parametrize("gain", [10.0, 30.0])
def test_sag_law_of_measured_commands(make_arm, gain):
    """Where the joints rest T u holds the sag: T u = s(q), so |N N⁺ e| = |N s|/(kT)."""
    arm = make_arm(6, mass=1.0, seed=4)
    q0 = np.array([0.3, -0.5, 0.4, 0.7, 0.2, -0.4])  # every singular value above 0.06
    desired = arm.fkm(q0)
    plant = Servo(command_mode="measured", sag=1.0, stiffness=2000.0)
    law = Proportional(gain=gain).prepare(arm, None, T)
    samples = SetPoint(desired).samples(T * np.arange(4000))
    trace = close_loop(law, plant.start(arm, q0, T, 4000, 0), samples)
    q, u = trace.q[-1], trace.command[-1]
    assert np.abs(trace.q[-1] - trace.q[-200]).max() < 1e-10, "it has come to rest"
    sag = arm.gravity_forces(q) / 2000
    assert T * u == pytest.approx(sag, abs=1e-9)
    matrix = algebra.hamilton_minus(desired) @ np.diag([1, -1, -1, -1, 1, -1, -1, -1]) @ arm.pose_jacobian(q)
    error = np.eye(8)[0] - algebra.short(algebra.multiply(algebra.conjugate(arm.fkm(q)), desired))
    held = matrix @ np.linalg.pinv(matrix) @ error
    assert np.linalg.norm(held) == pytest.approx(np.linalg.norm(matrix @ sag) / (gain * T), rel=1e-6)
    assert np.linalg.norm(error) == pytest.approx(np.linalg.norm(matrix @ sag) / (gain * T), rel=0.02)


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"time_constant": -1}, r"^plant.time_constant: must be ≥ 0, got -1$"),
        ({"time_constant": float("nan")}, r"^plant.time_constant: must be finite, got nan$"),
        ({"sag": -1}, r"^plant.sag: must be ≥ 0, got -1$"),
        ({"sag": 1}, r"^inertia: arm of 3 has none"),
        ({"stiffness": 0}, r"^plant.stiffness: must be > 0, got 0$"),
        ({"stiffness": [1, 2, -3]}, r"^plant.stiffness\[2\]: must be > 0, got -3$"),
        ({"stiffness": [1, 2]}, r"^plant.stiffness: expected one number or 3, got shape \(2,\)$"),
        ({"stiffness": float("nan")}, r"^plant.stiffness: must be finite"),
        ({"stiffness": "stiff"}, r"^plant.stiffness: expected a number or a list, got text 'stiff'$"),
        ({"delay": -T}, r"^plant.delay: must be ≥ 0, got -0.008$"),
        ({"encoder_noise": -1}, r"^plant.encoder_noise: must be ≥ 0, got -1$"),
        ({"encoder_resolution": float("inf")}, r"^plant.encoder_resolution: must be finite, got inf$"),
        ({"gravity": (0.0, 0.0)}, r"^plant.gravity: expected a list of length 3, got 2$"),
        (
            {"command_mode": "measurd"},
            r"^plant.command_mode: unknown name 'measurd'; did you mean 'measured'\?",
        ),
    ],
    ids=str,
)
def test_bad_parameters(arm, options, text):
    with pytest.raises((ShapeError, ValueRangeError, UnknownNameError), match=text):
        Servo(**options).start(arm, np.zeros(N), T, 1, 0)


@pytest.mark.parametrize("plant", [Integrator(), Servo()], ids=["integrator", "servo"])
def test_bad_starts_and_commands(arm, plant):
    for q0, text in (
        (np.zeros(2), r"^start: expected shape \(…, 3\), got shape \(2,\)$"),
        (np.zeros((2, 3)), r"^start: expected shape \(3,\), got \(2, 3\)$"),
        ([0, 0, np.nan], r"^start: must be finite"),
    ):
        with pytest.raises(Error, match=text):
            plant.start(arm, q0, T, 1, 0)
    with pytest.raises(ValueRangeError, match=r"^period: must be > 0, got 0$"):
        plant.start(arm, np.zeros(N), 0, 1, 0)
    live = plant.start(arm, [0, 0, 0], T, 1, 0)
    with pytest.raises(ShapeError, match=r"^command: does not fit the robot, got shape \(2,\)$"):
        live.step(np.zeros(2))
    live.step(np.zeros(3))
    with pytest.raises(
        ValueRangeError, match=r"^step: the plant was started for 1 periods, and they are over$"
    ):
        live.step(np.zeros(3))


def test_start_is_copied(arm):
    q0 = np.zeros(N)
    Integrator().start(arm, q0, T, 1, 0).step(np.ones(N))
    assert not q0.any()


@pytest.mark.parametrize("tau", [0.0, 0.03])
@pytest.mark.parametrize("share", [0.25, 0.6])
def test_a_delay_that_ends_within_a_period_is_exact(arm, tau, share):
    """The same targets at a fine period that the delay is a multiple of: the same joints."""
    ratio, steps = 20, 12
    delay, q0 = (1 + share) * T, np.zeros(3)
    plant = Servo(time_constant=tau, delay=delay, rate_limit=False, position_limit=False)
    coarse = plant.start(arm, q0, T, steps, 0)
    exact = plant.start(arm, q0, T / ratio, steps * ratio, 0)
    for command in np.random.default_rng(20261122).uniform(-1, 1, (steps, 3)):
        coarse.step(command)
        for k in range(ratio):  # the target moves at once, as over a whole period
            exact.step(ratio * command if k == 0 else np.zeros(3))
        assert coarse.q == pytest.approx(exact.q, abs=1e-12)


def test_every_joint_has_its_own_servo(arm):
    """Lists give each joint what a single number gives all of them, to the last bit; gains scale moves."""
    lags, delays, gains = [0.02, 0.05, 0.11], [0.0, 0.0137, 0.032], [1.0, 0.98, 1.02]
    commands = random_commands(200)
    plant = Servo(
        time_constant=lags, delay=delays, encoder_noise=[0, 1e-3, 1e-4], encoder_resolution=[1e-3, 0, 1e-4]
    )
    q, measured = drive(plant, arm, np.zeros(N), commands, seed=3)
    for i in range(N):
        noise, step = [0, 1e-3, 1e-4][i], [1e-3, 0, 1e-4][i]
        alone = Servo(time_constant=lags[i], delay=delays[i], encoder_noise=noise, encoder_resolution=step)
        same_q, same_measured = drive(alone, arm, np.zeros(N), commands, seed=3)
        assert np.array_equal(q[:, i], same_q[:, i])
        assert np.array_equal(measured[:, i], same_measured[:, i])
    scaled, _ = drive(Servo(time_constant=lags, gain=gains), arm, np.zeros(N), commands)
    plain, _ = drive(Servo(time_constant=lags), arm, np.zeros(N), commands)
    assert scaled == pytest.approx(plain * gains, abs=1e-12)


def test_the_linear_model_of_different_servos_has_the_poles_of_each(arm):
    lags, delays = [0.02, 0.05, 0.11], [0.0, 0.0137, 0.032]
    whole = Servo(time_constant=lags, delay=delays).linear_model(arm, np.zeros(N), T)
    assert whole is not None
    assert whole.inputs.shape[1] == N
    alone = [
        Servo(time_constant=lag, delay=delay).linear_model(arm, np.zeros(N), T)
        for lag, delay in zip(lags, delays, strict=True)
    ]
    for gain in (1.0, 5.0, 20.0):
        each = [model.poles(gain) for model in alone if model is not None]
        assert np.abs(whole.poles(gain)).max() == pytest.approx(max(np.abs(p).max() for p in each), rel=1e-6)
    same = Servo(time_constant=[0.05] * N, delay=0.01).linear_model(arm, np.zeros(N), T)
    assert same is not None
    assert same.inputs.shape[1] == 1  # one stands for all


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"time_constant": [0.1, 0.2]}, r"plant\.time_constant: expected one number or 3, got shape \(2,\)"),
        ({"time_constant": -1.0}, r"plant\.time_constant: must be ≥ 0, got -1"),
        ({"delay": [0.0, 0.0, -0.1]}, r"plant\.delay\[2\]: must be ≥ 0, got -0\.1"),
        ({"gain": 0.0}, r"plant\.gain: must be > 0, got 0"),
    ],
)
def test_lists_that_do_not_fit_are_refused(arm, parameters, message):
    with pytest.raises((ShapeError, ValueRangeError), match=message):
        Servo(**parameters).start(arm, np.zeros(N), T, 10, 0)


def test_second_order_is_that_of_a_differential_equation(arm):
    """One long step is many short ones, and each joint may be of its own order; the delay ends within a period."""
    plant = Servo(bandwidth=[20.0, 0.0, 35.0], damping_ratio=[0.5, 1.0, 1.8], time_constant=0.05, delay=0.012)
    commands = np.zeros((20, N))
    commands[0] = 0.3 / 0.04  # one move of 0.3 rad
    fast = np.zeros((200, N))
    fast[0] = 0.3 / 0.004
    long, _ = drive(plant, arm, np.zeros(N), commands, period=0.04)
    short, _ = drive(plant, arm, np.zeros(N), fast, period=0.004)
    assert long == pytest.approx(short[9::10], abs=1e-12)
    time = 0.04 * np.arange(1, 21) - 0.012
    away = np.sqrt(1 - 0.25) * 20.0
    underdamped = 1 - np.exp(-10 * time) * (np.cos(away * time) + 10 / away * np.sin(away * time))
    assert long[:, 0] == pytest.approx(0.3 * underdamped, abs=1e-12)
    assert long[:, 1] == pytest.approx(0.3 * -np.expm1(-time / 0.05), abs=1e-12)


def test_a_joint_with_play_stays_behind_on_the_side_it_comes_from(arm):
    plant = Servo(time_constant=0.0, friction=[0.0, 0.01, 0.02])
    commands = np.repeat([[1.0] * N, [-1.0] * N], 50, axis=0)
    q, _ = drive(plant, arm, np.zeros(N), commands)
    assert q[49] == pytest.approx(50 * T - np.array([0.0, 0.01, 0.02]))
    assert q[-1] == pytest.approx(np.array([0.0, 0.01, 0.02]), abs=1e-12)
    assert q[50, 1] == q[49, 1]  # while it goes through its play

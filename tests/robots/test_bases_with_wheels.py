"""Cars, tricycles, mecanum and omni bases: what their wheels allow, step by step."""

import numpy as np
import pytest

from dqcontrol.errors import Error, FileFormatError
from dqcontrol.limits import CommandLimits
from dqcontrol.plants import Servo
from dqcontrol.references import DriveTo
from dqcontrol.robots import (
    CarLikeBase,
    DifferentialDrive,
    MecanumBase,
    OmniBase,
    SteeredTricycle,
    WholeBody,
    load_robot,
)
from dqcontrol.supervisor import Supervisor

SEED = 2017
CAR = CarLikeBase(0.1, 0.2, wheelbase=0.5, steering_limit=0.6, rim_speed=1.0)
TRICYCLE = SteeredTricycle(0.1, 0.2, wheelbase=0.4, steering_limit=np.radians(75), rim_speed=1.0)
SPINNING = SteeredTricycle(0.1, 0.2, wheelbase=0.4, steering_limit=np.pi / 2)
MECANUM = MecanumBase(wheel_radius=0.05, half_track=0.15, half_wheelbase=0.25, rim_speed=0.8)
OMNI = OmniBase(wheel_radius=0.05, wheel_distance=0.2, wheel_count=4, rim_speed=0.8)


def sideways(before, after):
    """Return how far each base came off the arc that its heading allows: a chord halves the turn. [m]"""
    way, middle = after - before, 0.5 * (before[..., 2] + after[..., 2])
    return way[..., 1] * np.cos(middle) - way[..., 0] * np.sin(middle)


def chord(before, after):
    """Return the signed length of the arc between two (x, y, φ)."""
    way, middle = after - before, 0.5 * (before[..., 2] + after[..., 2])
    half = 0.5 * way[..., 2]
    return (way[..., 0] * np.cos(middle) + way[..., 1] * np.sin(middle)) / np.sinc(half / np.pi)


@pytest.mark.parametrize("base", [DifferentialDrive(0.1, 0.2), CAR, TRICYCLE, SPINNING], ids=lambda b: b.kind)
def test_no_step_moves_an_axle_sideways(base):
    body = WholeBody([base])
    rng = np.random.default_rng(SEED)
    q, u = rng.uniform(-3, 3, (500, 3)), rng.uniform(-1, 1, (500, 2))
    u[:50, 0] = 0.0
    after = body.integrate(q, u, 0.02)
    assert np.abs(sideways(q, after)).max() <= 1e-12
    # the front wheel rolls along its own plane, and is steered no farther than it can be
    length, turn = chord(q, after), after[:, 2] - q[:, 2]
    assert (np.abs(turn) * base.turning_radius <= np.abs(length) + 1e-12).all()
    free = np.abs(u[:, 1]) * base.turning_radius <= np.abs(u[:, 0])
    np.testing.assert_allclose(turn[free], 0.02 * u[free, 1], rtol=0, atol=1e-12)
    assert free.any()
    if base in (CAR, TRICYCLE):
        assert not free.all()
        angle = base.steering_angle(length, turn)
        assert np.abs(angle[np.abs(length) > 1e-6]).max() <= base.steering_limit + 1e-9


@pytest.mark.parametrize("base", [CAR, TRICYCLE], ids=lambda b: b.kind)
def test_the_hand_moves_as_the_jacobian_says(base):
    body = WholeBody([base, load_robot("ax18")])
    rng = np.random.default_rng(SEED)
    h = 1e-4
    for _ in range(5):
        q, u = rng.uniform(-1, 1, 8), rng.uniform(-1, 1, 7)
        u[1] = rng.uniform(-1, 1) * abs(u[0]) / base.turning_radius
        f = [body.fkm(body.integrate(q, u, k * h)) for k in (-2, -1, 1, 2)]
        rate = (8 * (f[2] - f[1]) - (f[3] - f[0])) / (12 * h)
        np.testing.assert_allclose(body.pose_jacobian(q) @ u, rate, rtol=0, atol=1e-9)


@pytest.mark.parametrize("base", [CAR, TRICYCLE], ids=lambda b: b.kind)
def test_limited_commands_can_be_driven(base):
    body = WholeBody([base])
    keep, parameters = CommandLimits(velocity=True).prepare(body)
    supervisor = Supervisor(acceleration=5.0, base_jump=1.0).prepare(body, 0.02)
    state = supervisor.start(np.zeros(3))
    rng = np.random.default_rng(SEED)
    for u in rng.uniform(-3, 3, (100, 2)):
        limited = u.copy()
        assert keep(np.zeros(3), parameters, limited) == 0
        out = supervisor.command(np.zeros(3), u, state)
        for v, omega in (limited, out):
            assert abs(v) + base.rim_lever * abs(omega) <= base.rim_speed + 1e-12
            assert abs(omega) * base.turning_radius <= abs(v) + 1e-12


def test_the_front_wheel_takes_its_time():
    rate, period = 0.5, 0.02
    for made in (CarLikeBase, SteeredTricycle):
        base = made(0.1, 0.2, wheelbase=0.5, steering_limit=0.6, steering_rate=rate)
        body = WholeBody([base])
        plant = Servo(time_constant=0.0).start(body, np.zeros(3), period, 100, 0)
        angles, before = [], plant.q.copy()
        for k in range(100):
            plant.step(np.array([0.5, 0.6 if k < 50 else -0.6]))
            after = plant.q.copy()
            assert abs(sideways(before, after)) <= 1e-12
            angles.append(float(base.steering_angle(chord(before, after), after[2] - before[2])))
            before = after
        assert np.abs(np.diff([0.0, *angles])).max() <= rate * period + 1e-9
        assert max(angles) == pytest.approx(np.arctan(0.6), abs=1e-9) or max(angles) == pytest.approx(0.5)


def test_a_tricycle_turns_on_the_spot_and_a_car_does_not():
    assert SPINNING.turning_radius == 0.0
    np.testing.assert_allclose(WholeBody([SPINNING]).integrate(np.zeros(3), [0, 1.0], 0.5), [0, 0, 0.5])
    np.testing.assert_array_equal(WholeBody([CAR]).integrate(np.zeros(3), [0, 1.0], 0.5), np.zeros(3))
    assert float(SPINNING.front_wheel_speed(-0.3, 1.0)) == pytest.approx(-5.0)
    assert float(SPINNING.steering_angle(0.0, -1.0)) == pytest.approx(-np.pi / 2)


@pytest.mark.parametrize("base", [MECANUM, OMNI], ids=lambda b: b.kind)
def test_contacts_of_wheels_on_rollers_move_across_their_rollers_only(base):
    rng = np.random.default_rng(SEED)
    for twist in rng.uniform(-1, 1, (20, 3)):
        for wheel, speed in zip(base.wheels, base.wheel_speeds(twist), strict=True):
            contact = np.array([twist[0] - twist[2] * wheel.y, twist[1] + twist[2] * wheel.x])
            rolled = base.wheel_radius * speed * np.array([np.cos(wheel.heading), np.sin(wheel.heading)])
            axis = wheel.heading + wheel.roller
            assert abs((contact - rolled) @ [np.cos(axis), np.sin(axis)]) <= 1e-12
        np.testing.assert_allclose(base.from_wheel_speeds(base.wheel_speeds(twist)), twist, atol=1e-12)


@pytest.mark.parametrize("base", [MECANUM, OMNI], ids=lambda b: b.kind)
def test_no_rim_of_a_wheel_with_rollers_is_too_fast(base):
    """In commands that are limited, in servos and in plans; commands keep their direction and use what they may."""
    body = WholeBody([CAR, base])
    keep, parameters = CommandLimits(velocity=True).prepare(body)
    rng = np.random.default_rng(SEED)

    def rims(phi, rates):
        return base.wheel_radius * np.abs(base.wheel_speeds(base.own_twist(phi, rates))).max()

    for u in rng.uniform(-3, 3, (100, 5)):
        q, limited = rng.uniform(-3, 3, 6), u.copy()
        assert keep(q, parameters, limited) == 0
        np.testing.assert_allclose(limited[2:] * u[2], u[2:] * limited[2], atol=1e-12)
        assert rims(q[5], limited[2:]) <= base.rim_speed + 1e-12
    alone = WholeBody([base])
    servos = Servo(time_constant=0.0).start(alone, np.zeros(3), 0.02, 50, 0)
    for u in rng.uniform(-3, 3, (50, 3)):
        before = servos.q.copy()
        servos.step(u)
        assert rims(before[2], (servos.q - before) / 0.02) <= base.rim_speed + 1e-9
    way = DriveTo(alone, [0, 0, 0], [2, 1, 3.0], speed_fraction=1.0)
    times = np.arange(0.0, way.duration, 0.05)
    for q, u in zip(way.configurations(times), way.mean_inputs(times, 0.05), strict=True):
        assert rims(q[2], u) <= base.rim_speed * (1 + 1e-9)


def test_mecanum_speeds_are_those_of_the_textbook():
    lever = 0.4
    vx, vy, omega = 0.3, -0.2, 0.5
    expected = [
        vx + vy + lever * omega,
        vx - vy - lever * omega,
        vx - vy + lever * omega,
        vx + vy - lever * omega,
    ]
    np.testing.assert_allclose(MECANUM.wheel_speeds([vx, vy, omega]), np.array(expected) / 0.05)
    np.testing.assert_allclose(WholeBody([MECANUM]).limits.velocity, [0.8 / np.sqrt(2)] * 2 + [0.8 / lever])
    np.testing.assert_allclose(WholeBody([OMNI]).limits.velocity, [0.8, 0.8, 4.0])
    turned = MECANUM.own_twist(np.pi / 2, [1.0, 0.0, 0.3])
    np.testing.assert_allclose(turned, [0, -1, 0.3], atol=1e-15)


BODY = """
name: toy
angles: degrees
parts:
  - {kind: car-like, wheel_radius: 0.1, half_track: 0.2, wheelbase: 0.5, steering_limit: 30, steering_rate: 90}
  - {kind: steered-tricycle, wheel_radius: 0.1, half_track: 0.2, wheelbase: 0.5, steering_limit: 90}
  - {kind: mecanum-base, wheel_radius: 0.05, half_track: 0.15, half_wheelbase: 0.25, rim_speed: 0.8}
  - {kind: omni-base, wheel_radius: 0.05, wheel_distance: 0.2, first_angle: 60}
  - {kind: arm, robot: ax18}
"""


def test_files(tmp_path):
    path = tmp_path / "toy.yaml"
    path.write_text(BODY)
    body = load_robot(path)
    assert isinstance(body, WholeBody)
    assert [kind for _, kind in body.bases] == ["car-like", "steered tricycle", "mecanum", "omni"]
    car, tricycle, mecanum, omni = body.parts[:4]
    assert (car.steering_limit, car.steering_rate) == pytest.approx((np.pi / 6, np.pi / 2))
    assert (tricycle.turning_radius, mecanum.rim_speed, omni.first_angle) == pytest.approx(
        (0, 0.8, np.pi / 3)
    )
    assert body.input_size == body.configuration_size - 2


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("half_track: 0.2, wheelbase", "half_track: 0, wheelbase", "half_track"),
        (
            "steering_limit: 30",
            "steering_limit: 95",
            r"parts\[0\]: steering_limit: must be at most 1.553 rad",
        ),
        ("wheelbase: 0.5, steering_limit: 90", "steering_limit: 90", "wheelbase"),
        ("half_wheelbase: 0.25", "half_wheelbase: -1", "half_wheelbase"),
        ("wheel_distance: 0.2", "wheel_distance: 0.2, wheel_count: 2", "wheel_count"),
        ("kind: car-like", "kind: carlike", "car-like"),
    ],
)
def test_bad_files(tmp_path, old, new, message):
    path = tmp_path / "toy.yaml"
    assert old in BODY
    path.write_text(BODY.replace(old, new, 1))
    with pytest.raises(FileFormatError, match=message):
        load_robot(path)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: CarLikeBase(0.1, 0, wheelbase=0.5, steering_limit=0.6), "half_track: must be > 0"),
        (lambda: CarLikeBase(0.1, 0.2, wheelbase=0.5, steering_limit=30), r"steering_limit: .*degrees"),
        (
            lambda: SteeredTricycle(0.1, 0.2, wheelbase=0.5, steering_limit=1.6),
            "steering_limit: must be at most",
        ),
        (lambda: CarLikeBase(0.1, 0.2, 0.5, 0.6, displacement=0), "displacement: must not be 0"),
        (
            lambda: MecanumBase(wheel_radius=0.1, half_track=0, half_wheelbase=0.2),
            "half_track: must be > 0",
        ),
        (
            lambda: OmniBase(wheel_radius=0.1, wheel_distance=0.2, wheel_count=2),
            "wheel_count: must be 3 … 12",
        ),
        (lambda: MecanumBase(wheel_radius=0, half_track=0.1, half_wheelbase=0.2), "wheel_radius"),
    ],
)
def test_bad_numbers(make, message):
    with pytest.raises(Error, match=message):
        make()

"""Twists that come early: what they are, and that lagging joints follow them."""

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.errors import Error
from dqcontrol.references import Circle, Points, Previewed, Square
from dqcontrol.references.previewed import lead

START = [0, 0.6, 0, 1.6, 0, 0.6, 0]


def test_poses_stay_and_twists_lead():
    circle = Circle([1, 0, 0, 0, 0, 0.1, 0.2, 0.3], radius=0.1, duration=4.0)
    times = np.linspace(0.1, 3.5, 200)
    plain, ahead = circle.samples(times), Previewed(circle, delay=0.02, lag=0.05, step=1e-3).samples(times)
    assert np.array_equal(plain[:, :8], ahead[:, :8])
    later = circle.samples(times + 0.02)
    assert np.abs(ahead[:, 11:14] - later[:, 11:14] - 0.05 * later[:, 17:20]).max() < 2e-3


def test_python_leads_to_the_last_bit_as_machine_code_does(monkeypatch):
    square, times = Square([1, 0, 0, 0, 0, 0, 0, 0], side=0.1, duration=8.0), np.linspace(0, 8, 50)
    found = []
    for led in (lead.compiled, lead.function):
        monkeypatch.setattr(type(lead), "worth_compiling", lambda *_, led=led: led)
        found.append(Previewed(square, delay=0.02, lag=0.3, step=0.01).samples(times))
    assert found[0].tobytes() == found[1].tobytes()


def test_a_turning_hand_keeps_its_own_velocity():
    """The twist is that of the pose now: its velocity of the hand is the one that comes later."""
    poses = dqc.load_robot("iiwa7").fkm(np.array(START) + np.linspace(0, 0.3, 5)[:, None])
    path = dqc.references.ViaPoints([0.0, 1.0, 2.0, 3.0, 4.0], poses)
    ahead, now, later = Previewed(path, delay=0.3).at(1.2), path.at(1.2), path.at(1.5)

    def velocity(twist, pose):
        return twist[3:] - np.cross(dqc.algebra.translation(pose), twist[:3])

    assert np.allclose(ahead.twist[:3], later.twist[:3])
    assert np.allclose(velocity(ahead.twist, now.pose), velocity(later.twist, later.pose))


@pytest.mark.parametrize(("kind", "factor"), [("circle", 7), ("square", 2)])
def test_feedforward_with_the_joints_numbers_halves_the_error_and_more(kind, factor):
    shapes = {
        "circle": {"kind": "circle", "radius": 0.06, "duration": 4, "ramp": 0.5},
        "square": {"kind": "square", "side": 0.08, "duration": 6},
    }
    spec = {
        "name": "ahead",
        "robot": "iiwa7",
        "start": START,
        "period": 0.01,
        "law": {"kind": "proportional-feedforward", "gain": 5, "feedforward": "printed"},
        "plant": {"kind": "servo", "time_constant": 0.05, "delay": 0.02},
    }
    plain, ahead = (
        dqc.run(spec | {"reference": shapes[kind] | more}).metrics.position.rms
        for more in ({}, {"preview": {"delay": 0.025, "lag": 0.05}})
    )
    assert ahead < plain / factor
    second = dict(spec, law={"kind": "proportional-feedforward", "gain": 5}, reference=shapes[kind])
    by_itself, none = (
        dqc.run(second | {"reference": shapes[kind] | more}).metrics.position.rms
        for more in ({}, {"preview": {}})
    )
    assert by_itself < ahead / (4 if kind == "circle" else 0.99) < none  # a square's corners decide


def test_corners_come_early_and_the_end_is_one():
    square = Square([1, 0, 0, 0, 0, 0, 0, 0], side=0.1, duration=8.0)
    assert np.allclose(Previewed(square, delay=0.5).corners, [1.5, 3.5, 5.5, 7.5])
    assert np.abs(Previewed(square, delay=0.5).at(7.8).twist).max() == 0


def test_a_jump_is_led_by_as_much_for_the_lag_not_by_a_pulse():
    square = Square([1, 0, 0, 0, 0, 0, 0, 0], side=0.1, duration=8.0)  # 0.05 m/s along each side
    times = 0.01 * np.arange(800)
    led = Previewed(square, delay=0.02, lag=0.05, step=0.01)
    given, plain = led.samples(times)[:, 8:14], square.samples(times + 0.02)[:, 8:14]
    assert np.abs(given).max() < 0.1 + 1e-9
    late = (times + 0.02) % 2.0 > 0.05 + 1e-6
    assert np.abs(given - plain)[late & (times < 7.9)].max() < 1e-12
    made_up = 0.01 * (given - plain)[:150].sum(axis=0)  # of the first side, from a start at speed
    assert np.allclose(made_up, 0.05 * plain[50] * 3 / 5)  # all but the delay that cannot be made up for


@pytest.mark.parametrize("lag", [0.0, 0.005, 0.009, 0.05])
@pytest.mark.parametrize("periods", [0.5, 1.0, 2.2, 2.5, 3.0])
def test_samples_are_led_as_the_motion_that_they_are_of_whatever_the_delay(lag, periods):
    """A piece's twist is that of its middle: read at its start it would come half a period early."""
    circle = Circle([1, 0, 0, 0, 0, 0.3, 0, 0.2], radius=0.1, duration=4.0)
    times, period = 0.01 * np.arange(401), 0.01
    points = Points(times, circle.samples(times)[:, :8])
    given, wanted = (
        Previewed(each, periods * period, lag, period).samples(times[20:380])[:, 11:14]
        for each in (points, circle)
    )
    early = 0.1 * (np.pi / 2) ** 2 * period / 2  # m/s, by which the velocity changes in half a period
    assert np.abs(given - wanted).max() < early / 20
    if lag == 0 and periods == 0.5:
        assert np.array_equal(given, points.samples(times[20:380] + 0.005)[:, 11:14])


def test_a_time_below_zero_is_refused():
    with pytest.raises(Error, match="delay: must be ≥ 0"):
        Previewed(Square([1, 0, 0, 0, 0, 0, 0, 0], side=0.1, duration=8.0), delay=-1)

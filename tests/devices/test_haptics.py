"""Two arms that feel each other: the same way, the same force, and stable where it says so."""

import numpy as np
import pytest
from msgspec.structs import replace

import dqcontrol as dqc
from dqcontrol import algebra
from dqcontrol.errors import Error

ARM, START, T = dqc.load_robot("iiwa7"), np.array([0, 0.6, 0, -1.6, 0, 0.9, 0]), 0.004
PLACE = algebra.translation(ARM.fkm(START))
FREE = dqc.contact.Admittance(axes="base", translation=dqc.contact.Compliance(damping=60.0))
SERVO = dqc.plants.Servo(time_constant=0.01, delay=0.004, wrist=dqc.plants.Wrist(filter=0.002))


def law(contact=None):
    return dqc.laws.ProportionalFeedforward(gain=1.0, contact=contact)


def live(law, plant, period=T):
    at_once = dqc.supervisor.Supervisor(ramp=0.0)
    return dqc.loop.Live(ARM, law, plant, period, start=START, supervisor=at_once)


def pair(stiffness=1000.0, gap=0.01, **more):
    middle = (PLACE[0], PLACE[1], PLACE[2] - gap - 0.02)
    board = dqc.world.Body(box=(0.6, 0.6, 0.04), position=middle, stiffness=stiffness, friction=0.0)
    there = SERVO.in_world(dqc.World(bodies={"board": board}))
    return dqc.devices.Haptics(live(law(FREE), SERVO), live(law(), there), **more)


def heights(both):
    return [algebra.translation(each.state.pose)[2] - PLACE[2] for each in (both.leader, both.follower)]


@pytest.mark.parametrize("scale", [1.0, 0.5])
def test_what_the_hand_feels_is_what_the_follower_presses(scale):
    both = pair(force_scale=scale, delay=0.008)
    both.push[2] = -3.0
    for _ in range(500):
        both.step()
    led, followed = heights(both)
    pressed = both.follower.plant.wrench[:3]
    turn = algebra.matrix_from_pose(both.follower.state.pose)[:3, :3]
    assert (turn @ pressed)[2] == pytest.approx(3.0 / scale, rel=0.01)  # at rest both are in balance
    assert led == pytest.approx(followed, abs=1e-4)
    assert followed == pytest.approx(-0.01 - 3.0 / scale / 1000.0, abs=1e-4)  # into 1000 N/m


def test_in_the_air_both_go_the_same_way_at_what_damping_says():
    both = pair(gap=0.3)
    both.push[:2] = 3.0, -1.5
    for _ in range(250):
        both.step()
    for each in (both.leader, both.follower):
        way = algebra.translation(each.state.pose) - PLACE
        np.testing.assert_allclose(way / 1.0, [0.05, -0.025, 0], atol=2e-3)  # w/D for a second, less the lags


def swing(stiffness, delay):
    """Return by how much what the follower presses varies at the end, against the hand's 3 N."""
    both = pair(stiffness, gap=0.0005, delay=delay)
    both.push[2] = -3.0
    force = []
    for _ in range(900):
        both.step()
        force.append(np.linalg.norm(both.follower.plant.wrench[:3]))
    return np.ptp(force[-250:]) / 3.0


@pytest.mark.parametrize("delay", [0.0, 0.02])
def test_it_is_stable_up_to_the_limit_and_not_far_beyond(delay):
    """Within a quarter, with the hand's own lag, the follower's and both ways in it; friction is not in it."""
    limit = pair(delay=delay).limits().stiffness
    assert swing(0.9 * limit, delay) < 0.05
    assert swing(1.25 * limit, delay) > 0.5


def test_a_longer_way_bears_less():
    limits = [pair(delay=delay).limits() for delay in (0.0, 0.02, 0.1)]
    assert limits[0].stiffness > limits[1].stiffness > limits[2].stiffness
    half, whole = pair(force_scale=0.5).limits().stiffness, limits[0].stiffness
    assert half == pytest.approx(2 * whole)


def test_mistakes_are_one_clear_line():
    both = pair()
    numb = live(law(), replace(SERVO, wrist=None))
    with pytest.raises(Error, match="leader: its law has no contact"):
        dqc.devices.Haptics(both.follower, both.follower)
    with pytest.raises(Error, match="follower: its plant measures no wrench"):
        dqc.devices.Haptics(both.leader, numb)
    slow = live(law(), SERVO, 0.01)
    with pytest.raises(Error, match=r"follower: has a period of 0\.01 s, the leader 0\.004 s"):
        dqc.devices.Haptics(both.leader, slow)
    for numbers, message in (
        ({"delay": -0.01}, "delay: must be ≥ 0, got -0.01"),
        ({"delay": float("nan")}, "delay: must be finite"),
        ({"force_scale": 0.0}, "force_scale: must be > 0, got 0"),
    ):
        with pytest.raises(Error, match=message):
            dqc.devices.Haptics(both.leader, both.follower, **numbers)

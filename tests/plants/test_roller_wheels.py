"""Mecanum and omni wheels in physics, roller by roller, against their kinematics, alone and under an arm."""

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.errors import ValueRangeError
from dqcontrol.plants import MobilePlant, WheeledBase

pytest.importorskip("mujoco", reason="needs MuJoCo: pip install 'dqcontrol[physics]'")

MECANUM = dqc.MecanumBase(wheel_radius=0.05, half_track=0.158, half_wheelbase=0.228)  # a youBot's
OMNI = dqc.OmniBase(wheel_radius=0.05, wheel_distance=0.2)
BODY = {"mass": 26.0, "height": 0.09, "wheel_mass": 0.4, "wheel_torque": 5.0}
T = 0.02


def moved(live, inputs, periods):
    before = live.q.copy(), live.odometry
    for _ in range(periods):
        live.step(np.array(inputs, dtype=float))
    return live.q - before[0], live.odometry - before[1]


@pytest.mark.parametrize("base", [MECANUM, OMNI], ids=lambda base: base.kind)
def test_it_goes_where_its_wheels_say(base):
    live = MobilePlant(base=WheeledBase(**BODY)).start(dqc.WholeBody([base]), np.zeros(3), T, 1, 0)
    for inputs in ([0.2, 0.0, 0.0], [0.0, 0.2, 0.0], [0.0, 0.0, 0.5]):
        moved(live, inputs, 15)  # it comes up to speed
        went, told = moved(live, inputs, 20)
        np.testing.assert_allclose(went / (20 * T), inputs, rtol=0, atol=0.03)
        np.testing.assert_allclose(told, went, rtol=0, atol=0.01)  # its odometry sees no slip


def test_it_carries_an_arm_and_moves_in_the_axes_of_the_room():
    arm = dqc.load_robot("youbot-arm")
    mount = dqc.DualQuaternion.from_translation([0.226, 0, 0.144])
    base = dqc.MecanumBase(wheel_radius=0.05, half_track=0.158, half_wheelbase=0.228, rim_speed=0.4)
    robot = dqc.WholeBody([base, mount, arm])
    start = np.array([0, 0, np.pi / 2, 0, 0.6, 0.9, 0.6, 0])
    plant = MobilePlant(base=WheeledBase(**BODY), link_mass=0.5)
    live = plant.start(robot, start, T, 1, 0)
    went, _ = moved(live, [0.2, 0.0, 0.0, 0.3, 0, 0, 0, 0], 40)  # it faces along y, so that is to its right
    assert went[0] == pytest.approx(0.16, abs=0.02)
    assert np.abs(went[1:3]).max() < 0.02
    assert went[3] == pytest.approx(0.3 * 40 * T, abs=0.03)
    names = [channel.name for channel in live.channels]
    assert names[:3] == ["wheel_angle", "wheel_torque", "wheel_slip"]
    moved(live, [0.4, 0.4, 0.0, 0, 0, 0, 0, 0], 20)  # twice as fast as the rims may be
    before = live.readings[:4].copy()
    moved(live, [0.4, 0.4, 0.0, 0, 0, 0, 0, 0], 10)
    assert np.abs(live.readings[:4] - before).max() / (10 * T) * base.wheel_radius < 0.4 * 1.01


def test_bad_numbers():
    cart = dqc.WholeBody([MECANUM])
    for base, message in (
        (WheeledBase(), "missing: mass, height, wheel_mass, wheel_torque. Give them here"),
        (
            WheeledBase(**BODY, radius=0.2),
            r"plant.base.radius: leave it out.*mecanum wheels, without casters",
        ),
        (
            WheeledBase(**BODY, wheel_errors=(0.01, 0.0)),
            "wheel_errors: expected 4 numbers, one a wheel, got 2",
        ),
    ):
        with pytest.raises(ValueRangeError, match=message):
            MobilePlant(base=base).start(cart, np.zeros(3), T, 1, 0)
    with pytest.raises(ValueRangeError, match="roller_count: must be ≥ 8, got 3"):
        WheeledBase(roller_count=3)

"""Mecanum and omni wheels in physics, roller by roller, against their kinematics."""

import numpy as np
import pytest

from dqcontrol.errors import Error
from dqcontrol.robots import MecanumBase, OmniBase

pytest.importorskip("mujoco", reason="needs MuJoCo: pip install 'dqcontrol[physics]'")

from dqcontrol.plants.mobile.roller_physics import RollerPhysics, drive_square

MECANUM = MecanumBase(wheel_radius=0.05, half_track=0.158, half_wheelbase=0.228)  # a youBot's
OMNI = OmniBase(wheel_radius=0.05, wheel_distance=0.2)


@pytest.mark.slow
@pytest.mark.parametrize("base", [MECANUM, OMNI], ids=lambda base: base.kind)
def test_a_square_is_as_long_as_kinematics_says(base):
    lengths, end, slip = drive_square(RollerPhysics(base, mass=27.0))
    print(f"{base.kind}: sides {lengths.round(4)} m, end {end.round(4)}, greatest slip {slip:.3g} m/s")
    np.testing.assert_allclose(lengths, 2.0, rtol=0.05)
    assert np.linalg.norm(end[:2]) < 0.05 * 8.0


@pytest.mark.parametrize("base", [MECANUM, OMNI], ids=lambda base: base.kind)
@pytest.mark.parametrize("twist", [[0.2, 0.0, 0.0], [0.0, 0.2, 0.0], [0.0, 0.0, 0.5]], ids=str)
def test_it_goes_where_its_wheels_say(base, twist):
    robot = RollerPhysics(base, mass=27.0)
    for _ in range(10):
        robot.step(twist, 0.02)  # it comes up to speed
    before = robot.pose.copy()
    for _ in range(20):
        robot.step(twist, 0.02)
    np.testing.assert_allclose((robot.pose - before) / 0.4, twist, rtol=0, atol=0.03)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"mass": 0.0}, "mass: must be > 0"),
        ({"friction": -1.0}, "friction: must be > 0"),
        ({"roller_count": 3}, "roller_count: must be 8 … 32, got 3"),
    ],
)
def test_bad_numbers(change, message):
    with pytest.raises(Error, match=message):
        RollerPhysics(MECANUM, **({"mass": 20.0} | change))

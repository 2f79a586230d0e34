import numpy as np
import pytest
from numba import njit

from dqcontrol import load_robot
from dqcontrol.robots.kinematics.sin_cos import FARTHEST, sines_cosines


@njit
def both(values, out):
    sines_cosines(values, values.shape[0], out)


@pytest.mark.parametrize("reach", [1e-300, 1e-8, 1e-3, 1.0, 10.0, 1e3, FARTHEST])
def test_sine_and_cosine_are_right_to_two_units_in_the_last_place(reach):
    rng = np.random.default_rng(7)
    quarters = np.pi / 2 * np.arange(-8, 9)  # where the reduction cancels most
    near = (quarters[:, None] + rng.uniform(-1e-9, 1e-9, (17, 100))).ravel()
    values = np.concatenate([rng.uniform(-reach, reach, 100_000), [0.0, -0.0, reach, -reach], near])
    out = np.empty(2 * len(values))
    both(values, out)
    exact = values.astype(np.longdouble)
    for got, true in ((out[: len(values)], np.sin(exact)), (out[len(values) :], np.cos(exact))):
        unit = np.spacing(np.abs(true.astype(np.float64)))
        assert (np.abs(got - true) <= 2 * unit).all()


def test_far_angles_turn_as_their_remainder():
    arm = load_robot("iiwa7")
    q = np.array([1e6, -3e7, 2.5e5, 0.1, 4e8, 0.0, 1.0])
    near = np.arctan2(np.sin(q), np.cos(q))
    turns = np.round((q - near) / (2 * np.pi))
    sign = -1.0 if turns.sum() % 2 else 1.0  # half angles: an odd number of turns gives the other sign
    assert np.allclose(arm.fkm(q), sign * arm.fkm(near), atol=1e-12)
    assert np.allclose(arm.twist_jacobian(q), arm.twist_jacobian(near), atol=1e-12)

"""Odometry against an ODE solver, and its error against the bounds of its ticks."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import dqcontrol as dqc
from dqcontrol.errors import ShapeError, ValueRangeError
from dqcontrol.plants import Odometry

SEED = 20261207
DRIVE = dqc.DifferentialDrive(wheel_radius=0.065, half_track=0.13)
START = np.array([0.3, -0.2, 0.7])


def driven(speeds, dt):
    """Return pose and wheel angles after each of the wheels' speeds (right, left) has acted for dt."""
    r, b = DRIVE.wheel_radius, DRIVE.half_track

    def rates(t, state):
        right, left = speeds[min(int(t / dt), len(speeds) - 1)]
        v = r * (right + left) / 2
        return [v * math.cos(state[2]), v * math.sin(state[2]), r * (right - left) / (2 * b), right, left]

    states = [np.array([*START, 0, 0])]
    for k in range(len(speeds)):
        part = solve_ivp(
            lambda t, state, k=k: rates(k * dt + 0.5 * dt, state), (0, dt), states[-1], rtol=1e-12, atol=1e-13
        )
        states.append(part.y[:, -1])
    return np.array(states)[1:]


def test_fine_ticks_give_the_path_of_an_ode_solver():
    speeds = np.random.default_rng(SEED).normal(size=(60, 2)) * 5
    odometry = Odometry(DRIVE, START, ticks=1e12)
    for state in driven(speeds, 0.05):
        odometry.read(state[3:])
        assert odometry.pose == pytest.approx(state[:3], abs=1e-9)


@pytest.mark.parametrize("ticks", [50, 508.8])
def test_error_of_heading_and_path_keep_the_bounds_of_the_ticks(ticks):
    """Each wheel is off by Δ/2 at most; so is the heading by r Δ/(2b), and a path of length s by r Δ/2 + s r Δ/(2b)."""
    speeds = np.random.default_rng(SEED).normal(size=(200, 2)) * 3 + 4
    tick = 2 * math.pi / ticks
    r, b = DRIVE.wheel_radius, DRIVE.half_track
    odometry, length = Odometry(DRIVE, START, ticks), 0.0
    worst = 0.0
    for state, (right, left) in zip(driven(speeds, 0.02), speeds, strict=True):
        odometry.read(state[3:])
        length += 0.02 * r * (abs(right) + abs(left)) / 2
        heading = abs(odometry.pose[2] - state[2])
        worst = max(worst, heading)
        assert heading <= r * tick / (2 * b) + 1e-12
        assert np.hypot(*(odometry.pose[:2] - state[:2])) <= r * tick / 2 * 2**0.5 + length * r * tick / (
            2 * b
        )
    assert worst > 0.1 * r * tick / (2 * b)  # the ticks are felt


@pytest.mark.parametrize(
    ("start", "ticks", "error", "text"),
    [
        (START, 0, ValueRangeError, "ticks: must be > 0"),
        (START, -5, ValueRangeError, "ticks: must be > 0"),
        (START[:2], 100, ShapeError, r"start: expected shape \(…, 3\)"),
    ],
)
def test_bad_input(start, ticks, error, text):
    with pytest.raises(error, match=text):
        Odometry(DRIVE, start, ticks)

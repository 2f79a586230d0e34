"""A small search that tests share."""

import copy

import pytest

import dqcontrol as dqc

START = [0, 0.6, 0, 1.6, 0, 0.6, 0]


@pytest.fixture(scope="session")
def small_problem():
    return {
        "name": "small",
        "robot": "iiwa7",
        "start": START,
        "period": 0.01,
        "reference": {"kind": "circle", "radius": 0.03, "duration": 1.5, "corner_stops": 0.3},
        "laws": {
            "K": {"kind": "proportional", "gain": 5},
            "K+FF+I": {"kind": "proportional-feedforward", "gain": 5, "integral_gain": 2},
        },
        "plant": {"kind": "servo", "time_constant": 0.05, "delay": 0.02, "encoder_noise": 2e-4},
        "tune": {"budget": 16},
    }


@pytest.fixture
def problem(small_problem):
    return copy.deepcopy(small_problem)


@pytest.fixture(scope="session")
def tuned(small_problem):
    return dqc.tune(copy.deepcopy(small_problem), jobs=1)

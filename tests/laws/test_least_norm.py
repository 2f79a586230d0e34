"""The generated solver of the hand's twist against NumPy's pseudoinverse, and against its generator."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest
from numba import njit

from dqcontrol import load_robot
from dqcontrol.laws import least_norm as module
from dqcontrol.laws.growth import NO_ERROR
from dqcontrol.laws.least_norm import least_norm

TOOL = Path(__file__).parents[2] / "tools/generate_least_norm.py"


@njit
def solved(jacobian, position, twist, z, square_length, limit, out):
    px, py, pz = position[0], position[1], position[2]
    return least_norm(jacobian, px, py, pz, twist, z, NO_ERROR, 0.0, square_length, limit, 1.0, 0.0, out)


def test_the_file_is_what_the_tool_writes():
    spec = importlib.util.spec_from_file_location("generate_least_norm", TOOL)
    assert spec is not None
    assert spec.loader is not None
    tool = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(tool)
    assert Path(module.__file__).read_text(encoding="utf-8") == tool.generate()


@pytest.mark.parametrize("robot", ["iiwa7", "ur5", "panda"])
def test_least_norm_and_its_limit_are_those_of_the_singular_values(robot):
    arm, rng = load_robot(robot), np.random.default_rng(3)
    angular, linear, refused = 2e-3, 5e-4, 0
    weight = np.sqrt([angular] * 3 + [linear] * 3)
    for _ in range(300):
        q = rng.uniform(-2, 2, arm.input_size)
        jacobian, position, twist = arm.twist_jacobian(q), rng.normal(size=3), rng.normal(size=6)
        z = rng.normal(size=arm.input_size)
        hand = jacobian.copy()
        hand[3:] -= np.cross(position[:, None], jacobian[:3], axis=0)
        out = np.zeros(arm.input_size)
        trace = (1 / np.linalg.svd(hand / weight[:, None], compute_uv=False) ** 2).sum()
        assert solved(jacobian, position, twist, z, linear / angular, linear, out) == (trace <= 1)
        if trace <= 1:
            assert np.allclose(out, z + np.linalg.pinv(hand) @ (twist - hand @ z), rtol=1e-9, atol=1e-9)
        else:
            refused += 1
    assert 0 < refused < 300

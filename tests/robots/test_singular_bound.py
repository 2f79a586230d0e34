"""Whether a Jacobian is far from singular, which supervisors ask each period."""

import importlib.util
from pathlib import Path

import numpy as np
from numba import njit

from dqcontrol.robots.kinematics import singular_bound as module
from dqcontrol.robots.kinematics.singular_bound import exceeds

TOOL = Path(__file__).parents[2] / "tools/generate_singular_bound.py"


@njit
def far(jacobian, least):
    return exceeds(jacobian, least)


def test_the_file_is_what_the_tool_writes():
    spec = importlib.util.spec_from_file_location("generate_singular_bound", TOOL)
    assert spec is not None
    assert spec.loader is not None
    tool = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(tool)
    assert Path(module.__file__).read_text(encoding="utf-8") == tool.source()


def test_it_says_so_up_to_the_smallest_singular_value_and_no_further():
    rng = np.random.default_rng(20261122)
    for _ in range(300):
        u, values, v = np.linalg.svd(rng.normal(size=(6, rng.integers(6, 10))), full_matrices=False)
        values[-1] *= 10 ** rng.uniform(-2, 0)
        jacobian = 10 ** rng.uniform(-2, 2) * u @ np.diag(values) @ v
        least = np.linalg.svd(jacobian, compute_uv=False)[-1]
        assert far(jacobian, 0.99 * least)
        assert not far(jacobian, 1.001 * least)
    assert not far(np.ones((6, 7)), 0.0), "without full rank"
    assert not far(rng.normal(size=(6, 5)), 0.0), "fewer columns than rows"
    assert not far(np.full((6, 7), np.nan), 0.01)
    assert not far(1e60 * rng.normal(size=(6, 7)), 0.01), "beyond what numbers can say"

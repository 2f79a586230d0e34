"""The bound on the smallest singular value that supervisors ask for each period."""

import importlib.util
from pathlib import Path

import numpy as np
from numba import njit

from dqcontrol.robots import singular_bound as module
from dqcontrol.robots.singular_bound import singular_bound

TOOL = Path(__file__).parents[2] / "tools/generate_singular_bound.py"


@njit
def bound(jacobian):
    return singular_bound(jacobian)


def test_the_file_is_what_the_tool_writes():
    spec = importlib.util.spec_from_file_location("generate_singular_bound", TOOL)
    assert spec is not None
    assert spec.loader is not None
    tool = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(tool)
    assert Path(module.__file__).read_text(encoding="utf-8") == tool.source()


def test_it_is_the_trace_of_the_inverse_and_below_the_smallest_singular_value():
    rng = np.random.default_rng(20261122)
    for n in (6, 7, 9):
        jacobian = rng.normal(size=(6, n))
        values = np.linalg.svd(jacobian, compute_uv=False)
        np.testing.assert_allclose(bound(jacobian), (1 / values**2).sum() ** -0.5, rtol=1e-9)
        assert bound(jacobian) <= values[-1]
    assert bound(np.ones((6, 7))) == 0.0

"""Arms that the tests of several packages drive."""

import signal

import hypothesis
import numpy as np
import pytest

from dqcontrol.robots import Inertia, SerialArm

# The same examples in each run, and no bound on how long one takes: a busy machine is no fault.
hypothesis.settings.register_profile(
    "steady", derandomize=True, deadline=None, suppress_health_check=[hypothesis.HealthCheck.too_slow]
)
hypothesis.settings.load_profile("steady")

# A shell starts what it runs in the background with SIGINT ignored: the tests are the same there.
signal.signal(signal.SIGINT, signal.default_int_handler)


def _arm(n, prismatic=(), seed=0, limits=None, mass=None):
    rng = np.random.default_rng([seed, n])
    size = 1.5 / n
    inertia = None
    if mass is not None:
        inertia = Inertia(
            np.full(n, mass), rng.uniform(-size, size, (n, 3)) / 2, np.tile(0.01 * np.eye(3), (n, 1, 1))
        )
    return SerialArm.from_dh(
        theta=rng.uniform(-1, 1, n),
        d=rng.uniform(0.3, 1, n) * size,
        a=rng.uniform(0.3, 1, n) * size,
        alpha=rng.choice([-1.6, 1.6], n) + rng.uniform(-0.3, 0.3, n),
        joint_types=["prismatic" if i in prismatic else "revolute" for i in range(n)],
        tool=[np.cos(0.3), 0, np.sin(0.3), 0, 0, 0.05, 0, 0.02] @ _unit_dual(),
        limits=limits,
        inertia=inertia,
        name=f"arm of {n}",
    )


def _unit_dual():
    """Return the matrix that takes the part along P off the dual part of the tool above."""
    tool = np.array([np.cos(0.3), 0, np.sin(0.3), 0])
    off = np.eye(8)
    off[4:, 4:] -= np.outer(tool, tool)
    return off


@pytest.fixture(scope="session")
def make_arm():
    """Return a function that makes an arm of n joints, 1.5 m long or so, of the same numbers each time."""
    return _arm


@pytest.fixture(scope="session")
def slide():
    """Return one sliding joint along x: its closed loop is linear, q⁺ = q + kT (q_d − q)."""
    return SerialArm.from_dh(
        [np.pi / 2], [0], [0], [np.pi / 2], ["prismatic"], base=[0.5, 0.5, 0.5, 0.5, 0, 0, 0, 0]
    )


@pytest.fixture
def few_figures(monkeypatch):
    """Draw only some figures of a run that is saved: all of them take seconds."""
    from dqcontrol import figures

    draw = figures.run_figures

    def few(*arguments, **options):
        drawn = draw(*arguments, **options)
        return {name: drawn[name] for name in drawn if name in ("errors", "inputs", "timing")}

    monkeypatch.setattr(figures, "run_figures", few)


@pytest.fixture
def without_growth(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let damping depend on the Jacobian alone, as the laws' definitions have it, also far from the target."""
    none = np.zeros(1), np.ones(1)
    monkeypatch.setattr("dqcontrol.controller.controller.growth_for", lambda *_: none)

"""CoppeliaSim's plant: against a double that speaks its protocol, and against the simulator itself if there is one."""

import os
import sys

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.errors import Error, MissingExtraError, ShapeError, ValueRangeError
from dqcontrol.plants import CoppeliaPlant

PATHS = [f"/iiwa/joint{i}" for i in range(1, 8)]
START = np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])


@pytest.fixture
def served():
    pytest.importorskip("coppeliasim_zmqremoteapi_client")
    from coppeliasim_double import Double, serving

    double = Double(PATHS)
    with serving(double) as port:
        yield double, port


def started(port, period=0.01, joints=PATHS, **options):
    plant = CoppeliaPlant(joints=joints, port=port, timeout=1.0, **options)
    return plant.start(dqc.load_robot("iiwa7"), START, period, 10, 0)


def test_starts_where_it_is_told_and_steps_with_the_period(served):
    double, port = served
    live = started(port)
    assert double.running
    assert [double.position[100 + i] for i in range(7)] == START.tolist()
    rate = np.arange(7) / 10
    live.step(rate)
    live.step(rate)
    np.testing.assert_allclose(live.q, START + 0.02 * rate, atol=1e-15)
    assert [call[0] for call in double.calls].count("sim.step") == 4  # two of 5 ms in each period of 10 ms
    live.close()
    assert (double.running, double.stepping) == (False, False)


def test_targets_count_from_the_measured_joints_if_asked(served):
    _, port = served
    live = started(port, command_mode="measured")
    live.measured[:] += 0.5
    live.step(np.ones(7))
    np.testing.assert_allclose(live.q, START + 0.51, atol=1e-15)


def test_velocities_are_sent_as_such(served):
    double, port = served
    live = started(port, command_mode="velocity")
    live.step(np.full(7, 2.0))
    np.testing.assert_allclose(live.q, START + 0.02, atol=1e-15)
    assert not double.target


@pytest.mark.parametrize("supervised", [True, False])
def test_runs_a_spec_as_the_integrator_does_behind_a_supervisor_unless_told_otherwise(served, supervised):
    _, port = served
    spec = {
        "name": "tiny", "robot": "iiwa7", "start": START.tolist(), "period": 0.01,
        "reference": {"kind": "circle", "radius": 0.05, "duration": 0.5},
        "law": {"kind": "proportional", "gain": 5},
    }  # fmt: skip
    simulator = {"kind": "coppeliasim", "joints": PATHS, "port": port}
    there = dqc.run({**spec, "plant": simulator} | ({} if supervised else {"supervisor": False}))
    here = dqc.run({**spec, "plant": {"kind": "integrator"}, "supervisor": supervised})
    assert ("interventions" in there.record.readings) is supervised
    np.testing.assert_allclose(there.q, here.q, atol=1e-12)


def test_what_is_wrong_is_said_in_one_line(served):
    double, port = served
    with pytest.raises(ShapeError, match="expected 7 paths, got 1"):
        started(port, joints=["/a"])
    with pytest.raises(ValueRangeError, match="no '/iiwa/x' in the scene"):
        started(port, joints=[*PATHS[:6], "/iiwa/x"])
    with pytest.raises(ValueRangeError, match=r"time step is 0\.005 s"):
        started(port, period=0.008)
    live = started(port)
    with pytest.raises(ShapeError, match="command"):
        live.step(np.zeros(3))
    with pytest.raises(ValueRangeError, match="finite"):
        live.step(np.full(7, np.nan))
    double.running = False
    with pytest.raises(Error, match=r"CoppeliaSim at 127\.0\.0\.1.*not stepping"):
        live.step(np.zeros(7))


def test_silence_is_said_after_the_timeout(served):
    double, port = served
    live = started(port)
    double.mute = True
    with pytest.raises(Error, match="does not answer"):
        live.step(np.zeros(7))


def test_without_the_client_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "coppeliasim_zmqremoteapi_client", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'dqcontrol\[coppeliasim\]'"):
        started(1)


@pytest.mark.skipif("COPPELIASIM_JOINTS" not in os.environ, reason="needs CoppeliaSim: see docs/ros2.md")
def test_a_joint_moves_in_the_simulator():
    joints = os.environ["COPPELIASIM_JOINTS"].split(",")
    host, port = (
        os.environ.get("COPPELIASIM_HOST", "127.0.0.1"),
        int(os.environ.get("COPPELIASIM_PORT", "23000")),
    )
    plant = CoppeliaPlant(joints=joints, host=host, port=port)
    live = plant.start(dqc.load_robot("iiwa7"), START, 0.05, 20, 0)
    for _ in range(20):
        live.step(np.array([0.2, 0, 0, 0, 0, 0, 0]))
    assert 0.1 < live.q[0] - START[0] < 0.25
    live.close()

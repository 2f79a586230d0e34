"""A payload weighed by the wrist sensor and carried by the joint controllers' model of gravity."""

from pathlib import Path

import msgspec
import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.errors import ShapeError, ValueRangeError
from dqcontrol.plants import CompliantPlant, Payload, PayloadCompensation, Push, WristFault
from dqcontrol.plants.compliant.controller_file import load_controllers

pytest.importorskip("mujoco")

IIWA, MEKA = dqc.load_robot("iiwa7"), dqc.load_robot("meka-a2")
QI = np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])
Q0 = np.array([0, np.pi / 5, 0, np.pi / 2, 0, np.pi / 5, 0])
T, MASS = 0.008, 0.9
G = np.array([0, 0, -9.809])
TAU = 0.5


def start(arm=IIWA, q=QI, **fields):
    fields = {
        "payload": Payload(mass=MASS),
        "payload_compensation": PayloadCompensation(time_constant=TAU),
    } | fields
    return CompliantPlant(**fields).start(arm, q, T, 0, 7)


def rest(live, seconds):
    for _ in range(round(seconds / T)):
        live.step(np.zeros(7))


def estimate(live):
    return live.readings[-1]


def biased(tmp_path, bias):
    data = msgspec.to_builtins(load_controllers(IIWA))
    data["wrist_sensor"]["force_bias"] = bias
    path = tmp_path / "biased.yaml"
    path.write_bytes(msgspec.yaml.encode(data))
    return str(path)


@pytest.mark.parametrize("bias", [(0.0, 0.0, 0.0), (0.5, -0.3, 0.8)])
def test_sag_that_is_left_is_that_of_the_sensors_bias(tmp_path, bias):
    """k_p (r − q) = Jᵀ(m̂ − m) g on joints without torque error, and m̂ − m = b · g/|g|² with the bias b."""
    path = biased(tmp_path, list(bias))
    live = start(controllers=path)
    rest(live, 6.0)
    down = dqc.DualQuaternion(IIWA.fkm(live.q)).matrix()[:3, :3].T @ G
    wrong = np.array(bias) @ down / (down @ down)
    assert estimate(live) == pytest.approx(MASS + wrong, abs=3e-3)
    k_p = load_controllers(IIWA).column("position_loop", "k_p")
    give = IIWA.translation_jacobian(live.q).T @ ((MASS - estimate(live)) * G) / k_p
    np.testing.assert_allclose(live.q - live.reference, give, atol=3e-5)
    sagging = start(controllers=path, payload_compensation=None)
    rest(sagging, 6.0)
    expected = IIWA.translation_jacobian(sagging.q).T @ (MASS * G) / k_p
    np.testing.assert_allclose(sagging.q - sagging.reference, expected, rtol=0.02, atol=3e-5)
    assert np.abs(live.q - QI).max() < 0.15 * np.abs(sagging.q - QI).max()


def test_it_knows_the_hand_and_forgets_what_is_gone():
    live = start(MEKA, Q0, hand=True, payload=Payload(mass=MASS, begin=1.0, until=4.0))
    rest(live, 1.0)
    assert estimate(live) < 0.01
    rest(live, 2.9)
    assert estimate(live) == pytest.approx(MASS, abs=0.02)
    rest(live, 4.0)
    assert estimate(live) < 0.01


def test_the_estimate_is_a_low_pass_of_the_weight():
    live = start(payload=Payload(mass=MASS, begin=1.0))
    rest(live, 1.0)
    for _ in range(4):
        rest(live, 0.24)
        assert estimate(live) == pytest.approx(MASS * -np.expm1(-(live.time - 1.0) / TAU), abs=0.08)


@pytest.mark.parametrize("force", [(500.0, -300.0, 800.0), (0.0, 0.0, -1e4)])
def test_a_wild_sensor_does_not_move_the_arm(force):
    live = start(wrist_fault=WristFault(time=4.0, duration=2.0, force=force))
    rest(live, 3.99)
    before, q = estimate(live), live.q.copy()
    rest(live, 2.0)
    assert estimate(live) == pytest.approx(before, abs=2e-3)
    assert np.abs(live.q - q).max() < 1e-4
    rest(live, 2.0)
    assert estimate(live) == pytest.approx(MASS, abs=5e-3)


def test_a_dead_sensor_lets_the_arm_sag_slowly_and_no_further_than_without():
    live = start(wrist_fault=WristFault(time=3.0, duration=10.0))
    rest(live, 3.0)
    q = live.q.copy()
    for _ in range(250):
        before = live.q.copy()
        live.step(np.zeros(7))
        assert np.abs(live.q - before).max() / T < 0.02  # rad/s
    sagging = start(payload_compensation=None)
    rest(sagging, 5.0)
    assert np.abs(live.q - q).max() < 1.05 * np.abs(sagging.q - QI).max()


def test_a_blow_is_no_payload():
    blow = Push(time=3.0, duration=1.0, force=(0.0, 0.0, -40.0))
    live = start(payload=None, pushes=[blow])
    rest(live, 4.0)
    assert estimate(live) < 0.05


@pytest.mark.slow
def test_the_example_says_what_each_buys():
    study = dqc.run_study(Path(__file__).parents[2] / "examples/payload.yaml")
    mean = {(row["law"], row["plant"]): float(row["position.settled_mean"]) for row in study.rows}
    assert mean["K+FF", "payload weighed"] < 0.5 * mean["K+FF", "payload"]
    assert mean["K+FF+I", "payload"] < 0.2 * mean["K+FF", "payload"]
    assert mean["K+FF+I", "payload weighed"] < mean["K+FF+I", "payload"]
    page = (Path(__file__).parents[2] / "docs/physics.md").read_text()
    assert study.table().markdown().split("\n\n")[-1].strip() in page


def test_runs_are_repeatable_to_the_last_bit():
    runs = []
    for _ in range(2):
        live = start(MEKA, Q0)
        rest(live, 0.5)
        runs.append(np.concatenate([live.q, live.readings]))
    assert (runs[0] == runs[1]).all()


@pytest.mark.parametrize(
    ("fields", "error", "words"),
    [
        (
            {"mode": "THETA"},
            ValueRangeError,
            "plant.payload_compensation: needs a mode with a model of gravity",
        ),
        (
            {"gravity": (0, 0, 0)},
            ValueRangeError,
            "plant.payload_compensation: nothing weighs without gravity",
        ),
    ],
)
def test_what_does_not_fit_is_named(fields, error, words):
    with pytest.raises(error, match=words):
        start(**fields)


@pytest.mark.parametrize(
    ("kind", "fields", "words"),
    [
        (PayloadCompensation, {"time_constant": -1.0}, "time_constant: must be > 0, got -1"),
        (WristFault, {"time": 0, "duration": 0}, "duration: must be > 0, got 0"),
        (WristFault, {"time": 0, "duration": 1, "force": (1.0, 2.0)}, "force: expected a list of length 3"),
    ],
)
def test_what_is_beyond_its_bounds_is_refused_as_it_is_made(kind, fields, words):
    with pytest.raises((ValueRangeError, ShapeError), match=words):
        kind(**fields)

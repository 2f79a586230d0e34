"""Obstacles against the hand: press at rest, impact, momentum, and the numbers that judge a contact."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.errors import FileFormatError, ShapeError, ValueRangeError
from dqcontrol.files.yaml_file import convert
from dqcontrol.loop import Record
from dqcontrol.loop.signals import Signal
from dqcontrol.measures.contact import RECOVERED, peak_contact, recovery_time
from dqcontrol.plants import CompliantPlant, Obstacle, Push
from dqcontrol.plants.compliant.controller_file import load_controllers
from dqcontrol.plants.compliant.elastic_model import joint_inertia

mujoco: Any = pytest.importorskip("mujoco")

SEED = 20261121
IIWA, MEKA = dqc.load_robot("iiwa7"), dqc.load_robot("meka-a2")
QI = np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])
Q0 = np.array([0, np.pi / 5, 0, np.pi / 2, 0, np.pi / 5, 0])
WAY = np.array([2.0, -1.0, 2.0]) / 3


def point(q, arm=IIWA):
    return dqc.DualQuaternion(arm.fkm(q)).translation


def ball(depth, **fields):
    """Return an obstacle into which the hand at QI reaches by so much; it pushes along WAY."""
    return Obstacle(position=tuple(point(QI) - (0.1 - depth) * WAY), radius=0.1, **fields)


def contact(live):
    return live.readings[-3:].copy()


def rest(live, seconds, period=0.008):
    for _ in range(round(seconds / period)):
        live.step(np.zeros(7))


def test_a_pad_pushes_by_depth_and_by_the_speed_of_the_hand_into_it():
    """F = k δ − d wᵀJ q̇ in the first step."""
    plant = CompliantPlant(mode="OFF", gravity=(0, 0, 0), obstacles=[ball(1e-3, stiffness=1e3, damping=20.0)])
    rng, felt = np.random.default_rng(SEED), []
    for _ in range(10):
        live = plant.start(IIWA, QI, 0.001, 0, 0)
        live.data.qvel[:] = velocity = rng.uniform(-0.2, 0.2, 7)
        live.step(np.zeros(7))
        force = max(0.0, 1.0 - 20.0 * float(WAY @ IIWA.translation_jacobian(QI) @ velocity))
        np.testing.assert_allclose(contact(live), force * WAY, atol=1e-11)
        felt.append(force > 0)
    assert any(felt)
    assert not all(felt), SEED


def test_a_press_at_rest_is_the_depth_over_pad_and_joints_in_series():
    """F = δ / (1/k + wᵀJ K⁻¹Jᵀ w), K the stiffness of the position loops, along the pad's way w."""
    stiffness, depth = 2000.0, 0.01
    plant = CompliantPlant(obstacles=[ball(depth, stiffness=stiffness, damping=50.0)])
    live = plant.start(IIWA, QI, 0.008, 0, 0)
    rest(live, 3.0)
    compliance = IIWA.translation_jacobian(QI) / load_controllers(IIWA).column("position_loop", "k_p")
    joints = WAY @ compliance @ IIWA.translation_jacobian(QI).T @ WAY
    expected = depth / (1 / stiffness + joints)
    assert 0.2 < joints * stiffness < 20
    assert np.linalg.norm(contact(live)) == pytest.approx(expected, rel=0.02)
    left = 0.1 - np.linalg.norm(point(live.q) - np.array(plant.obstacles[0].position))
    assert np.linalg.norm(contact(live)) == pytest.approx(stiffness * left, rel=1e-4)
    give = (
        IIWA.translation_jacobian(live.q).T
        @ contact(live)
        / load_controllers(IIWA).column("position_loop", "k_p")
    )
    np.testing.assert_allclose(live.q - live.reference, give, rtol=0.02, atol=5e-5)


@pytest.mark.parametrize("accurate", [False, True])
def test_an_impact_has_the_peak_of_a_mass_on_a_spring_and_keeps_the_momentum(accurate):
    """Without motors and gravity: peak v √(k m), M Δq̇ = Jᵀ ∫F dt − b Δq, m = 1 / wᵀJ M⁻¹Jᵀw."""
    stiffness, speed, n = 4000.0, 0.1, 7
    obstacle = ball(-1e-3, stiffness=stiffness, velocity=tuple(speed * WAY))
    plant = CompliantPlant(mode="OFF", gravity=(0, 0, 0), obstacles=[obstacle], accurate=accurate)
    live = plant.start(IIWA, QI, 0.001, 0, 0)
    inertia = joint_inertia(live.model, live.data)[:n, :n]
    jacobian = IIWA.translation_jacobian(QI)
    mass = 1 / (WAY @ jacobian @ np.linalg.solve(inertia, jacobian.T) @ WAY)
    impulse, peak = np.zeros(3), 0.0
    for _ in range(200):
        live.step(np.zeros(n))
        impulse += 1e-3 * contact(live)
        peak = max(peak, float(np.linalg.norm(contact(live))))
    assert not contact(live).any()
    velocity, moved = live.data.qvel[:n], live.q - QI
    friction = live.model.dof_damping[:n] * moved
    np.testing.assert_allclose(
        inertia @ velocity, jacobian.T @ impulse - friction, atol=0.03 * np.abs(jacobian.T @ impulse).max()
    )
    assert peak == pytest.approx(speed * np.sqrt(stiffness * mass), rel=0.06)


def test_it_comes_goes_and_is_no_push():
    plant = CompliantPlant(
        obstacles=[ball(0.01, stiffness=2000.0, damping=20.0, begin=0.5, until=1.0)],
        pushes=[Push(time=0.0, duration=9.0, force=(0, 0, 1.0))],
    )
    live = plant.start(IIWA, QI, 0.008, 0, 0)
    assert live.channels[-1].name == "contact"
    rest(live, 0.496)
    assert not contact(live).any()
    rest(live, 0.4)
    assert contact(live) @ WAY > 1
    push = next(i for i, channel in enumerate(live.channels) if channel.name == "push")
    first = sum(channel.size for channel in live.channels[:push])
    np.testing.assert_allclose(live.readings[first : first + 3], [0, 0, 1], atol=1e-12)
    rest(live, 0.2)
    assert not contact(live).any()


def test_the_recorded_force_is_the_largest_since_the_sample_before():
    runs = []
    for period in (0.001, 0.008):
        plant = CompliantPlant(
            mode="OFF", gravity=(0, 0, 0), obstacles=[ball(-1e-3, stiffness=5e3, velocity=tuple(0.1 * WAY))]
        )
        live = plant.start(IIWA, QI, period, 0, 0)
        forces = []
        for _ in range(round(0.16 / period)):
            live.step(np.zeros(7))
            forces.append(np.linalg.norm(contact(live)))
        runs.append(np.array(forces))
    np.testing.assert_allclose(runs[1], runs[0].reshape(-1, 8).max(axis=1), rtol=1e-9, atol=1e-12)


def made_record(error, force):
    count = len(error)
    pose = np.tile([1.0, 0, 0, 0, 0, 0, 0, 0], (count, 1))
    pose[:, 5] = np.array(error) / 2
    desired = np.hstack([np.tile([1.0, 0, 0, 0, 0, 0, 0, 0], (count, 1)), np.zeros((count, 13))])
    q = np.zeros((count, 1))
    values = np.column_stack([force, np.zeros((count, 2))])
    readings = {"contact": Signal("contact", ("x", "y", "z"), ("N",) * 3, values)}
    return Record(0.1 * np.arange(count), q, q, q, pose, desired, ("a",), readings=readings)


def test_peak_and_recovery_of_a_made_record():
    error = [0.001, 0.001, 0.02, 0.03, 0.02, 0.0031, 0.0029, 0.001]
    record = made_record(error, [0, 0, -3.0, 7.0, 0, 0, 0, 0])
    assert (peak_contact(record), RECOVERED) == (7.0, 2e-3)
    assert recovery_time(record) == pytest.approx(
        0.3
    )  # 0.0029 is the first within 0.001 + 2 mm, three after the last
    assert np.isnan(recovery_time(made_record([0, 0, 0.02, 0.02], [0, 0, 1.0, 0])))
    assert np.isnan(recovery_time(made_record([0, 0, 0.0, 0.0], [0, 0, 0, 0])))
    assert recovery_time(made_record([0, 0, 0.001, 0.001], [0, 1.0, 0, 0])) == pytest.approx(0.1)


def test_runs_without_obstacle_have_neither():
    record = made_record([0, 0], [0, 0])
    bare = Record(record.time, record.q, record.q, record.q, record.pose, record.desired, ("a",))
    metrics = dqc.measures.evaluate(bare)
    assert np.isnan([metrics.peak_contact, metrics.recovery_time]).all()


@pytest.mark.slow
def test_the_example_says_that_softer_arms_hit_less_and_come_back_later():
    study = dqc.run_study(Path(__file__).parents[2] / "examples/contact.yaml")
    peaks, times = ([float(row[key]) for row in study.rows] for key in ("peak_contact", "recovery_time"))
    assert peaks[0] < peaks[1] < peaks[2] < 35
    assert times[0] > times[1] > times[2] > 1
    page = (Path(__file__).parents[2] / "docs/physics.md").read_text()
    assert study.table().markdown().split("\n\n")[-1].strip() in page


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"position": [0, 0, 0], "radius": 0, "stiffness": 1}, "radius: expected .* > 0"),
        ({"position": [0, 0, 0], "radius": 1, "stiffness": -1}, "stiffness: expected .* > 0"),
        ({"position": [0, 0], "radius": 1, "stiffness": 1}, "position"),
        (
            {"position": [0, 0, 0], "radius": 1, "stifness": 1},
            "unknown key 'stifness'; did you mean 'stiffness'",
        ),
    ],
)
def test_bad_obstacles_in_a_spec_are_named(fields, words):
    with pytest.raises(FileFormatError, match=rf"obstacles\[0\].*{words}"):
        convert("spec", {"kind": "compliant", "obstacles": [fields]}, CompliantPlant)


@pytest.mark.parametrize(
    ("fields", "error", "words"),
    [
        ({"radius": -1.0}, ValueRangeError, "plant.obstacles.radius: must be > 0"),
        ({"begin": 2.0, "until": 1.0}, ValueRangeError, "plant.obstacles.until: must be after 'from'"),
        ({"velocity": (1.0, 0.0)}, ShapeError, "plant.obstacles.velocity"),
        (
            {"stiffness": 1e7},
            ValueRangeError,
            "is too hard for what it hits, 0.* kg .* steps a millisecond, 16",
        ),
    ],
)
def test_bad_obstacles_are_named(fields, error, words):
    def start():
        obstacle = Obstacle(**({"position": (0.0, 0.0, 0.0), "radius": 0.1, "stiffness": 1e3} | fields))
        CompliantPlant(obstacles=[obstacle]).start(MEKA, Q0, 0.008, 0, 0)

    with pytest.raises(error, match=words):
        start()

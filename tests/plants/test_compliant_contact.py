"""A compliant arm among bodies of a world: press at rest, impact, what is refused, numbers that judge contact."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.loop import Record
from dqcontrol.loop.signals import Signal
from dqcontrol.measures.metrics import RECOVERED, peak_contact, recovery_time
from dqcontrol.plants import CompliantPlant, Push
from dqcontrol.plants.compliant.controller_file import load_controllers
from dqcontrol.plants.mujoco.mujoco_model import mass_matrix
from dqcontrol.world import Body, Motion

mujoco: Any = pytest.importorskip("mujoco")

IIWA = dqc.load_robot("iiwa7")
QI = np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])
OUT = dqc.algebra.matrix_from_pose(IIWA.fkm(QI))[:3, :3] @ [
    0.6,
    0.0,
    0.8,
]  # the hand's shape ends in half a ball
RADIUS = 0.05


def pad(away, path=None, velocity=None, **fields):
    """Return a ball of 60 mm before the hand at QI, so far away from its shape; without friction."""
    at = dqc.DualQuaternion(IIWA.fkm(QI)).translation + (0.06 + RADIUS + away) * OUT
    moves = Motion(path=path, velocity=velocity) if path or velocity else None
    return Body(sphere=0.06, position=tuple(at), friction=0.0, moves=moves, **fields)


def among(mode="THETA_GC", gravity=(0.0, 0.0, -9.809), *, ball, **fields):
    return CompliantPlant(mode=mode, gravity=gravity, world=dqc.World(bodies={"ball": ball}), **fields)


def read(live, name):
    at = 0
    for channel in live.channels:
        if channel.name == name:
            return live.readings[at : at + channel.size].copy()
        at += channel.size
    raise KeyError(name)


def rest(live, seconds, period=0.008):
    for _ in range(round(seconds / period)):
        live.step(np.zeros(7))


def test_a_press_at_rest_is_the_depth_over_pad_and_joints_in_series():
    """F = δ / (1/k + wᵀJ K⁻¹Jᵀ w), K the stiffness of the position loops, along the pad's way w."""
    stiffness, depth = 2000.0, 0.01
    path = [(0.0, 0.0, 0.0, 0.0), (1.0, *(-(depth + 0.001) * OUT))]
    live = among(ball=pad(0.001, path, stiffness=stiffness, damping=50.0)).start(IIWA, QI, 0.008, 0, 0)
    rest(live, 4.0)
    position_loop = load_controllers(IIWA).column("position_loop", "k_p")
    joints = OUT @ IIWA.translation_jacobian(QI) / position_loop @ IIWA.translation_jacobian(QI).T @ OUT
    expected = depth / (1 / stiffness + joints)
    assert 0.1 < joints * stiffness < 20
    assert read(live, "contact_force")[0] == pytest.approx(expected, rel=0.03)
    assert np.linalg.norm(read(live, "ball_displacement")) * stiffness == pytest.approx(
        read(live, "contact_force")[0], rel=1e-2
    )
    assert np.linalg.norm(read(live, "wrist_force")) > 0.5 * expected  # the wrist feels it
    assert read(live, "contact_link")[0] == 6


@pytest.mark.parametrize("accurate", [False, True])
def test_an_impact_has_the_peak_of_a_mass_on_a_spring_and_keeps_the_momentum(accurate):
    """Without motors and gravity: peak v √(k m), M Δq̇ = Jᵀ ∫F dt − b Δq, m = 1 / wᵀJ M⁻¹Jᵀw."""
    stiffness, speed, n = 4000.0, 0.1, 7
    ball = pad(1e-3, velocity=tuple(-speed * OUT), stiffness=stiffness, damping=8.0)
    live = among("OFF", (0, 0, 0), ball=ball, accurate=accurate).start(IIWA, QI, 0.001, 0, 0)
    inertia = mass_matrix(live.model, live.data)[:n, :n]
    jacobian = IIWA.translation_jacobian(QI)
    mass = 1 / (OUT @ jacobian @ np.linalg.solve(inertia, jacobian.T) @ OUT)
    pressed = []
    for _ in range(300):
        live.step(np.zeros(n))
        pressed.append(
            stiffness * float(OUT @ read(live, "ball_displacement"))
        )  # of the spring behind the ball
    impulse = 1e-3 * sum(pressed)
    assert read(live, "contact_force")[0] == 0
    velocity, moved = live.data.qvel[:n], live.q - QI
    given = -jacobian.T @ OUT * impulse
    friction = live.model.dof_damping[:n] * moved
    np.testing.assert_allclose(inertia @ velocity, given - friction, atol=0.1 * np.abs(given).max())
    assert max(pressed) == pytest.approx(speed * np.sqrt(stiffness * mass), rel=0.1)


def test_what_touches_is_no_push_and_goes_again():
    path = [(0.5, 0, 0, 0), (0.6, *(-0.02 * OUT)), (1.0, *(-0.02 * OUT)), (1.1, 0, 0, 0)]
    ball = pad(0.01, path, stiffness=2000.0, damping=20.0)
    plant = among(ball=ball, pushes=[Push(time=0.0, duration=9.0, force=(0, 0, 1.0))])
    live = plant.start(IIWA, QI, 0.008, 0, 0)
    rest(live, 0.496)
    assert not read(live, "contact_force").any()
    rest(live, 0.4)
    assert read(live, "contact_force")[0] > 1
    np.testing.assert_allclose(read(live, "push"), [0, 0, 1], atol=1e-12)
    rest(live, 0.4)
    assert not read(live, "contact_force").any()


def test_a_world_that_is_not_touched_changes_nothing():
    """A table far away leaves the arm where it is without a world, to rounding: the same physics."""
    ends = []
    for world in (None, dqc.World(bodies={"table": Body(box=0.1, position=(3.0, 0, 0))})):
        live = CompliantPlant(world=world).start(IIWA, QI, 0.008, 0, 0)
        for _ in range(50):
            live.step(np.full(7, 0.1))
        ends.append(live.q.copy())
    np.testing.assert_allclose(ends[1], ends[0], atol=1e-9)


def test_a_start_in_a_body_is_refused():
    with pytest.raises(dqc.Error, match=r"start: link_7 is 10 mm deep in ball; start elsewhere"):
        among(ball=pad(-0.01)).start(IIWA, QI, 0.008, 0, 0)


def made_record(error, force):
    count = len(error)
    pose = np.tile([1.0, 0, 0, 0, 0, 0, 0, 0], (count, 1))
    pose[:, 5] = np.array(error) / 2
    desired = np.hstack([np.tile([1.0, 0, 0, 0, 0, 0, 0, 0], (count, 1)), np.zeros((count, 13))])
    q = np.zeros((count, 1))
    values = np.column_stack([force, np.zeros(count)])
    readings = {"contact_force": Signal("contact_force", ("ball", "itself"), ("N",) * 2, values)}
    return Record(0.1 * np.arange(count), q, q, q, pose, desired, ("a",), readings=readings)


def test_peak_and_recovery_of_a_made_record():
    error = [0.001, 0.001, 0.02, 0.03, 0.02, 0.0031, 0.0029, 0.001]
    record = made_record(error, [0, 0, 3.0, 7.0, 0, 0, 0, 0])
    assert (peak_contact(record), RECOVERED) == (7.0, 2e-3)
    assert recovery_time(record) == pytest.approx(
        0.3
    )  # 0.0029 is the first within 0.001 + 2 mm, three after the last
    assert np.isnan(recovery_time(made_record([0, 0, 0.02, 0.02], [0, 0, 1.0, 0])))
    assert np.isnan(recovery_time(made_record([0, 0, 0.0, 0.0], [0, 0, 0, 0])))
    assert recovery_time(made_record([0, 0, 0.001, 0.001], [0, 1.0, 0, 0])) == pytest.approx(0.1)


def test_runs_without_contact_have_neither():
    record = made_record([0, 0], [0, 0])
    bare = Record(record.time, record.q, record.q, record.q, record.pose, record.desired, ("a",))
    metrics = dqc.measures.evaluate(bare)
    assert np.isnan([metrics.peak_contact, metrics.recovery_time]).all()


@pytest.mark.slow
def test_the_example_says_that_softer_arms_hit_less_and_come_back_later():
    study = dqc.run_study(Path(__file__).parents[2] / "examples/contact.yaml")
    peaks, times = ([float(row[key]) for row in study.rows] for key in ("peak_contact", "recovery_time"))
    assert 5 < peaks[0] < peaks[1] < peaks[2] < 100
    assert times[0] > max(times[1:]) > 1
    page = (Path(__file__).parents[2] / "docs/physics.md").read_text()
    assert study.table().markdown().split("\n\n")[-1].strip() in page

"""Hands that go on where they are led: free, against a force, around a circle, and what is refused."""

import numpy as np
import pytest

from dqcontrol import algebra
from dqcontrol.contact import Admittance, Compliance, ForceSensor, GoesOn
from dqcontrol.errors import Error
from dqcontrol.experiments import check

T, SPEED, FILTER = 0.004, 0.05, 0.25
HERE = algebra.pose(algebra.rotation_from_rpy([0.3, -0.5, 1.1]), [0.4, 0.1, 0.3])
WAY = np.array([1.0, 2.0, -2.0]) / 3


def stage_of(axes="base", **more):
    on = GoesOn(speed=SPEED, direction=tuple(3 * WAY), filter=FILTER)
    return Admittance(axes=axes, translation=Compliance(damping=200.0), goes_on=on, **more).start(T)


def at_rest(pose=HERE):
    return np.concatenate([pose, np.zeros(13)])


def place_of(pose):
    return algebra.translation(pose[:8])


@pytest.mark.parametrize("axes", ["base", "reference", "hand"])
def test_the_free_hand_goes_on_as_said(axes):
    stage, hand = stage_of(axes), HERE
    for k in range(200):
        shaped = stage.step(hand, at_rest(), np.zeros(6))
        np.testing.assert_allclose(place_of(shaped) - place_of(HERE), k * T * SPEED * WAY, atol=1e-12)
        hand = shaped[:8]  # of an arm without lag


def test_against_a_force_it_is_slower_by_what_damping_says():
    stage, pose = stage_of(), algebra.pose([1, 0, 0, 0], place_of(HERE))
    shaped = [stage.step(pose, at_rest(pose), np.array([*(-4.0 * WAY), 0, 0, 0])) for _ in range(2)]
    moved = place_of(shaped[1]) - place_of(shaped[0])
    np.testing.assert_allclose(moved, T * (SPEED - 4.0 / 200.0) * WAY, atol=1e-12)


def test_its_way_is_the_low_passed_one_of_the_hand():
    """The hand is carried around a circle: the way lags by the angle that a first-order low pass has at its rate."""
    stage, rate, pose = stage_of(), 0.8, HERE
    for k in range(2000):
        angle = rate * T * k
        pose = algebra.pose(HERE[:4], place_of(HERE) + 0.1 * np.array([np.sin(angle), -np.cos(angle) + 1, 0]))
        stage.step(pose, at_rest(), np.zeros(6))
    way = stage.state.way / np.linalg.norm(stage.state.way)
    behind = (angle - np.arctan2(way[1], way[0])) % (2 * np.pi)
    assert behind == pytest.approx(np.arctan(rate * FILTER) + 0.5 * rate * T, abs=2e-3)
    assert np.linalg.norm(stage.state.way) == pytest.approx(0.08 / np.hypot(1, rate * FILTER), rel=2e-3)


def test_it_waits_for_the_tare_and_for_a_sensor():
    stage = stage_of(sensor=ForceSensor(tare=0.1))
    for _ in range(25):
        shaped = stage.step(HERE, at_rest(), np.ones(6))
    np.testing.assert_allclose(place_of(shaped), place_of(HERE), atol=1e-15)
    stage.step(HERE, at_rest(), np.ones(6))
    assert np.linalg.norm(stage.state.y[3:]) == pytest.approx(SPEED * T)
    for _ in range(10):
        stage.step(HERE, at_rest(), np.full(6, np.nan))
    before = stage.state.y.copy()
    stage.step(HERE, at_rest(), np.full(6, np.nan))
    np.testing.assert_array_equal(stage.state.y, before)


SPEC = {
    "name": "crank", "robot": "iiwa7", "start": [0, 0.6, 0, -1.6, 0, 0.9, 0], "period": T, "duration": 1,
    "reference": {"kind": "set-point"}, "law": {"kind": "proportional-feedforward", "gain": 1},
    "plant": {"kind": "servo", "wrist": {}},
}  # fmt: skip


@pytest.mark.parametrize(
    ("contact", "words"),
    [
        ({"translation": {"damping": 9}, "goes_on": {"speed": 0.1, "direction": [0, 0, 0]}}, "goes_on.direction"),
        ({"translation": {"damping": 9}, "goes_on": {"speed": -1, "direction": [0, 0, 1]}}, "goes_on.speed"),
        ({"rotation": {"damping": 9}, "goes_on": {"speed": 1, "direction": [0, 0, 1]}}, "no axis of translation"),
        ({"translation": {"damping": 9}, "goes_on": {"speed": 0.1}}, "direction"),
    ],
)  # fmt: skip
def test_what_is_refused(contact, words):
    with pytest.raises(Error, match=words) as caught:
        check(SPEC | {"contact": contact})
    assert "\n" not in str(caught.value)

"""A cube ends up in the basket: gripped, carried and dropped in physics, from what a camera measures."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from msgspec import structs

import dqcontrol as dqc
import dqcontrol_theses as published
from dqcontrol import algebra
from dqcontrol_theses.silva2017 import pick_and_drop_experiment as published_pick_and_drop
from dqcontrol_theses.silva2017.pick_and_drop_task import (
    BASKET,
    CAMERA,
    CUBE,
    START,
    _on_floor,
    _watched,
    pick_and_drop,
    plan,
    regulate,
)
from dqcontrol_theses.silva2017.specs import setting_of

pytest.importorskip("mujoco")

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.fixture(scope="module")
def done():
    return pick_and_drop()


@pytest.mark.slow
def test_the_cube_is_carried_into_the_basket(done):
    """It starts on the floor outside, rises with the hand, and rests in the basket."""
    assert done.record.stopped == "duration"
    assert not done.plant.bodies["basket"].holds(done.path[0])
    assert done.path[:, 2].max() > 0.2
    assert done.is_in_basket
    assert np.abs(done.path[-1] - done.path[-10]).max() < 1e-3


def test_the_hand_carries_it_by_friction(done):
    """Between grip and release the cube stays with the hand; nothing else holds it up."""
    closed, opened = (event.time for event in done.plant.gripper.schedule)
    carried = (done.record.time > closed + 1.0) & (done.record.time < opened)
    apart = np.linalg.norm(done.path - algebra.translation(done.record.pose), axis=1)
    assert apart[carried].max() < 0.02
    assert apart[-1] > 0.1


def test_it_goes_where_the_camera_sees_things(done):
    assert done.seen[:, :2] == pytest.approx(np.array([CUBE.position[:2], BASKET.position[:2]]), abs=0.01)
    assert np.abs(done.seen[0, :2] - CUBE.position[:2]).max() > 1e-4
    assert np.abs(done.record.measured[:, :2] - done.record.q[:, :2]).max() > 1e-3


def test_the_reproduction_judges_it_and_draws_it(done, monkeypatch):
    monkeypatch.setattr(published_pick_and_drop, "pick_and_drop", lambda: done)
    monkeypatch.setattr(published_pick_and_drop, "regulate", lambda law: done)
    found = published.reproduce("silva2017/pick-and-drop")
    by_law, table, verdicts = found.tables
    assert [row[0] for row in by_law.rows] == ["S17", "classic", "ours"]
    assert [row[2] for row in verdicts.rows] == ["supported"] * 2
    assert all(np.isfinite(row[1]) for row in table.rows)
    pictures = {"pick-and-drop.webp", "pick-and-drop.png", "pick-and-drop-set-points.png"}
    assert set(found.files) <= pictures  # none without OpenGL
    left = replace(done.record, readings={**done.record.readings})
    cube = left.readings["cube_position"]
    left.readings["cube_position"] = cube._replace(values=cube.values[:1].repeat(len(left), axis=0))
    monkeypatch.setattr(published_pick_and_drop, "pick_and_drop", lambda: replace(done, record=left))
    verdicts = published.reproduce("silva2017/pick-and-drop").tables[-1]
    assert [row[4] for row in verdicts.rows] == ["not supported", "supported"]


def test_cube_and_basket_are_measured_all_the_time():
    """The estimates scatter about the truth as the camera's filtered noise does: by √(w / (2 − w)) of a frame's."""
    seen = _watched(CAMERA, [_on_floor(CUBE), _on_floor(BASKET)], 5000, seed=2)
    weight = -np.expm1(-1 / (CAMERA.rate * CAMERA.filter_time))
    expected = CAMERA.position_noise * np.sqrt(weight / (2 - weight))
    assert seen[:, :, :2].std(axis=0) == pytest.approx(np.full((2, 2), expected), rel=0.2)
    assert seen[:, :, :2].mean(axis=0) == pytest.approx(
        np.array([CUBE.position[:2], BASKET.position[:2]]), abs=1e-3
    )
    assert len(np.unique(seen[:, 0, 0])) > 2000


@pytest.mark.slow
@pytest.mark.parametrize("label", ["S17", "classic"])
def test_both_laws_of_s17_do_it_by_set_points_with_its_gains(label):
    run = regulate(setting_of("comparison").spec.law_by_label[label])
    assert run.record.stopped == "duration"
    assert run.is_in_basket
    assert run.path[:, 2].max() > 0.2
    assert np.ptp(run.record.desired[-100:, 5]) > 0  # the goal moves with the camera's noise


@pytest.mark.slow
def test_a_scene_elsewhere():
    cube = structs.replace(CUBE, position=(0.9, -0.3, 0.015), rpy=(0.0, 0.0, 1.0))
    basket = structs.replace(BASKET, position=(1.6, -0.5, 0.0))
    assert pick_and_drop(cube, basket, seed=3).is_in_basket


def test_the_errand_comes_from_the_side_that_faces_the_hand():
    hand = dqc.load_robot("little-john").fkm(START)
    for yaw in (0.2, 0.2 + np.pi / 2, 0.2 - 3 * np.pi / 2):
        errand = plan(hand, [1.0, 0.0, yaw], [1.0, 1.0, 0.0])
        heading = algebra.multiply(
            algebra.multiply(errand.poses[4], [0, 1, 0, 0, 0, 0, 0, 0]), algebra.conjugate(errand.poses[4])
        )
        assert np.arctan2(heading[2], heading[1]) == pytest.approx(0.2)


@pytest.mark.slow
def test_the_example_is_this_errand():
    errand = plan(
        dqc.load_robot("little-john").fkm(START),
        *CAMERA.glance([_on_floor(CUBE), _on_floor(BASKET)], 0),
    )
    points = dqc.references.load_points(EXAMPLES / "points" / "pick-and-drop.csv")
    assert np.asarray(points.times) == pytest.approx(errand.times, abs=1e-4)
    signs = np.sign(np.sum(np.asarray(points.poses)[:, :4] * errand.poses[:, :4], axis=1, keepdims=True))
    assert np.asarray(points.poses) == pytest.approx(signs * errand.poses, abs=1e-4)
    run = dqc.run(EXAMPLES / "pick-and-drop.yaml")
    assert BASKET.holds(run.record.readings["cube_position"].values[-1])

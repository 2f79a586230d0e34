"""Obstacles of constraints in pictures and in the browser's scene: where they are, and which is near."""

import numpy as np
import pytest
from obstacles import around, plane, sphere

import dqcontrol as dqc
from dqcontrol.constraints.constraint_view import ConstraintView
from dqcontrol.films.drawn_scene import DrawnScene

HOME = np.array([0.0, -0.3, 0.0, -2.0, 0.0, 1.8, 0.7])
ARM = dqc.load_robot("panda")


@pytest.fixture(scope="module")
def kept():
    hand = dqc.DualQuaternion(ARM.fkm(HOME)).translation
    ball = sphere(center=tuple(hand + np.array([0.0, 0.5, 0.0])), radius=0.05, velocity=(0.0, -0.3, 0.0))
    table = plane(normal=(0.0, 0.0, 1.0), offset=-0.3)
    room = dqc.constraints.Zone(position=tuple(hand), box=(1.5, 1.5, 1.0))
    return dqc.constraints.Constraints(**around({"ball": ball, "table": table}), zones={"room": room})


@pytest.fixture(scope="module")
def record(kept):
    law = dqc.laws.Proportional(gain=2.0, constraints=kept)
    goal = dqc.references.SetPoint(ARM.fkm(HOME))
    return dqc.simulate(ARM, goal, law, dqc.plants.Integrator(), HOME, period=0.02, duration=1.4)


def test_the_nearest_pair_is_that_of_the_row_with_least_room(kept, record):
    scene = ConstraintView(kept, ARM, 0.02)
    assert [(thing.name, thing.is_zone) for thing in scene.things] == [
        ("ball", False),
        ("table", False),
        ("room", True),
    ]
    assert np.allclose(scene.shifts(np.array([0.5]))[0], [[0, -0.15, 0]])
    found = scene.nearest(record.q[-1], float(record.time[-1]))
    assert found is not None
    assert found.thing == 0
    assert found.label.startswith("ball: panda_link")
    readings = record.readings["constraint_room"]
    assert found.room == pytest.approx(readings.values[-1].min(), abs=1e-9)
    assert np.linalg.norm(found.on_a - found.on_b) == pytest.approx(found.room + 0.01, abs=1e-9)


def test_the_browser_draws_what_is_around_and_reddens_what_is_near(kept, record):
    pytest.importorskip("viser")
    from dqcontrol.browser import Page, Track
    from dqcontrol.browser.drawn import _CLOSE, _SOLID
    from dqcontrol.browser.run_view_model import numbers

    track = Track("one", ARM, record, constraints=kept)
    assert "Clearance above margin, ball" in numbers([("one", "#000000", track.reading(70))])
    page = Page([track], 18090)
    try:
        around = page._runs[0]._around
        assert tuple(around._meshes[0].color) == _SOLID
        page._time.value = 1.4
        page.tick()
        assert tuple(around._meshes[0].color) == _CLOSE
        assert np.allclose(around._frames[0].position, [0, -0.42, 0])
        assert len(around._pair) == 2
    finally:
        page.server.stop()


def test_pictures_show_the_ball_in_red_where_it_is_near(kept, record, tmp_path):
    pytest.importorskip("mujoco")
    from PIL import Image

    from dqcontrol.errors import MissingExtraError
    from dqcontrol.films.clip import render_strip

    path = tmp_path / "strip.png"
    try:
        render_strip(ARM, None, record, path, [0.0, 1.4], columns=2, width=160, height=120, kept=kept)
    except MissingExtraError as error:
        pytest.skip(str(error))
    pixels = np.asarray(Image.open(path).convert("RGB"), dtype=int)
    red = (pixels[..., 0] > 150) & (pixels[..., 1] < 110) & (pixels[..., 2] < 80)
    assert red[:, 160:].sum() > red[:, :160].sum() + 40


def test_a_hull_is_drawn_by_its_triangles():
    """MuJoCo's triangle begins at its geom's place; its sides lie along the first two axes, as long as the sizes."""
    mujoco = pytest.importorskip("mujoco")
    points = np.array([[0, 0, 0], [0.3, 0, 0], [0, 0.2, 0], [0.05, 0.02, 0.4]])
    hull = dqc.geometry.Hull(np.array([1.0, 0, 0, 0, 0, 0, 0, 0]), points)
    model = mujoco.MjModel.from_xml_string("<mujoco/>")
    scene = mujoco.MjvScene(model, maxgeom=10)
    drawn = DrawnScene.__new__(DrawnScene)
    drawn._add_shape(scene, hull, np.array([1.0, 0, 0]), (1, 0, 0, 1))
    assert scene.ngeom == 4
    found = set()
    for geom in scene.geoms[: scene.ngeom]:
        assert geom.type == mujoco.mjtGeom.mjGEOM_TRIANGLE
        start, axes = np.array(geom.pos), np.array(geom.mat).reshape(3, 3)
        for corner in (start, start + geom.size[0] * axes[:, 0], start + geom.size[1] * axes[:, 1]):
            found.add(tuple(np.round(corner - [1, 0, 0], 6) + 0.0))
    assert found == {tuple(point) for point in points}

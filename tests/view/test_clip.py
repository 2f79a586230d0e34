import importlib

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.errors import ExistsError, FileFormatError, MissingExtraError, ShapeError, ValueRangeError
from dqcontrol.plants import Basket, Cube, Gripper, MobilePlant, Scene
from dqcontrol.view.clip import render_clip, render_strip
from dqcontrol.view.offscreen import offscreen

pytest.importorskip("mujoco")

START = [0, 0, 0, 0, -0.5, 1.4, 0, 0]
SMALL = {"width": 120, "height": 90}


@pytest.fixture(scope="module")
def opengl():
    try:
        with offscreen(32, 32):
            pass
    except MissingExtraError as error:
        pytest.skip(str(error))


@pytest.fixture(scope="module")
def driven():
    robot = dqc.load_robot("little-john")
    scene = Scene(cubes=[Cube(position=(0.6, 0.2))], baskets=[Basket(position=(0.6, -0.3))])
    plant = MobilePlant(gripper=Gripper(), scene=scene)
    law = dqc.laws.FeedbackLinearization(stiffness=4.0, damping=4.0)
    target = dqc.references.SetPoint(robot.fkm(robot.integrate(START, [0.3, 0.3, 0, 0, 0, 0, 0], 1.0)))
    return robot, plant, dqc.simulate(robot, target, law, plant, START, period=0.02, duration=2.0)


def image(path):
    return importlib.import_module("PIL.Image").open(path)


@pytest.mark.usefixtures("opengl")
@pytest.mark.parametrize("ending", ["gif", "webp"])
def test_a_clip_has_its_frames_and_they_move(driven, tmp_path, ending):
    render_clip(*driven, tmp_path / f"clip.{ending}", speed=2.0, rate=4.0, **SMALL)
    clip = image(tmp_path / f"clip.{ending}")
    assert clip.n_frames == 5  # 0, 0.5 … 2 s
    assert clip.size == (120, 90)
    first = np.asarray(clip.convert("RGB"), dtype=float)
    assert clip.info["duration"] == 250
    clip.seek(4)
    assert np.abs(np.asarray(clip.convert("RGB"), dtype=float) - first).max() > 60


@pytest.mark.usefixtures("opengl")
def test_a_strip_shows_the_moments_side_by_side(driven, tmp_path):
    render_strip(*driven, tmp_path / "strip.png", [0, 1, 2], columns=2, **SMALL)
    sheet = np.asarray(image(tmp_path / "strip.png").convert("RGB"), dtype=float)
    assert sheet.shape == (180, 240, 3)
    red = (sheet[..., 0] > 150) & (sheet[..., 1] < 90) & (sheet[..., 2] < 90)
    assert red[:90, :120].any()  # the cube
    assert (sheet[90:, 120:] == 255).all()  # no fourth picture
    assert np.abs(sheet[:90, :120] - sheet[:90, 120:]).max() > 60


def test_bad_input(driven, tmp_path):
    robot, _, record = driven
    (tmp_path / "there.gif").touch()
    other = MobilePlant(scene=Scene(cubes=[Cube(position=(0, 0)), Cube(position=(1, 1))]))
    for call, error, text in (
        (
            lambda: render_clip(*driven, tmp_path / "clip.mp4"),
            FileFormatError,
            r"\.gif or \.webp, got '\.mp4'",
        ),
        (lambda: render_clip(*driven, tmp_path / "no" / "c.gif"), FileFormatError, "no such folder"),
        (lambda: render_clip(*driven, tmp_path / "there.gif"), ExistsError, "exists already"),
        (lambda: render_clip(*driven, tmp_path / "c.gif", speed=0), ValueRangeError, "speed: must be > 0"),
        (lambda: render_clip(*driven, tmp_path / "c.gif", rate=1e5), ValueRangeError, "frames, at most"),
        (
            lambda: render_clip(robot, other, record, tmp_path / "c.gif"),
            ShapeError,
            "missing: cube_2_position",
        ),
        (
            lambda: render_strip(*driven, tmp_path / "s.png", [5]),
            ValueRangeError,
            "times: must lie in 0 … 2 s",
        ),
    ):
        with pytest.raises(error, match=text):
            call()

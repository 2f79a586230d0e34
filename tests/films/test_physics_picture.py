import sys
from typing import Any

import numpy as np
import pytest

from dqcontrol.errors import (
    ExistsError,
    FileFormatError,
    MissingExtraError,
    ShapeError,
    UnknownNameError,
    ValueRangeError,
)
from dqcontrol.films.drawn_scene import offscreen
from dqcontrol.films.physics_picture import render_run
from dqcontrol.robots.serial_arm import SerialArm

pytest.importorskip("mujoco")


RED, BLUE = (0.98, 0.25, 0.12), (0.05, 0.45, 0.90)


def arm():
    return SerialArm.from_dh(theta=[0, 0, 0], d=[0.3, 0, 0], a=[0, 0.4, 0.3], alpha=[np.pi / 2, 0, 0])


def motion(count=60):
    robot = arm()
    q = np.column_stack([np.linspace(-1.0, 1.0, count), np.full(count, 0.9), np.full(count, -1.2)])
    return robot, q, robot.fkm(q)


@pytest.fixture(scope="module")
def opengl():
    try:
        with offscreen(32, 32):
            pass
    except MissingExtraError as error:
        pytest.skip(str(error))


def read(path):
    import matplotlib.image

    return matplotlib.image.imread(path)[..., :3]


def share(pixels, colour, tolerance=0.2):
    """Return the share of pixels near a hue, as direction in RGB."""
    direction = pixels / np.linalg.norm(pixels, axis=-1, keepdims=True).clip(1e-6)
    wanted = np.array(colour) / np.linalg.norm(colour)
    return (np.linalg.norm(direction - wanted, axis=-1) < tolerance).mean()


@pytest.mark.slow
@pytest.mark.usefixtures("opengl")
def test_picture_shows_arm_and_paths(tmp_path):
    robot, q, pose = motion()
    shifted = robot.fkm(q + np.array([0.0, 0.15, 0.0]))
    render_run(robot, q, pose, shifted, tmp_path / "run.png", width=320, height=240)
    pixels = read(tmp_path / "run.png")
    assert pixels.shape == (240, 320, 3)
    red, blue = share(pixels, RED), share(pixels, BLUE)

    still = tmp_path / "still.png"
    far = np.vstack([pose[-1:], shifted[-1:]])  # the same view, with two short strokes for the paths
    render_run(robot, q, pose[-2:], far, still, width=320, height=240)
    assert red > 0.0007 + share(read(still), RED)
    assert blue > 0.0007 + share(read(still), BLUE)


@pytest.mark.slow
@pytest.mark.usefixtures("opengl")
def test_positions_do_as_well_as_poses_and_the_same_run_gives_the_same_picture(tmp_path):
    robot, q, pose = motion()
    w, v, dw, dv = pose[:, :1], pose[:, 1:4], pose[:, 4:5], pose[:, 5:]
    position = 2 * (w * dv - dw * v - np.cross(dv, v))
    render_run(robot, q, pose, pose, tmp_path / "poses.png", width=160, height=120)
    render_run(robot, q, position, position, tmp_path / "positions.png", width=160, height=120)
    assert (read(tmp_path / "poses.png") == read(tmp_path / "positions.png")).all()


def test_nothing_is_overwritten(tmp_path):
    robot, q, pose = motion()
    path = tmp_path / "run.png"
    path.write_text("mine")
    with pytest.raises(ExistsError, match=r"run\.png: exists already"):
        render_run(robot, q, pose, pose, path)
    assert path.read_text() == "mine"


@pytest.mark.parametrize(
    ("change", "error", "words"),
    [
        ({"path": "run.jpg"}, FileFormatError, r"run\.jpg: pictures are PNG files, got the ending '\.jpg'"),
        ({"path": "nowhere/run.png"}, FileFormatError, r"nowhere: there is no such folder"),
        ({"q": np.zeros(3)}, ShapeError, r"q: expected shape \(N, 3\), got \(3,\)"),
        ({"q": np.zeros((4, 2))}, ShapeError, r"q: expected shape"),
        ({"pose": np.zeros((4, 7))}, ShapeError, r"pose: expected shape \(N, 8\) or \(N, 3\), got \(4, 7\)"),
        ({"desired_pose": np.full((4, 3), np.nan)}, ValueRangeError, "desired_pose: must be finite"),
        ({"ghosts": -1}, ValueRangeError, "ghosts: must be an integer ≥ 0, got -1"),
        ({"width": 0}, ValueRangeError, "width: must be an integer ≥ 1, got 0"),
    ],
)
def test_bad_input_is_named(change, error, words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    robot, q, pose = motion()
    arguments: dict[str, Any] = {"q": q, "pose": pose, "desired_pose": pose, "path": "run.png"} | change
    with pytest.raises(error, match=words):
        render_run(robot, **arguments)
    assert not list(tmp_path.iterdir())


def test_without_opengl_the_error_says_what_to_install(monkeypatch):
    for backend in ("egl", "osmesa", "glfw"):
        monkeypatch.setitem(sys.modules, f"mujoco.{backend}", None)
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    with (
        pytest.raises(MissingExtraError, match=r"no OpenGL here \(egl: .*apt install libegl1"),
        offscreen(32, 32),
    ):
        pass


def test_an_unknown_backend_is_named(monkeypatch):
    monkeypatch.setenv("MUJOCO_GL", "elg")
    with (
        pytest.raises(UnknownNameError, match=r"MUJOCO_GL: unknown name 'elg'; did you mean 'egl'"),
        offscreen(32, 32),
    ):
        pass

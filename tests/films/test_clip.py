import importlib
import sys
from types import SimpleNamespace

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.algebra import translation
from dqcontrol.cli.result_commands import clip
from dqcontrol.errors import ExistsError, FileFormatError, MissingExtraError, ShapeError, ValueRangeError
from dqcontrol.films.clip import _film, _moments, render_clip, render_strip, render_whole
from dqcontrol.films.drawn_scene import offscreen
from dqcontrol.films.film import with_rolling_wheels
from dqcontrol.plants import CompliantPlant, Gripper, MobilePlant
from dqcontrol.world import Body, Motion, World

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
    cube = Body(box=0.03, position=(0.6, 0.2, 0.015), mass=0.02)
    basket = Body(container=(0.16, 0.16, 0.08), position=(0.6, -0.3, 0))
    plant = MobilePlant(gripper=Gripper(), world=dqc.World(bodies={"cube": cube, "basket": basket}))
    law = dqc.laws.FeedbackLinearization(stiffness=4.0, damping=4.0)
    target = dqc.references.SetPoint(robot.fkm(robot.integrate(START, [0.3, 0.3, 0, 0, 0, 0, 0], 1.0)))
    return robot, plant, dqc.simulate(robot, target, law, plant, START, period=0.02, duration=2.0)


def image(path):
    return importlib.import_module("PIL.Image").open(path)


@pytest.mark.usefixtures("opengl")
@pytest.mark.parametrize("ending", ["gif", "webp"])
def test_a_clip_has_its_frames_and_they_move(driven, tmp_path, ending):
    told = []

    def say(drawn, total):
        told.append((drawn, total))

    render_clip(*driven, tmp_path / f"clip.{ending}", speed=2.0, rate=4.0, progress=say, **SMALL)
    assert told == [(drawn, 5) for drawn in range(6)]
    clip = image(tmp_path / f"clip.{ending}")
    assert clip.n_frames == 5  # 0, 0.5 … 2 s
    assert clip.size == (120, 90)
    first = np.asarray(clip.convert("RGB"), dtype=float)
    assert clip.info["duration"] == 250
    clip.seek(4)
    assert np.abs(np.asarray(clip.convert("RGB"), dtype=float) - first).max() > 60


@pytest.fixture(scope="module")
def pushed():
    """Return the Meka, a ball that pushes its hand from 0.2 to 0.6 s, and what came of it."""
    robot, start = dqc.load_robot("meka-a2"), [0, 0.6283185, 0, 1.5707963, 0, 0.6283185, 0]
    place = translation(robot.fkm(start)) + np.array([0.1, 0, 0])
    path = [(0.2, 0, 0, 0), (0.6, -0.04, 0, 0), (0.7, 0.4, 1.5, 0)]
    ball = Body(sphere=0.06, position=tuple(place), stiffness=1e4, damping=50, moves=Motion(path=path))
    plant = CompliantPlant(stiffness=0.1, world=World(bodies={"ball": ball}))
    target = dqc.references.SetPoint(robot.fkm(start))
    return (
        robot,
        plant,
        dqc.simulate(robot, target, dqc.laws.Proportional(gain=1.0), plant, start, period=0.01, duration=0.8),
    )


@pytest.mark.slow
@pytest.mark.usefixtures("opengl")
def test_an_arm_its_path_and_the_ball_in_its_way(pushed, tmp_path):
    frames = {}
    for time in (0.1, 0.4, 0.8):
        render_strip(*pushed, tmp_path / f"{time}.png", [time], columns=1, width=320, height=240)
        frames[time] = np.asarray(image(tmp_path / f"{time}.png").convert("RGB"), dtype=float)

    def violet(frame):
        return ((frame[..., 2] > frame[..., 1] + 40) & (frame[..., 0] > frame[..., 1] + 15)).sum()

    def red(frame):
        return ((frame[..., 0] > 140) & (frame[..., 1] < 70) & (frame[..., 2] < 60)).sum()

    assert violet(frames[0.4]) > 500 > 50 > violet(frames[0.8])  # it went out of sight
    assert red(frames[0.8]) > red(frames[0.1]) + 20  # the path that the ball made


@pytest.mark.slow
@pytest.mark.usefixtures("opengl")
def test_a_film_plays_as_long_as_the_run(pushed, tmp_path):
    av = pytest.importorskip("av")
    render_clip(*pushed, tmp_path / "clip.mp4", speed=0.5, rate=10.0, **SMALL)
    with av.open(str(tmp_path / "clip.mp4")) as file:
        stream = file.streams.video[0]
        frames = list(file.decode(stream))
        assert (stream.codec_context.name, stream.average_rate) == ("h264", 10)
    assert len(frames) == 17  # 0, 0.05 … 0.8 s
    first, last = (frame.to_ndarray(format="rgb24").astype(float) for frame in (frames[0], frames[-1]))
    assert first.shape == (90, 120, 3)
    assert np.abs(first - last).max() > 60


@pytest.mark.slow
@pytest.mark.usefixtures("opengl")
def test_the_command_films_a_saved_run(tmp_path, capsys):
    spec = {
        "name": "run",
        "robot": "iiwa7",
        "start": [0, 0.6, 0, 1.6, 0, 0.6, 0],
        "period": 0.02,
        "law": {"kind": "proportional", "gain": 5},
        "reference": {"kind": "circle", "radius": 0.05, "duration": 0.4},
        "plant": {"kind": "servo"},
    }
    dqc.run(spec).save(tmp_path / "run", figures=False)
    clip(tmp_path / "run", tmp_path / "run.gif", rate=5, width=120, height=90)
    assert capsys.readouterr().out == f"results: {tmp_path / 'run.gif'}\n"
    assert image(tmp_path / "run.gif").n_frames == 3
    with pytest.raises(ExistsError, match="exists already"):
        clip(tmp_path / "run", tmp_path / "run.gif")
    clip(tmp_path / "run", tmp_path / "run", tmp_path / "both.gif", rate=5, width=120, height=90)
    assert image(tmp_path / "both.gif").n_frames == 3
    with pytest.raises(ValueRangeError, match="clip: expected the folder of a run, or several, and a file"):
        clip(tmp_path / "run")
    clip(tmp_path / "run", tmp_path / "run.png", width=120, height=90)
    assert image(tmp_path / "run.png").size == (120, 90)
    with pytest.raises(FileFormatError, match=r"is not the folder of a run, but holds runs: give .*run$"):
        clip(tmp_path, tmp_path / "other.gif")


@pytest.mark.slow
@pytest.mark.usefixtures("opengl")
def test_one_picture_shows_the_whole_run_of_a_mobile_robot(driven, tmp_path):
    render_whole(*driven, tmp_path / "whole.png", **SMALL)
    sheet = np.asarray(image(tmp_path / "whole.png").convert("RGB"), dtype=int)
    assert sheet.shape == (180, 360, 3)  # six pictures
    assert np.abs(sheet[90:, 240:] - sheet[:90, :120]).max() > 60  # it has moved


def away(driven, speed):
    """Return a run of the robot on ideal joints, which drives straight on."""
    robot = driven[0]
    law = dqc.laws.OwnLaw(function=straight_on, parameters=[speed])
    target = dqc.references.SetPoint(robot.fkm(START))
    return dqc.simulate(robot, target, law, dqc.plants.Integrator(), START, period=0.05, duration=1.0)


def straight_on(q, pose, pose_jacobian, twist_jacobian, sample, parameters, state, work, out):
    for i in range(out.shape[0]):
        out[i] = 0.0
    out[0] = parameters[0]


@pytest.mark.usefixtures("opengl")
def test_further_runs_show_through_the_first(driven, tmp_path):
    """On ideal joints: both start in one place, where the first hides the other, and part."""
    robot, slow, fast = driven[0], away(driven, 0.0), away(driven, 1.0)

    def blue(picture):
        return int(((picture[..., 2] - picture[..., 0] > 60) & (picture[..., 2] > 90)).sum())

    several = {"further": [(None, fast)], "columns": 1, "width": 240, "height": 180}
    render_strip(robot, None, slow, tmp_path / "strip.png", [0, 1], **several)
    sheet = np.asarray(image(tmp_path / "strip.png").convert("RGB"), dtype=int)
    assert blue(sheet[180:]) > 100 > 3 * blue(sheet[:180])
    wheels = with_rolling_wheels(robot, fast).readings["wheel_angle"].values
    assert wheels[-1] == pytest.approx(np.full(2, 1.0 / robot.drives[0, 2]))
    assert with_rolling_wheels(*driven[::2]) is driven[2]


@pytest.mark.usefixtures("opengl")
def test_what_cannot_be_drawn_leaves_the_earlier_clip_as_it_is(pushed, tmp_path):
    clip = tmp_path / "clip.gif"
    clip.write_bytes(b"earlier")
    with pytest.raises(ValueRangeError, match="OpenGL cannot draw 100000 × 90 pixels here"):
        render_clip(*pushed, clip, rate=1.0, width=100_000, height=90, overwrite=True)
    assert clip.read_bytes() == b"earlier"
    assert list(tmp_path.iterdir()) == [clip]


def test_without_pyav(pushed, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(MissingExtraError, match=r"dqcontrol\[video\]"):
        render_clip(*pushed, tmp_path / "clip.mp4")


@pytest.mark.slow
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
    pytest.importorskip("av")
    robot, _, record = driven
    (tmp_path / "there.gif").touch()
    other = MobilePlant(world=dqc.World(bodies={"ball": Body(sphere=0.1, position=(2, 1, 0.1), mass=1)}))
    for call, error, text in (
        (
            lambda: render_clip(*driven, tmp_path / "clip.avi"),
            FileFormatError,
            r"\.gif or \.mp4 or \.webp, got '\.avi'",
        ),
        (lambda: render_clip(*driven, tmp_path / "no" / "c.gif"), FileFormatError, "no such folder"),
        (lambda: render_clip(*driven, tmp_path / "there.gif"), ExistsError, "exists already"),
        (lambda: render_clip(*driven, tmp_path / "c.gif", speed=0), ValueRangeError, "speed: must be > 0"),
        (lambda: render_clip(*driven, tmp_path / "c.gif", rate=1e5), ValueRangeError, "frames, at most"),
        (
            lambda: render_clip(robot, other, record, tmp_path / "c.gif"),
            ShapeError,
            "missing: ball_position",
        ),
        (
            lambda: render_clip(*driven, tmp_path / "c.gif", rate=0.01),
            ValueRangeError,
            "rate: must lie in 0.1 … 100",
        ),
        (
            lambda: render_clip(*driven, tmp_path / "c.gif", azimuth=np.nan),
            ValueRangeError,
            "azimuth: must be finite",
        ),
        (
            lambda: render_clip(*driven, tmp_path / "c.mp4", width=121),
            ValueRangeError,
            "must be even for .mp4, got 121 and 480",
        ),
        (
            lambda: render_clip(dqc.load_robot("youbot"), None, record, tmp_path / "c.gif"),
            ValueRangeError,
            r"clip: draws arms, and mobile manipulators on one differential drive .*youbot",
        ),
        (
            lambda: render_clip(*driven, tmp_path / "c.gif", labels=["a", "b"]),
            ShapeError,
            "labels: expected 1, one a run, got 2",
        ),
        (
            lambda: render_clip(*driven, tmp_path / "c.gif", further=[(None, record)]),
            ShapeError,
            "further: expected runs among 2 things as the first, got 0",
        ),
        (
            lambda: render_clip(dqc.load_robot("ur5"), None, record, tmp_path / "c.gif"),
            ShapeError,
            "record: is not of ur5; it has 8 joints instead of 6",
        ),
        (
            lambda: render_strip(*driven, tmp_path / "s.png", [5]),
            ValueRangeError,
            "times: must lie in 0 … 2 s",
        ),
    ):
        with pytest.raises(error, match=text):
            call()


def test_a_still_shows_where_it_was_nearest_or_pressed_hardest():
    time, six = np.linspace(0.0, 10.0, 101), np.linspace(0.0, 10.0, 6)
    force, distance = np.zeros((101, 2)), np.full((101, 2), 0.5)
    force[33, 1], distance[71, 0] = 12.0, 0.01

    def moments(**readings):
        return _moments(SimpleNamespace(time=time, readings=readings), 10.0)

    assert moments() == pytest.approx(six)
    kept = SimpleNamespace(values=distance)
    assert moments(constraint_distance=kept) == pytest.approx([0, 2, 4, 6, 7.1, 10])
    pressed = SimpleNamespace(values=force)
    assert moments(constraint_distance=kept, contact_force=pressed) == pytest.approx([0, 2, 3.3, 6, 8, 10])
    assert moments(contact_force=SimpleNamespace(values=0 * force)) == pytest.approx(six)


def test_a_mobile_manipulator_is_drawn_among_what_it_keeps_clear_of():
    robot = dqc.load_robot("little-john")
    start = [0, 0, 0, 0, -0.9, 0.9, 0.9, 0]
    board = dqc.world.Body(box=(0.25, 0.8, 0.02), position=(2.0, 0.6, 0.45))
    keep = dqc.constraints.Constraints(world=dqc.World(bodies={"board": board}), clear_of="all")
    law = dqc.laws.Proportional(gain=1.0, constraints=keep)
    target = dqc.references.SetPoint(robot.fkm(start))
    record = dqc.simulate(robot, target, law, dqc.plants.Integrator(), start, 0.05, 0.2)
    drawn = _film(robot, [(dqc.plants.Integrator(), record)], keep).spec.compile()
    np.testing.assert_allclose(drawn.body("world: board").pos, [2.0, 0.6, 0.45])

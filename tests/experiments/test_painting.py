import re
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml

from dqcontrol import algebra, cli
from dqcontrol.errors import FileFormatError, ReachError, ValueRangeError
from dqcontrol.experiments.painting import START, paint
from dqcontrol.experiments.spec.spec import part_of_spec
from dqcontrol.films.light_painting import light_painting, painting_clip
from dqcontrol.recording import load_metadata

DRAWINGS = Path(__file__).parents[2] / "examples/drawings"


@pytest.fixture(scope="module")
def two_lines(tmp_path_factory):
    pytest.importorskip("svgelements")
    path = tmp_path_factory.mktemp("svg") / "two.svg"
    path.write_text('<svg xmlns="http://www.w3.org/2000/svg"><path d="M0 0 L10 0 M10 10 L0 10"/></svg>')
    return path


def test_lamp_is_on_along_the_lines_and_off_between_them(two_lines):
    done = paint(two_lines, width=0.1, speed=0.05)
    desired = done.record.desired_position
    z = algebra.translation(done.robot.fkm(START))[2]  # of the paper's middle
    assert done.size == pytest.approx((0.1, 0.1))
    lit, moving = desired[done.lit], desired[~done.lit]
    np.testing.assert_allclose(np.abs(lit[:, 2] - z), 0.05, atol=1e-9)
    np.testing.assert_allclose(moving[1:-1, 0], moving[1, 0], atol=1e-9)
    speed = np.linalg.norm(np.diff(desired, axis=0), axis=1) / 0.01
    assert speed[done.lit[1:] & done.lit[:-1]].max() <= 0.05 + 1e-9
    assert 0.09 < speed.max() <= 0.1 + 1e-9  # twice as fast in the dark
    assert done.record.position_error.max() < 5e-3
    assert np.abs(done.record.command).max() <= done.robot.limits.velocity.max()


def test_too_wide_says_how_wide(two_lines):
    with pytest.raises(ReachError, match=r"width: 3000 mm is more than .* reaches here; ") as error:
        paint(two_lines, width=3.0)
    (best,) = re.findall(r"at most about (\d+) mm", str(error.value))
    width = 0.9e-3 * float(best)
    page = (DRAWINGS.parents[1] / "docs/painting.md").read_text(encoding="utf-8")
    with pytest.raises(ReachError) as error:
        paint(DRAWINGS / "hello.svg", width=3.0)
    assert f"```text\ndqcontrol: {error.value}\n```" in page
    assert paint(two_lines, width=width).size[0] == pytest.approx(width)


def test_arguments_that_do_not_fit(two_lines, tmp_path):
    with pytest.raises(ValueRangeError, match="start: needed to paint with ur5"):
        paint(two_lines, "ur5")
    with pytest.raises(ValueRangeError, match="speed: must be > 0"):
        paint(two_lines, speed=0)
    with pytest.raises(ValueRangeError, match=r"speed: 1e-05 m/s makes a drawing of \d+ s, at most 1200 s"):
        paint(two_lines, speed=1e-5)
    with pytest.raises(FileFormatError, match=r"expected a \.svg or a \.txt file, got '\.png'"):
        paint(tmp_path / "photo.png")


@pytest.mark.slow
def test_command_paints_a_text_drawing(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(
        sys, "argv", ["dqcontrol", "paint", str(DRAWINGS / "light-bulb.txt"), "--drawing-width", "0.1"]
    )
    cli.main()
    assert "panda" in capsys.readouterr().out.lower()
    files = {path.name for path in (tmp_path / "results/light-bulb").iterdir() if path.suffix}
    assert {"painting.png", "painting.gif", "record.mcap"} <= files
    spec = load_metadata(tmp_path / "results/light-bulb/record.mcap")["spec"]
    assert yaml.safe_load(spec) == {"robot": "panda"}  # what `dqcontrol view` asks for


@pytest.mark.slow
def test_picture_and_clip_show_only_what_is_lit(two_lines, tmp_path):
    from PIL import Image

    done = paint(two_lines, width=0.1, speed=0.2)
    light_painting(done.record, done.lit).savefig(tmp_path / "a.png", dpi=50)
    light = np.asarray(Image.open(tmp_path / "a.png").convert("L")).astype(float)
    rows = light.sum(axis=1)
    assert rows[len(rows) // 2] == 0  # dark between the two lines
    assert (rows > 0.5 * rows.max()).sum() < 0.2 * len(rows)
    painting_clip(done.record, tmp_path / "a.gif", done.lit)
    clip = Image.open(tmp_path / "a.gif")
    sums = []
    for frame in range(clip.n_frames):
        clip.seek(frame)
        sums.append(np.asarray(clip.convert("L")).astype(float).sum())
    assert len(sums) > 30
    assert sums[0] < 0.05 * sums[-1]
    assert np.all(np.diff(sums) > -0.02 * sums[-1])


def test_any_law_and_plant_may_paint(two_lines):
    """Ideal joints behind a law with feed-forward are off by the corners at most; a slow law lags behind."""
    law = part_of_spec("--law", "{kind: proportional-feedforward, gain: 5}", "law")
    ideal = paint(two_lines, width=0.1, law=law, plant=part_of_spec("--plant", "integrator", "plant"))
    slow = paint(two_lines, width=0.1, law=part_of_spec("--law", "{kind: proportional, gain: 2}", "law"))
    assert ideal.record.position_error.max() < 1e-3 < 1e-2 < slow.record.position_error.max()
    with pytest.raises(
        FileFormatError, match=r"--law: kind: unknown name 'proportionl'; did you mean 'proportional'"
    ):
        part_of_spec("--law", "{kind: proportionl, gain: 2}", "law")

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, strategies as st
from reference_samples import START

from dqcontrol import algebra, references as r
from dqcontrol.errors import FileFormatError, ValueRangeError

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "examples" / "drawings"
PAGE = (ROOT / "docs" / "drawing-files.md").read_text(encoding="utf-8")
FLAG = PAGE.split("```\n")[1]
DRAWING = """\
# A comment.
start 0.4 0.1 0.5 0 1 0 0
plane 0 2 0  0 0 1
orientation path 0.5   # rad/s
speed 0.05
line 0.1 0
pause 0.5
speed 0.1
arc 0.1 0.1 0.1 0.05 ccw
arc 0 0 0.1 0 cw
repeat 2
"""


def test_every_command_means_what_it_says():
    file = r.parse_drawing(DRAWING)
    assert file.strokes == (
        r.StraightStroke(0.1, 0.0, speed=0.05),
        r.Rest(0.5),
        r.Arc(0.1, 0.1, 0.1, 0.05, clockwise=False, speed=0.1),
        r.Arc(0.0, 0.0, 0.1, 0.0, clockwise=True, speed=0.1),
    )
    drawing = file.drawing()
    np.testing.assert_allclose(drawing.samples([0.0])[0, :8], algebra.pose([0, 1, 0, 0], [0.4, 0.1, 0.5]))
    np.testing.assert_allclose(drawing.samples([0.0])[0, 11:14], [0.0, 0.05, 0.0], atol=1e-15)
    assert (drawing.orientation, drawing.turn_speed, drawing.repeat) == ("path", 0.5, 2)


def test_defaults():
    file = r.parse_drawing("speed 1\nline 1 0\n")
    assert (file.plane, file.orientation, file.repeat) == ("xz", "fixed", 1)
    np.testing.assert_allclose(file.drawing(START).samples([0.0])[0, :8], START, atol=1e-15)


@pytest.mark.parametrize("first", ["", "start hand\n"])
def test_start_at_the_hand(first):
    drawing = r.parse_drawing(f"{first}plane xy\nspeed 1\nline 1 0\n").drawing(START)
    end = algebra.translation(START) + np.array([1, 0, 0])
    np.testing.assert_allclose(drawing.samples([1.0])[0, :8], algebra.pose(START[:4], end), atol=1e-14)


def test_start_at_a_position_with_the_orientation_of_the_hand():
    drawing = r.parse_drawing("start 1 2 3\nspeed 1\nline 1 0\n").drawing(START)
    np.testing.assert_allclose(drawing.samples([0.0])[0, :8], algebra.pose(START[:4], [1, 2, 3]), atol=1e-14)


@pytest.mark.parametrize(("first", "lacks"), [("", "position"), ("start 1 2 3\n", "orientation")])
def test_start_needs_the_hand(first, lacks, tmp_path):
    path = tmp_path / "stroke.txt"
    path.write_text(f"{first}speed 1\nline 1 0\n")
    with pytest.raises(ValueRangeError, match=rf"start: .*stroke.txt gives no {lacks}"):
        r.load_drawing(path)


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.txt")), ids=lambda path: path.stem)
def test_examples_fit_any_robot(path):
    drawing = r.load_drawing(path, start=START)
    assert drawing.samples([0.0])[0, :8] == pytest.approx(START)
    width, height = drawing.box[1] - drawing.box[0]
    assert 0.1 < max(width, height) <= 0.3


def test_the_drawing_in_the_documentation_is_one():
    drawing = r.parse_drawing(FLAG).drawing(START)
    np.testing.assert_allclose(drawing.box, [[0, 0.0], [0.12, 0.23]], atol=1e-12)


def test_the_messages_in_the_documentation_are_those_of_the_program():
    for change, line in (("line 0 0.2", "lin 0 0.2"), ("arc 0.06 0.2", "arc 0.07 0.2"), ("speed 0.05", "")):
        with pytest.raises(FileFormatError) as error:
            r.parse_drawing(FLAG.replace(change, line, 1), "flag.txt")
        assert f"{error.value}\n" in PAGE


def test_the_documentation_names_every_command():
    commands = set(re.findall(r"^\| `(\w+)", PAGE, re.MULTILINE))
    with pytest.raises(FileFormatError) as error:
        r.parse_drawing("draw")
    allowed = str(error.value).partition("allowed: ")[2].rstrip(")")
    assert commands == set(allowed.split(", "))


def test_byte_order_mark_and_windows_line_ends(tmp_path):
    path = tmp_path / "stroke.txt"
    path.write_bytes(b"\xef\xbb\xbfspeed 1\r\nline 1 0\r\n")
    assert r.load_drawing(path, start=START).length == 1.0


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "speed 1\nlin 1 0\n",
            r"^page:2: lin: unknown command; did you mean 'line'\? \(allowed: start, plane, ",
        ),
        ("speed 1\nline 1\n", r"^page:2: line: expected X Y, got 1 instead of 2 words"),
        ("speed 1\nline 1 2 3\n", r"^page:2: line: expected X Y, got 3 instead of 2 words"),
        ("speed 1\nline 1 nan\n", r"^page:2: line: must be finite, got nan"),
        ("speed 1\nline 1 1e999\n", r"^page:2: line: must be finite, got 1e999"),
        ("speed 1\nline 1 up\n", r"^page:2: line: expected a number, got 'up'"),
        (
            "speed 1\nline 1 0\n\nline 1 0\n",
            r"^page:4: line: has no length: it ends where it starts, at \(1, 0\)",
        ),
        ("speed 1\narc 1 0 0.2 0 cw\n", r"^page:2: arc: does not end on its circle: .* is 0.2 m .* 0.8 m"),
        ("speed 1\narc 1 0 0 0 cw\n", r"^page:2: arc: has no radius"),
        (
            "speed 1\narc 1 0 0.5 0\n",
            r"^page:2: arc: expected X Y CX CY cw or X Y CX CY ccw, got '1 0 0.5 0'",
        ),
        ("speed 1\narc 1 0 0.5 0 left\n", r"^page:2: arc: expected X Y CX CY cw .* got '1 0 0.5 0 left'"),
        ("speed 0\nline 1 0\n", r"^page:1: speed: must be > 0, got 0"),
        ("speed -1\n", r"^page:1: speed: must be > 0, got -1"),
        ("speed\n", r"^page:1: speed: expected V, got 0 instead of 1 words"),
        ("line 1 0\n", r"^page:1: line: no speed yet: put 'speed V' \(m/s\) before it"),
        ("arc 1 0 0.5 0 cw\n", r"^page:1: arc: no speed yet"),
        ("pause 0\n", r"^page:1: pause: must be > 0, got 0"),
        ("", r"^page: draws nothing: expected at least one line or arc"),
        ("# only words\nspeed 1\npause 2\n", r"^page: draws nothing"),
        ("start foot\n", r"^page:1: start: expected hand, X Y Z or X Y Z QW QX QY QZ, got 1 words"),
        ("start 1 2 3 4\n", r"^page:1: start: expected hand, .* got 4 words"),
        ("start 1 2 inf\n", r"^page:1: start: must be finite, got inf"),
        ("start 1 2 3 1 1 0 0\n", r"^page:1: start: the quaternion must have norm 1, got 1.41421"),
        ("start hand\nstart hand\n", r"^page:2: start: given twice, first in page:1"),
        ("plane zx\n", r"^page:1: plane: unknown plane 'zx' \(allowed: xy, xz, yz, or six numbers\)"),
        ("plane 1 0 0 1 0\n", r"^page:1: plane: expected UX UY UZ VX VY VZ, got 5 instead of 6 words"),
        ("plane 1 0 0 1 1 0\n", r"^page:1: plane: must have perpendicular axes, got 45 degrees"),
        ("plane 1 0 0 0 0 0\n", r"^page:1: plane: must have no zero axis"),
        ("orientation\n", r"^page:1: orientation: expected fixed, path or path TURN_SPEED, got ''"),
        ("orientation fixed 2\n", r"^page:1: orientation: expected fixed, .* got 'fixed 2'"),
        ("orientation path 0\n", r"^page:1: orientation: must be > 0, got 0"),
        ("repeat 1.5\n", r"^page:1: repeat: expected a whole number ≥ 1, got 1.5"),
        ("repeat 0\n", r"^page:1: repeat: expected a whole number ≥ 1, got 0"),
        (
            "speed 1\nline 3 4\nrepeat 2\n",
            r"^page:3: repeat: .* must end at its origin 0 0, it ends 5 m from it",
        ),
    ],
)
def test_bad_files(text, message):
    with pytest.raises(FileFormatError, match=message):
        r.parse_drawing(text, "page")


def test_files_that_cannot_be_read(tmp_path):
    (tmp_path / "house.txt").write_text("speed 1\nline 1 0\n")
    (tmp_path / "photo.txt").write_bytes(b"\x89PNG\r\n\x1a\n")
    (tmp_path / "zeros.txt").write_bytes(b"speed 1\0")
    for name, message in [
        ("hause.txt", r"hause.txt: no such file; did you mean 'house.txt'\?"),
        ("photo.txt", r"photo.txt: not a text file \(UTF-8\): byte 1 is no text"),
        ("zeros.txt", r"zeros.txt: not a text file: byte 8 is zero"),
        (".", r"is a folder"),
    ]:
        with pytest.raises(FileFormatError, match=message):
            r.load_drawing(tmp_path / name, start=START)


# Coordinates on a grid of 1 mm: no stroke is shorter than that, and none is lost in round-off.
coordinates = st.integers(-500, 500).map(lambda n: n / 1000)
speeds = st.integers(1, 500).map(lambda n: n / 1000)


@st.composite
def strokes(draw):
    drawn, here = [], (0.0, 0.0)
    for kind in draw(st.lists(st.sampled_from(["line", "arc", "circle", "rest"]), min_size=1, max_size=12)):
        x, y, speed = draw(coordinates), draw(coordinates), draw(speeds)
        if kind == "rest":
            drawn.append(r.Rest(draw(st.integers(1, 100)) / 10))
        elif (x, y) != here:
            if kind == "line":
                drawn.append(r.StraightStroke(x, y, speed))
                here = (x, y)
            elif kind == "circle":
                drawn.append(r.Arc(*here, x, y, draw(st.booleans()), speed))
            else:  # a centre on the perpendicular bisector
                side = draw(st.integers(-20, 20)) / 10
                cx = 0.5 * (here[0] + x) - side * (y - here[1])
                cy = 0.5 * (here[1] + y) + side * (x - here[0])
                drawn.append(r.Arc(x, y, cx, cy, draw(st.booleans()), speed))
                here = (x, y)
    if not any(isinstance(stroke, r.StraightStroke | r.Arc) for stroke in drawn):
        drawn.append(r.StraightStroke(0.7, 0.7, 0.1))
    return drawn


def written(drawn):
    lines = []
    for stroke in drawn:
        if isinstance(stroke, r.Rest):
            lines.append(f"pause {stroke.seconds}")
            continue
        lines.append(f"speed {stroke.speed}")
        if isinstance(stroke, r.StraightStroke):
            lines.append(f"line {stroke.x} {stroke.y}")
        else:
            way = "cw" if stroke.clockwise else "ccw"
            lines.append(f"arc {stroke.x} {stroke.y} {stroke.centre_x} {stroke.centre_y} {way}")
    return "\n".join(lines)


@pytest.mark.slow
@given(strokes())
def test_what_is_written_is_read_again(drawn):
    assert list(r.parse_drawing(written(drawn)).strokes) == drawn


@pytest.mark.slow
@given(strokes(), st.booleans())
def test_any_drawing_is_continuous_and_ends_where_it_says(drawn, follow):
    drawing = r.Drawing(np.eye(8)[0], drawn, plane="xy", orientation="path" if follow else "fixed")
    times = drawing.trace.times
    before, after = drawing.samples(np.maximum(times - 1e-6, 0))[:, :8], drawing.samples(times + 1e-6)[:, :8]
    np.testing.assert_allclose(before, after, atol=1e-5)
    ends = [(s.x, s.y) for s in drawn if not isinstance(s, r.Rest)]
    end = algebra.translation(drawing.samples([times[-1]])[0, :8])
    np.testing.assert_allclose(end, [*ends[-1], 0.0], atol=1e-12)
    speeds = np.linalg.norm(drawing.samples(0.5 * (times[:-1] + times[1:]))[:, 11:14], axis=1)
    if not follow:
        wanted = [0.0 if isinstance(s, r.Rest) else s.speed for s in drawn]
        np.testing.assert_allclose(speeds, wanted, atol=1e-12)

import math
import sys
import warnings

import numpy as np
import pytest
from matplotlib.figure import Figure

from dqcontrol.errors import FileFormatError, MissingExtraError, NoteWarning
from dqcontrol.references.strokes import Arc, PenPath, StraightStroke
from dqcontrol.references.svg_file import load_svg


@pytest.fixture
def svg(tmp_path):
    def write(
        body, head='<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink">'
    ):
        path = tmp_path / "drawing.svg"
        path.write_text(f"{head}{body}</svg>")
        return path

    return write


def points(pen, count=400):
    """Return points along a pen stroke, (count, 2)."""
    moved = [
        StraightStroke(s.x - pen.start[0], s.y - pen.start[1], 1.0)
        if isinstance(s, StraightStroke)
        else Arc(
            s.x - pen.start[0],
            s.y - pen.start[1],
            s.centre_x - pen.start[0],
            s.centre_y - pen.start[1],
            s.clockwise,
            1.0,
        )
        for s in pen.strokes
    ]
    trace = PenPath.of(moved)
    return trace.at(np.linspace(0, trace.times[-1], count))[0] + pen.start, trace


def test_a_circle_is_a_circle_and_has_its_length(svg):
    pytest.importorskip("svgelements")
    (pen,) = load_svg(svg('<circle cx="3" cy="-4" r="2"/>'))
    at, trace = points(pen)
    np.testing.assert_allclose(np.hypot(at[:, 0] - 3, at[:, 1] - 4), 2, atol=2e-6)
    assert trace.length == pytest.approx(4 * math.pi, rel=1e-6)


def test_a_curve_is_met_and_has_no_corner_inside(svg):
    """Distance from the cubic itself, sampled finely; headings change without a jump."""
    pytest.importorskip("svgelements")
    (pen,) = load_svg(svg('<path d="M0 0 C 40 0 60 50 100 -50"/>'))
    at, trace = points(pen)
    t = np.linspace(0, 1, 20001)[:, None]
    control = np.array([[0, 0], [40, 0], [60, -50], [100, 50]])  # y up
    weights = np.hstack([(1 - t) ** 3, 3 * t * (1 - t) ** 2, 3 * t**2 * (1 - t), t**3])
    curve = weights @ control
    worst = max(np.min(np.hypot(*(curve - point).T)) for point in at)
    assert worst < 0.02  # of 100 units
    ends = trace.ends()
    starts = trace.at(trace.times[1:-1])
    jump = np.abs(
        np.angle(np.exp(1j * (np.arctan2(*ends[1][:-1, ::-1].T) - np.arctan2(*starts[1][:, ::-1].T))))
    )
    assert jump.max() < 1e-3


def test_subpaths_shapes_and_transformations(svg):
    pytest.importorskip("svgelements")
    pens = load_svg(
        svg('<g transform="translate(10 0)"><path d="M0 0 L5 0 M8 0 l0 -3"/><rect width="4" height="2"/></g>')
    )
    assert [pen.start for pen in pens] == [(10, 0), (18, 0), (10, 0)]
    assert [(s.x, s.y) for s in pens[1].strokes] == [(18, 3)]
    assert len(pens[2].strokes) == 4


def test_refused_before_anything_reads_it(svg, tmp_path):
    bomb = '<!DOCTYPE svg [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;">]><svg xmlns="http://www.w3.org/2000/svg">'
    with pytest.raises(FileFormatError, match=r"drawing\.svg: has a document type .* is refused"):
        load_svg(svg("<text>&b;</text>", bomb))
    uses = "".join(f'<g id="g{i}">' + f'<use href="#g{i - 1}"/>' * 10 + "</g>" for i in range(1, 12))
    with pytest.raises(FileFormatError, match="a <use> of what holds a <use>"):
        load_svg(svg(f'<defs><g id="g0"><path d="M0 0 L1 1"/></g>{uses}</defs>'))
    (tmp_path / "large.svg").write_bytes(b"<svg>" + b" " * 2_000_001)
    with pytest.raises(FileFormatError, match=r"2\.0 MB; at most 2 MB"):
        load_svg(tmp_path / "large.svg")
    with pytest.raises(FileFormatError, match="no such file"):
        load_svg(tmp_path / "none.svg")
    with pytest.raises(FileFormatError, match="no XML: "):
        load_svg(svg("<path"))
    page = tmp_path / "page.svg"
    page.write_text("<html/>")
    with pytest.raises(FileFormatError, match="expected <svg>, got <html>"):
        load_svg(page)


def test_files_of_other_programs(svg, tmp_path):
    """A harmless document type, paths without ``d``, a background, hidden layers; text and images are named."""
    pytest.importorskip("svgelements")
    head = (
        '<!DOCTYPE svg PUBLIC "-//W3C//DTD SVG 1.1//EN" "http://www.w3.org/Graphics/SVG/1.1/DTD/svg11.dtd">'
        '<svg xmlns="http://www.w3.org/2000/svg" width="210mm" height="297mm" viewBox="0 0 210 297">'
    )
    body = (
        '<rect width="210" height="297" style="fill:#ffeecc;stroke:none"/>'
        '<rect x="20" y="20" width="90" height="90" style="fill:#ffffff"/><path id="empty"/>'
        '<path style="fill:none;stroke:none" d="M1 1 L2 2"/><g style="display:none"><path d="M0 0 L9 9"/></g>'
        '<path style="fill:none;stroke:#000000" d="m 50,50 40,20"/><text>Hello</text><image width="9" height="9"/>'
    )
    with pytest.warns(
        NoteWarning, match="left out: text 'Hello' .*, an image, a background as large as the page"
    ):
        (pen,) = load_svg(svg(body, head))
    assert pen.start == pytest.approx((50 * 96 / 25.4, -50 * 96 / 25.4))
    with pytest.raises(FileFormatError, match="defines entities"):
        load_svg(svg("<path d='M0 0 L1 1'/>", head.replace('dtd">', 'dtd" [<!ENTITY a "b">]>')))


def test_a_figure_of_matplotlib_is_its_lines(tmp_path):
    pytest.importorskip("svgelements")
    figure = Figure(figsize=(2, 2))
    axes = figure.subplots()
    axes.plot([0, 1, 2], [0, 1, 0])
    axes.axis("off")
    figure.savefig(tmp_path / "figure.svg")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NoteWarning)
        (pen,) = load_svg(tmp_path / "figure.svg")
    assert len(pen.strokes) == 2


def test_without_paths(svg):
    pytest.importorskip("svgelements")
    with pytest.raises(FileFormatError, match="holds no path to draw; texts must be turned into paths"):
        load_svg(svg("<text>hello</text>"))
    with pytest.raises(FileFormatError, match="more than 20000 strokes"):
        load_svg(svg(f'<path d="M0 0 {"L1 1 L0 0 " * 10001}"/>'))


def test_without_svgelements(svg, monkeypatch):
    monkeypatch.setitem(sys.modules, "svgelements", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'dqcontrol\[paint\]'"):
        load_svg(svg('<path d="M0 0 L1 1"/>'))

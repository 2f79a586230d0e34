"""Every kind of figure that we can draw: units on all axes, colours of the palette, nothing cut, text to be read."""

import itertools
import re

import gallery
import numpy as np
import pytest
from matplotlib.colors import to_hex, to_rgb
from matplotlib.text import Text

from dqcontrol.errors import UnknownNameError
from dqcontrol.figures import column_width, errors, save_figures
from dqcontrol.figures.style import COLOURS, DESIRED, LIMIT, NEUTRAL, WIDTHS

UNIT = re.compile(r"\[[^\]]+\]")
DIMENSIONLESS = {
    r"$|1 - x^{*} x_d|$",
    *("$w$", "$i$", "$j$", "$k$"),
    *(f"orientation ${name}$" for name in "wijk"),
    *("margin / half range", "samples", "steps"),
    *("$q$", "$r$"),  # weights
    *("Err", "log₁₀ Err"),  # [P16] prints it without one
    "orientation",  # of error quaternions
    "laws",  # names on the axis
}
MEANT = {*COLOURS, DESIRED, LIMIT, NEUTRAL, "#ffffff"}
FRAME = {"#000000", "#dddddd", "#333333"}  # text and its like, the shade of a span of time, edges of surfaces
SMALLEST = 6.5  # points
QUICK = ("path", "errors", "pose", "inputs", "margins", "sweep", "parity", "painting")  # to draw


def each_of(names):
    """Return names as parameters of a test; of figures that take long to draw, of a long one."""
    return [pytest.param(name, marks=() if name in QUICK else pytest.mark.slow) for name in names]


class Drawn(dict):
    """Figures by name, each drawn when it is first asked for."""

    def __missing__(self, name):
        self[name] = figure = _draw(gallery.figures()[name])
        return figure


def _draw(draw):
    figure = draw()
    figure.draw_without_rendering()
    return figure


@pytest.fixture(scope="module")
def drawn():
    return Drawn()


def test_all_kinds_are_known():
    assert tuple(gallery.figures()) == gallery.NAMES


def axes_of(figure):
    """Return the panels that show something."""
    return [each for each in figure.axes if each.get_visible() and each.axison and each.has_data()]


def described(axes, name):
    """Return what stands at an axis; the panel's title stands for the one that goes up."""
    label = getattr(axes, f"get_{name}label")()
    shared = getattr(axes, f"get_shared_{name}_axes")() if name in "xy" else None
    if not label and shared is not None:
        twins = shared.get_siblings(axes)
        label = next((text for each in twins if (text := getattr(each, f"get_{name}label")())), "")
    if name != "x" and not UNIT.search(label) and label not in DIMENSIONLESS:
        label = f"{label} {axes.get_title(loc='left')} {axes.get_title()}".strip()
    ticks = [text.get_text() for text in getattr(axes, f"get_{name}ticklabels")()]
    named = any(re.fullmatch(r"[A-Za-z][\w+-]*", tick) for tick in ticks)
    return label or ("laws" if named else "")


@pytest.mark.parametrize(
    "name", each_of(name for name in gallery.NAMES if name not in ("painting", "parity"))
)
def test_each_axis_has_a_unit_or_is_known_to_have_none(name, drawn):
    for axes in axes_of(drawn[name]):
        for direction in "xyz" if hasattr(axes, "get_zlabel") else "xy":
            label = described(axes, direction)
            assert UNIT.search(label) or label in DIMENSIONLESS, (direction, label)


def test_parity_has_units_in_its_titles(drawn):
    for axes in axes_of(drawn["parity"]):
        assert UNIT.search(axes.get_title()) or axes.get_title() in DIMENSIONLESS


@pytest.mark.parametrize(
    "name", each_of(name for name in gallery.NAMES if name not in ("painting", "surface"))
)
def test_all_colours_are_of_the_palette(name, drawn):
    colours = set()
    for axes in axes_of(drawn[name]):
        for line in axes.lines:
            colours |= {line.get_color()} if line.get_linestyle() != "None" else set()
            marked = line.get_marker() not in ("", "None", None)
            colours |= {line.get_markeredgecolor(), line.get_markerfacecolor()} if marked else set()
        colours |= {to_hex(patch.get_facecolor()) for patch in axes.patches}
        colours |= {to_hex(face) for each in axes.collections for face in each.get_facecolor()}
    shown = {to_hex(colour).lower() for colour in colours if colour != "none"}
    assert shown <= {colour.lower() for colour in MEANT | FRAME}


@pytest.mark.slow
def test_curves_that_share_a_panel_differ_in_more_than_colour(drawn):
    for name in ("errors-of-many", "criteria", "paths", "inputs", "margins"):
        lines = [line for line in drawn[name].axes[0].lines if not line.get_label().startswith("_")]
        for one, other in itertools.pairwise(lines):
            looks = [(line.get_linestyle(), line.get_marker()) for line in (one, other)]
            assert looks[0] != looks[1], name


def beyond(figure):
    """Return the texts that do not lie on the paper, or are too small."""
    paper = figure.bbox.padded(1.0)
    bad = []
    for text in figure.findobj(lambda artist: isinstance(artist, Text) and artist.get_visible()):
        if not text.get_text().strip() or (text.axes is not None and text.axes not in axes_of(figure)):
            continue
        box = text.get_window_extent()
        inside = paper.x0 <= box.x0 and box.x1 <= paper.x1 and paper.y0 <= box.y0 and box.y1 <= paper.y1
        ticks = text.get_clip_on() or (text.axes is not None and _is_hidden_tick(text))
        if (not inside and not ticks) or text.get_fontsize() < SMALLEST:
            bad.append(text.get_text())
    return bad


def _is_hidden_tick(text):
    """Tell whether a text is a tick's label beyond the limits of its axis, which is not drawn."""
    for name in "xyz":
        axis = getattr(text.axes, f"{name}axis", None)
        if axis is not None:
            low, high = sorted(axis.get_view_interval())
            for tick in (*axis.get_major_ticks(), *axis.get_minor_ticks()):
                if text in (tick.label1, tick.label2):
                    return not (low <= tick.get_loc() <= high) or not text.get_visible()
    return False


@pytest.mark.parametrize("name", each_of(gallery.NAMES))
def test_nothing_is_cut_or_too_small(name, drawn):
    assert beyond(drawn[name]) == []
    assert drawn[name].get_figwidth() <= WIDTHS["double"]


@pytest.mark.parametrize("name", each_of(["path", "errors", "joints", "inputs", "motion", "sweep"]))
def test_figures_for_one_column_fit_it(name):
    with column_width("single"):
        figure = _draw(gallery.figures()[name])
    assert figure.get_figwidth() == WIDTHS["single"]
    assert beyond(figure) == []


@pytest.mark.parametrize("name", gallery.NAMES)
def test_legends_cover_no_data_and_no_labels(name, drawn):
    for legend in drawn[name].legends:
        box = legend.get_window_extent()
        for axes in axes_of(drawn[name]):
            labels = [
                axis.label.get_window_extent() for axis in axes._axis_map.values() if axis.label.get_text()
            ]
            data = [axes.bbox] if axes.name != "3d" else []
            assert not any(box.overlaps(other) for other in (*data, *labels))


# Machado, Oliveira and Fernandes 2009, severity 1, on linear RGB.
SIGHT = {
    "common": np.eye(3),
    "protanopia": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "deuteranopia": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
    "tritanopia": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]],
}  # fmt: skip


def lab(colour, sight):
    """Return a colour in CIELAB as somebody sees it."""
    rgb = np.array(to_rgb(colour))
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    to_xyz = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
    xyz = to_xyz @ np.clip(np.array(SIGHT[sight]) @ linear, 0, 1) / [0.9505, 1, 1.089]
    f = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + 16 / 116)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


@pytest.mark.parametrize("sight", list(SIGHT))
def test_everybody_can_tell_the_colours_apart(sight):
    places = [lab(colour, sight) for colour in COLOURS]
    assert min(np.linalg.norm(a - b) for a, b in itertools.combinations(places, 2)) > 15  # 2 is just seen


@pytest.mark.slow
def test_files_for_papers_have_no_type_3_fonts_and_no_text_that_needs_a_font(tmp_path):
    figure = errors(gallery.run())
    pdf, svg, png = (
        path.read_bytes() for path in save_figures({"e": figure}, tmp_path, ["pdf", "svg", "png"], 300)
    )
    assert b"/Type3" not in pdf
    assert b"/FontFile2" in pdf
    assert b"<text" not in svg
    assert int.from_bytes(png[16:20], "big") == pytest.approx(300 * WIDTHS["double"], abs=1)


def test_a_width_that_no_journal_has():
    with pytest.raises(UnknownNameError, match="width: unknown name 'triple'"), column_width("triple"):
        pass

"""Panels beside Matplotlib's own: the same ticks and numbers at the same places; labels have room, and peaks stay."""

import numpy as np
import pytest
from matplotlib.figure import Figure

from dqcontrol.figures import errors
from dqcontrol.figures.panels import PanelAxes, PanelFigure
from dqcontrol.figures.paths import outline
from dqcontrol.figures.save import encoded
from dqcontrol.figures.style import new_figure


def curve(axes, scale):
    x = np.linspace(0.013, 7.4, 90)
    axes.plot(x, 10 ** (1.3 * np.sin(x)) if scale == "log" else -3e-4 * x, color="#0072B2")
    axes.set_yscale(scale)
    axes.set_xlabel("time [s]")
    axes.set_ylabel("error [mm]")
    axes.tick_params(labelsize=8)
    return axes


@pytest.mark.parametrize("scale", ["linear", "log", "symlog"])
def test_ticks_and_numbers_are_those_of_matplotlib(scale):
    panel = curve(new_figure(4, 3).add_subplot(), scale)
    theirs = curve(Figure(figsize=(4, 3), dpi=160).add_subplot(), scale)
    assert isinstance(panel, PanelAxes)
    panel.figure.draw_without_rendering()
    theirs.set_position(panel.get_position())
    theirs.figure.draw_without_rendering()
    for ours, given in ((panel.xaxis, theirs.xaxis), (panel.yaxis, theirs.yaxis)):
        places, numbers, minor = ours._marks()
        seen = given._update_ticks()
        along = 0 if ours.axis_name == "x" else 1
        major = [tick for tick in seen if tick in given.majorTicks]
        pixels = [tick.label1.get_transform().transform(tick.label1.get_position())[along] for tick in major]
        np.testing.assert_allclose(places, pixels, atol=1e-6)
        assert numbers == [tick.label1.get_text() for tick in major]
        few = [tick for tick in seen if tick in given.minorTicks]
        assert len(minor) == len(few)
        outer = [each.get_tightbbox().extents[1 - along] for each in (ours, given)]
        assert outer[0] == pytest.approx(
            outer[1], abs=0.03 * panel.figure.dpi
        )  # how exactly fonts are measured


def test_ticks_that_are_asked_for_are_drawn():
    axes = curve(new_figure(4, 3).add_subplot(), "linear")
    axes.set_xticks([1, 3], ["one", "three"], rotation=30)
    svg = encoded(axes.figure, "svg")
    assert b"<!-- three -->" in svg
    assert b"<!-- 0 -->" not in svg.partition(b"matplotlib.axis_2")[0]


def test_spines_stand_at_the_edges_of_a_panel():
    axes = curve(new_figure(4, 3).add_subplot(), "linear")
    axes.figure.draw_without_rendering()
    left = axes.spines.left
    drawn = left.get_path().get_extents(left.get_transform())
    assert (drawn.x0, drawn.y0, drawn.y1) == pytest.approx((axes.bbox.x0, axes.bbox.y0, axes.bbox.y1))


@pytest.mark.parametrize("wide", ["0.1", "−12345.6789"])
def test_labels_have_room_whatever_the_numbers_are(wide):
    figure = new_figure(7, 5)
    for row in figure.subplots(3, 2, sharex=True):
        for axes in row:
            axes.plot([0, 1], [0, 1])
            axes.yaxis.set_major_formatter(lambda value, _: wide)
            axes.set_ylabel("angle [°]")
            axes.set_title("above", loc="left")
    figure.draw_without_rendering()
    boxes = [axis.get_tightbbox() for axes in figure.axes for axis in (axes.xaxis, axes.yaxis)]
    assert all(each.x0 >= 0 and each.y0 >= 0 and each.x1 <= figure.bbox.x1 for each in boxes)
    left, right = figure.axes[0], figure.axes[1]
    assert right.yaxis.get_tightbbox().x0 > left.bbox.x1
    above, below = figure.axes[0], figure.axes[2]
    assert below.title.get_window_extent().y1 < above.bbox.y0


def test_a_layout_of_somebody_elses_is_left_alone():
    figure = PanelFigure(figsize=(4, 3), layout="constrained")
    axes = curve(figure.subplots(), "linear")
    figure.draw_without_rendering()
    assert axes.get_tightbbox().x0 > 0


def test_a_long_curve_keeps_every_peak_and_has_few_points():
    rng = np.random.default_rng(2)
    values = rng.normal(size=100_000)
    values[77_777] = 50.0
    values[[12, 99_999]] = -40.0
    (line,) = new_figure(4, 3).add_subplot().plot(np.arange(100_000.0), values)
    x, y = line.get_data()
    assert len(x) < 4000
    assert {77_777.0, 12.0, 0.0, 99_999.0} <= set(x.tolist())
    np.testing.assert_array_equal(y, values[x.astype(int)])
    pieces = values[: 99_900 // 125 * 125].reshape(-1, 125)
    shown = set(y.tolist())
    assert set(pieces.max(axis=1).tolist()) <= shown
    assert set(pieces.min(axis=1).tolist()) <= shown


def test_short_curves_and_those_that_run_back_keep_all_points():
    assert outline(np.zeros((800, 1))) is None
    turn = np.linspace(0, 2 * np.pi, 50_000)
    (line,) = new_figure(4, 3).add_subplot().plot(np.cos(turn), np.sin(turn))
    assert len(line.get_xdata()) == 50_000


def test_a_gap_in_a_long_curve_stays():
    values = np.sin(np.linspace(0, 20, 50_000))
    values[30_000:30_500] = np.nan
    kept = outline(values[:, None])
    assert kept is not None
    assert np.isnan(values[kept]).any()


def test_figures_are_quick_as_no_tick_is_made():
    from gallery import run

    figure = errors(run())
    encoded(figure, "svg")
    assert not any(axis.majorTicks for axes in figure.axes for axis in (axes.xaxis, axes.yaxis))

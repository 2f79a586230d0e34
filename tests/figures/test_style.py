"""What figures share: one spike flattens no panel, legends lie beside curves."""

from dataclasses import replace

import numpy as np

import dqcontrol as dqc
from dqcontrol.figures.robots import shapes_picture
from dqcontrol.figures.style import beyond_spikes, legend_above, new_figure


def test_a_spike_does_not_flatten_what_else_is_there():
    values = 0.1 + 0.1 * np.abs(np.sin(np.linspace(0, 10, 500)))
    for peak, scale in ((50.0, "symlog"), (0.5, "linear")):
        axes = new_figure(4, 3).subplots()
        values[250] = peak
        axes.plot(values)
        beyond_spikes(axes, values)
        assert axes.get_yscale() == scale
        low, high = (
            axes.transAxes.inverted().transform(axes.transData.transform((0, y)))[1] for y in (0.1, 0.2)
        )
        assert high - low > 0.05
    axes = new_figure(4, 3).subplots()
    beyond_spikes(axes, np.zeros(5))
    assert axes.get_yscale() == "linear"


def test_a_legend_of_a_panel_lies_above_it():
    figure = new_figure(4, 3)
    axes = figure.subplots()
    axes.plot([1, 1], label="at the top")
    legend_above(axes, 2)
    figure.draw_without_rendering()
    legend = axes.get_legend()
    assert legend is not None
    assert legend.get_window_extent().y0 >= axes.get_window_extent().y1


def test_more_shapes_than_colours_differ():
    arm = dqc.load_robot("iiwa7")
    shapes = [replace(arm.shapes.shapes[0], name=f"shape {i}") for i in range(12)]
    picture = shapes_picture(arm, shapes, np.zeros(7))
    assert len({patch.get_facecolor() for patch in picture.legends[0].get_patches()}) == 12

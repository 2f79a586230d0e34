import math

import numpy as np
import pytest
from mpl_toolkits.mplot3d import Axes3D
from test_plots import drawn

from dqcontrol.errors import ShapeError, ValueRangeError
from dqcontrol.figures.distributions import histogram
from dqcontrol.figures.studies import surface, surface_figure

pytestmark = pytest.mark.filterwarnings("error")
Q, R = [1, 10, 20, 30, 40, 50, 60, 70], [0.05, 0.1, 0.5, 1, 5, 10, 50, 100]  # [P16 Table 5 of Appendix D]


def test_every_value_is_counted_in_bins_that_all_panels_share():
    values = {"K": [8.0, 8.0, 9.0], "LQR": [7.0, 7.5], "HIR": np.full(5, 8.0)}
    panels = drawn(histogram(values))
    counts = [[bar.get_height() for bar in axes.patches] for axes in panels]
    assert [sum(heights) for heights in counts] == [3, 2, 5]
    edges = [[bar.get_x() for bar in axes.patches] for axes in panels]
    assert edges[0] == edges[1] == edges[2]
    assert panels[0].get_title(loc="left") == "K\nmean 8.333, std. dev. 0.577"
    assert panels[0].get_xlabel() == "sampling period [ms]"


@pytest.mark.parametrize(
    "count", [*(pytest.param(count, marks=pytest.mark.slow) for count in (1, 4, 6)), 2, 5]
)
def test_all_panels_of_the_lowest_row_name_their_axis(count):
    panels = drawn(histogram({str(i): [1.0, 2.0 + i] for i in range(count)}))
    assert len(panels) == count
    assert sum(axes.get_xlabel() != "" for axes in panels) == min(count, 2 if count in (2, 4) else 3)


def test_equal_values_can_be_drawn():
    (axes,) = drawn(histogram({"simulated": [20.0] * 10}))
    assert max(bar.get_height() for bar in axes.patches) == 10


def test_a_geometric_grid_is_logarithmic_and_an_even_one_is_not():
    heights = np.add.outer(np.array(Q, float), np.array(R))
    (axes,) = drawn(surface(Q, R, {"error [s]": heights}))
    assert axes.get_title() == "error [s]"
    assert [text.get_text() for text in axes.yaxis.get_ticklabels()] == [
        f"$10^{{{d}}}$" for d in (-1, 0, 1, 2)
    ]
    assert axes.get_xlim()[1] >= 70
    assert math.log10(100) <= axes.get_ylim()[1] < 3


def test_rows_of_heights_belong_to_x_and_columns_to_y(monkeypatch):
    drawn_points = []
    monkeypatch.setattr(Axes3D, "plot_surface", lambda self, *points, **style: drawn_points.append(points))
    surface([1, 2], [1, 10, 100], {"a": [[1, 2, 3], [4, 5, 6]]})
    ((x, y, z),) = drawn_points
    corners = {(x[i, k], y[i, k]): z[i, k] for i in range(2) for k in range(3)}
    assert corners == {(1, 0): 1, (1, 1): 2, (1, 2): 3, (2, 0): 4, (2, 1): 5, (2, 2): 6}


def test_surfaces_stand_side_by_side_and_may_have_holes():
    heights = np.ones((8, 8))
    heights[0, 0] = np.nan
    panels = drawn(surface(Q, R, {"a": heights, "b": 2 * heights, "c": heights + heights.T}))
    assert [axes.get_title() for axes in panels] == ["a", "b", "c"]
    boxes = [axes.get_window_extent() for axes in panels]
    assert boxes[0].x1 <= boxes[1].x0 + 1
    assert boxes[1].x1 <= boxes[2].x0 + 1


def grid_rows(**labels):
    return [
        {"law": "LQR", "stopped": "duration", "seed": k, "parameter.q": q, "parameter.r": r}
        | {"error.integral": q / r + k, "settling_time": None}
        | labels
        for r in (10.0, 0.1, 1.0)
        for q in (3, 1)
        for k in range(3)
    ]


def test_the_grid_of_a_study_is_sorted_and_its_repeats_are_averaged(monkeypatch):
    found = []
    monkeypatch.setattr(Axes3D, "plot_surface", lambda self, *points, **style: found.append(points))
    alone = [{"law": "K", "stopped": "duration", "parameter.q": None, "error.integral": 7.0}]
    figure = surface_figure([*grid_rows(), *alone], "parameter.q", "parameter.r", ["error.integral"])
    ((x, y, z),) = found
    np.testing.assert_allclose(x, [[1, 1, 1], [3, 3, 3]])
    np.testing.assert_allclose(10.0**y, [[0.1, 1, 10]] * 2)
    np.testing.assert_allclose(z, x / 10.0**y + 1)
    assert [axes.get_title() for axes in figure.axes] == ["Pose error integral [s]"]


@pytest.mark.parametrize(
    ("call", "kind", "message"),
    [
        (lambda: histogram({}), ShapeError, "values: expected at least one"),
        (lambda: histogram({"K": []}), ShapeError, "values: expected at least one"),
        (lambda: histogram({"K": [1.0, math.nan]}), ValueRangeError, "values of K: must be finite"),
        (lambda: surface(Q, R, {}), ShapeError, "heights: expected at least one surface"),
        (lambda: surface(Q, R, {"a": np.ones((8, 7))}), ShapeError, r"heights of a: expected shape \(8, 8\)"),
        (
            lambda: surface([2, 1], R, {"a": np.ones((2, 8))}),
            ValueRangeError,
            "x: expected at least two increasing",
        ),
        (
            lambda: surface(Q, [1], {"a": np.ones((8, 1))}),
            ValueRangeError,
            "y: expected at least two increasing",
        ),
    ],
)
def test_bad_input(call, kind, message):
    with pytest.raises(kind, match=message):
        call()


def test_a_few_values_far_away_do_not_flatten_the_others():
    periods = np.random.default_rng(20261122).normal(8.0, 0.05, 2000)
    periods[5] = 55.0
    (axes,) = drawn(histogram({"K": periods}))
    low, high = axes.get_xlim()
    assert low < 7.9 < 8.1 < high < 10
    assert "not shown: 1, as far as 55" in axes.get_title(loc="left")
    assert max(bar.get_height() for bar in axes.patches) < len(periods) / 4

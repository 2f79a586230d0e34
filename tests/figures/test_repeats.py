import numpy as np
import pytest
from test_plots import drawn

from dqcontrol.errors import ShapeError, UnknownNameError
from dqcontrol.figures.studies import gain_figure, repeats_figure

pytestmark = pytest.mark.filterwarnings("error")
T_OF_3 = 4.302653  # Student's t for 95 % and three repeats


def rows(**labels):
    return [
        {"robot": "iiwa7", "law": law, "set": "", "plant": "servo", "seed": i, "stopped": "duration"}
        | {"error.integral": error}
        | labels
        for law, errors in {"K": [3.0, 3.3, 3.9], "HIR": [1.0, 2.0, 1.5]}.items()
        for i, error in enumerate(errors)
    ]


def points(axes):
    return [line.get_ydata().tolist() for line in axes.lines if len(line.get_ydata()) == 3]


def legend(figure):
    return [text.get_text() for text in figure.legends[0].get_texts()]


def test_every_repeat_is_a_point_beside_mean_and_interval():
    figure = repeats_figure(rows())
    (axes,) = drawn(figure)
    assert points(axes) == [[3.0, 3.3, 3.9], [1.0, 2.0, 1.5]]
    assert [text.get_text() for text in axes.get_xticklabels()] == ["K", "HIR"]
    assert axes.get_ylabel() == "Pose error integral [s]"
    means = [float(line.get_ydata()[0]) for line in axes.lines if len(line.get_ydata()) == 1]
    assert means == pytest.approx([3.4, 1.5])
    (ends,) = axes.containers[1].lines[2][0].get_segments()
    assert ends[:, 1] == pytest.approx(
        [1.5 - T_OF_3 * 0.5 / np.sqrt(3), 1.5 + T_OF_3 * 0.5 / np.sqrt(3)], rel=1e-5
    )
    assert legend(figure) == ["mean, 95 % interval"]


def test_sets_stand_side_by_side_and_plants_have_panels():
    data = [*rows(set="40 %"), *rows(set="80 %"), *rows(set="40 %", plant="physics")]
    figure = repeats_figure(data, level=0.9)
    servo, physics = drawn(figure)
    assert [axes.get_title(loc="left") for axes in (servo, physics)] == ["servo", "physics"]
    assert (len(points(servo)), len(points(physics))) == (4, 2)
    places = [line.get_xdata() for line in servo.lines if len(line.get_ydata()) == 3]
    assert sorted(np.concatenate(places).round()) == [0.0] * 6 + [1.0] * 6
    assert len(set(np.concatenate(places))) == 12
    assert legend(figure) == ["40 %", "80 %", "mean, 90 % interval"]


@pytest.mark.slow
def test_a_set_has_a_panel_of_its_own_where_there_are_many_and_a_logarithmic_axis_where_numbers_are_far_apart():
    data = [row for i in range(7) for row in rows(set=f"{i} %")]
    data[0]["error.integral"] = 40.0
    figure = repeats_figure(data)
    panels = drawn(figure)
    assert [axes.get_title(loc="left") for axes in panels] == [f"{i} %" for i in range(7)]
    assert [axes.get_yscale() for axes in panels] == ["log", *["linear"] * 6]
    assert legend(figure) == ["mean, 95 % interval"]


def test_diverged_single_and_missing_runs_can_be_drawn():
    data = [*rows()[:4], rows()[0] | {"law": "LQR", "error.integral": None, "stopped": "diverged: q"}]
    (axes,) = drawn(repeats_figure(data))
    assert [text.get_text() for text in axes.get_xticklabels()] == ["K", "HIR", "LQR"]
    assert len(points(axes)) == 1


def test_an_error_inverse_to_the_gain_has_slope_minus_one():
    data = []
    for gain in (8.0, 2.0, 4.0):
        data += [
            row | {"parameter.gain": gain, "error.integral": row["error.integral"] / gain} for row in rows()
        ]
    figure = gain_figure(data, "parameter.gain")
    (axes,) = drawn(figure)
    assert (axes.get_xscale(), axes.get_yscale(), axes.get_xlabel()) == ("log", "log", "gain [1/s]")
    assert legend(figure) == ["K", "HIR"]
    gains, errors = axes.containers[0].lines[0].get_data()
    assert gains.tolist() == [2, 4, 8]
    assert np.diff(np.log(errors)) / np.diff(np.log(gains)) == pytest.approx([-1, -1])
    ticks = zip(axes.get_xticks(), axes.get_xticklabels(), strict=True)
    assert {place: text.get_text() for place, text in ticks} == {2: "2", 4: "4", 8: "8"}


def test_laws_with_and_without_a_grid():
    grid = [
        row | {"set": f"gain={gain:g}", "parameter.gain": gain} for gain in (5.0, 7.5) for row in rows()[3:]
    ]
    alone = [row | {"parameter.gain": None} for row in rows()[:3]]
    figure = gain_figure([*alone, *grid], "parameter.gain")
    assert drawn(figure)[0].containers[0].lines[0].get_xdata().tolist() == [5, 7.5]
    assert legend(figure) == ["HIR"]
    assert legend(repeats_figure([*alone, *grid]))[:2] == ["gain 5", "gain 7.5"]
    by_set = gain_figure(grid)
    assert [text.get_text() for text in drawn(by_set)[0].get_xticklabels()] == ["gain=5", "gain=7.5"]


def test_sets_stand_in_the_order_of_the_rows():
    figure = gain_figure([*rows(set="weak"), *rows(set="strong")])
    (axes,) = drawn(figure)
    assert [text.get_text() for text in axes.get_xticklabels()] == ["weak", "strong"]
    assert axes.containers[0].lines[0].get_ydata() == pytest.approx([3.4, 3.4])
    one_law = gain_figure([*rows(set="weak")[:3], *rows(set="strong")[:3]])
    assert drawn(one_law)
    assert not one_law.legends


@pytest.mark.parametrize(
    ("call", "kind", "message"),
    [
        (lambda: repeats_figure([]), ShapeError, "rows: expected at least one run"),
        (lambda: repeats_figure(rows(), "eror.integral"), UnknownNameError, "did you mean 'error.integral'"),
        (
            lambda: gain_figure(rows(), "parameter.gain"),
            UnknownNameError,
            "over: unknown name 'parameter.gain'",
        ),
        (lambda: gain_figure(rows(stopped="diverged")), ShapeError, "no run that did not fail has"),
    ],
)
def test_bad_input(call, kind, message):
    with pytest.raises(kind, match=message):
        call()

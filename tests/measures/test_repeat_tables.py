import csv
import io
import math
import re

import numpy as np
import pytest

from dqcontrol.errors import ShapeError, UnknownNameError
from dqcontrol.measures.metric_tables import METRIC_COLUMNS
from dqcontrol.measures.repeats import differences_table, means_table, repeatability_table
from dqcontrol.tables.tables import PlusMinus

ERRORS = {"K": [3.0, 3.2, 3.4, 3.6], "HIR": [1.5, 1.6, 1.9, 1.8]}
BLANK = dict.fromkeys(METRIC_COLUMNS)


def row(law, seed, error, **more):
    labels = {"robot": "iiwa7", "law": law, "set": "", "plant": "servo", "repeat": seed, "seed": seed}
    numbers = {"error.integral": error, "control.integral": 100 * error if error else None}
    return BLANK | labels | {"stopped": "duration"} | numbers | more


def rows(**more):
    return [
        row(law, seed, error, **more) for law, errors in ERRORS.items() for seed, error in enumerate(errors)
    ]


def headings(table):
    return [column.heading for column in table.columns]


def test_means_show_the_labels_that_differ():
    table = means_table(rows(), ["error.integral", "control.integral"])
    assert headings(table) == [
        "Law",
        "Runs",
        "Failed",
        "Pose error integral [s]",
        "Control integral [rad or m]",
    ]
    assert table.texts() == [
        ["K", "4", "0", "3.30 ± 0.26", "330 ± 26"],
        ["HIR", "4", "0", "1.70 ± 0.18", "170 ± 18"],
    ]
    assert headings(means_table(rows()[:4]))[0] == "Law"
    two = rows(set="a", plant="servo") + rows(set="b", plant="mujoco")
    assert headings(means_table(two))[:4] == ["Law", "Set", "Plant", "Runs"]
    assert [line[:3] for line in means_table(two).rows] == [
        ["K", "a", "servo"],
        ["HIR", "a", "servo"],
        ["K", "b", "mujoco"],
        ["HIR", "b", "mujoco"],
    ]


def test_runs_of_other_parameters_are_no_repeats():
    data = {"gain": rows(**{"parameter.gain": 5.0}), "more": rows(**{"parameter.gain": 7.5})}
    table = means_table([*data["gain"], *data["more"]], ["error.integral"])
    assert headings(table)[:2] == ["Law", "gain"]
    assert [line[:3] for line in table.rows][:3] == [["K", 5.0, 4], ["HIR", 5.0, 4], ["K", 7.5, 4]]


def test_the_set_of_a_grid_is_not_told_twice():
    grid = [rows(set=f"gain={gain:g}", **{"parameter.gain": gain})[4:] for gain in (5.0, 7.5)]
    alone = means_table([*grid[0], *grid[1]], ["error.integral"])
    assert headings(alone)[:2] == ["gain", "Runs"]
    beside = means_table([*rows(**{"parameter.gain": None})[:4], *grid[0], *grid[1]], ["error.integral"])
    assert headings(beside)[:3] == ["Law", "gain", "Runs"]
    assert [line[:2] for line in beside.rows] == [["K", ""], ["HIR", 5.0], ["HIR", 7.5]]
    texts = [rows(**{"parameter.weights": text})[:4] for text in ("[1, 2]", "[3, 4]")]
    assert [line[0] for line in means_table([*texts[0], *texts[1]]).rows] == ["[1, 2]", "[3, 4]"]


def test_csv_of_means_has_all_digits():
    cells = list(csv.reader(io.StringIO(means_table(rows(), ["error.integral"]).csv())))
    assert cells[0] == ["Law", "Runs", "Failed", "Pose error integral [s]", "± Pose error integral [s]"]
    assert [float(cells[1][i]) for i in (3, 4)] == pytest.approx(
        [3.3, np.std(ERRORS["K"], ddof=1)], rel=1e-15
    )


def test_diverged_runs_are_counted_and_left_out():
    broken = [
        *rows(),
        row("K", 9, None, stopped="diverged: q is not finite"),
        row("K", 8, 50.0, stopped="diverged"),
    ]
    table = means_table(broken, ["error.integral"], "Circle")
    assert table.title == "Circle; 2 failed runs left out"
    assert table.texts()[0] == ["K", "4", "2", "3.30 ± 0.26"]
    assert means_table(rows(), title="Circle").title == "Circle"
    everything = [row("K", i, None, stopped="diverged: u") for i in range(3)]
    assert means_table(everything, ["error.integral"]).rows[0] == ["K", 0, 3, None]
    differences = differences_table([*everything, *rows()[4:]])
    assert differences.title.endswith("3 failed runs left out")
    assert differences.texts()[0][1:] == ["0", "–", "–", "–", "–"]
    assert repeatability_table([*everything, *rows()[4:]], ["error.integral"]).texts()[0][2:] == ["0"] + 5 * [
        "–"
    ]


def test_a_mean_that_a_run_lacks_a_number_for_is_missing():
    lacking = [*rows(), row("K", 9, None)]
    assert means_table(lacking, ["error.integral"]).rows[0][-1] is None
    nan = [*rows(), row("K", 9, math.nan)]
    assert means_table(nan, ["error.integral"]).rows[0][-1] is None
    assert differences_table(lacking).rows[0][1] == 4


def test_one_run_has_no_spread():
    assert means_table(rows()[:1], ["error.integral"]).texts() == [["K", "1", "0", "3"]]


def test_differences_are_paired_by_seed():
    stats = pytest.importorskip("scipy.stats")
    shuffled = [rows()[i] for i in (3, 1, 7, 0, 5, 4, 2, 6)]
    table = differences_table(shuffled, "error.integral", "K")
    assert table.title == "Pose error integral: paired differences from K"
    assert headings(table)[:4] == ["Law", "Pairs", "Law − K (± 95 %) [s]", "Relative [%]"]
    truth = stats.ttest_rel(ERRORS["HIR"], ERRORS["K"])
    law, pairs, difference, *numbers, verdict = table.rows[0]
    assert (law, pairs, verdict) == ("HIR", 4, "yes")
    assert numbers == pytest.approx([-160 / 3.3, truth.pvalue])
    low, high = truth.confidence_interval()
    assert isinstance(difference, PlusMinus)
    assert (difference.value, difference.spread) == pytest.approx((-1.6, (high - low) / 2))
    assert len(table.rows) == 1
    assert differences_table(rows(), level=0.99).columns[2].title == "Law − K (± 99 %)"


def test_noise_that_hits_both_laws_cancels_in_pairs():
    noise = np.linspace(-1, 1, 9)
    data = [row("K", i, 3 + n) for i, n in enumerate(noise)]
    data += [row("HIR", i, 2.9 + n + 0.01 * (-1) ** i) for i, n in enumerate(noise)]
    table = differences_table(data)
    law, pairs, difference, *_, verdict = table.rows[0]
    assert (law, pairs, verdict) == ("HIR", 9, "yes")
    assert isinstance(difference, PlusMinus)
    assert difference.value == pytest.approx(-0.1 + 0.01 / 9)


def test_only_equal_robots_sets_and_plants_are_compared():
    data = [*rows(set="a"), *rows(set="b")[4:]]
    table = differences_table(data)
    assert headings(table)[:2] == ["Law", "Set"]
    assert [line[:3] for line in table.rows] == [["HIR", "a", 4], ["HIR", "b", 0]]


def test_repeatability_names_the_noise_and_compares_spreads():
    table = repeatability_table(rows(), ["error.integral", "control.integral"], "encoder noise 0.1 mrad")
    assert table.title == "Spread of repeated runs under encoder noise 0.1 mrad"
    deviations = {law: float(np.std(errors, ddof=1)) for law, errors in ERRORS.items()}
    first, second, third, _ = table.rows
    assert list(first[:3]) == ["Pose error integral [s]", "K", 4]
    assert first[3:] == [pytest.approx(deviations["K"]), pytest.approx(100 * deviations["K"] / 3.3)] + 3 * [
        None
    ]
    ratio = deviations["HIR"] / deviations["K"]
    spread = math.sqrt(15.4392)  # F(0.975; 3, 3)
    assert second[5:] == pytest.approx([ratio, ratio / spread, ratio * spread], rel=1e-5)
    assert third[0] == "Control integral [rad or m]"


@pytest.mark.parametrize("table", [means_table, differences_table, repeatability_table])
def test_no_rows_are_refused(table):
    with pytest.raises(ShapeError, match="rows: expected at least one run, got none"):
        table([])


@pytest.mark.parametrize(
    ("call", "kind", "message"),
    [
        (lambda: means_table(rows(), ["error.integrl"]), UnknownNameError, "did you mean 'error.integral'?"),
        (lambda: means_table(rows(), ["limit_joint"]), UnknownNameError, "unknown name 'limit_joint'"),
        (
            lambda: differences_table(rows(), baseline="HIRT"),
            UnknownNameError,
            "baseline: unknown name 'HIRT'",
        ),
        (lambda: repeatability_table(rows(), baseline="k"), UnknownNameError, "(allowed: HIR, K)"),
        (lambda: differences_table(rows() + rows()[:1]), ShapeError, "two runs of law 'K' have the seed 0"),
    ],
)
def test_bad_input(call, kind, message):
    with pytest.raises(kind, match=re.escape(message)):
        call()

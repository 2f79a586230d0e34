"""Named sets and grids: which laws run with which parameters, and what is refused."""

import pytest

from dqcontrol.errors import Error
from dqcontrol.experiments.spec.parameter_sets import variants
from dqcontrol.laws import DampedInverse, LinearQuadraticDQ, Proportional

K = Proportional(gain=125.0)
LQR = LinearQuadraticDQ(error_weight=270.0, control_weight=0.01)
LAWS = {"K": K, "LQR": LQR}


def found(sets=None, grids=None):
    return [(each.label, each.set, each.law) for each in variants(LAWS, sets, grids)]


def test_without_sets_every_law_runs_as_it_stands():
    assert found() == [("K", "", K), ("LQR", "", LQR)]


def test_a_set_runs_the_laws_that_it_names_with_what_differs():
    sets = {"best": {"K": {}, "LQR": {}}, "ln2": {"LQR": {"error_weight": 187.15}}}
    assert found(sets) == [
        ("K", "best", K),
        ("LQR", "best", LQR),
        ("LQR", "ln2", LinearQuadraticDQ(error_weight=187.15, control_weight=0.01)),
    ]


def test_structures_are_changed_whole():
    ((_, _, law),) = found({"a": {"K": {"inverse": {"kind": "damped", "damping": 0.3}, "gain": [1] * 8}}})
    assert law == Proportional(gain=[1.0] * 8, inverse=DampedInverse(damping=0.3))


def test_a_grid_combines_all_values_and_leaves_other_laws_alone():
    grid = {"LQR": {"error_weight": [1, 2.5], "control_weight": [0.05, 1e-7, 3]}}
    got = variants(LAWS, None, grid)
    assert [(each.label, each.set) for each in got] == [
        ("K", ""),
        ("LQR", "error_weight=1 control_weight=0.05"),
        ("LQR", "error_weight=1 control_weight=1e-07"),
        ("LQR", "error_weight=1 control_weight=3"),
        ("LQR", "error_weight=2.5 control_weight=0.05"),
        ("LQR", "error_weight=2.5 control_weight=1e-07"),
        ("LQR", "error_weight=2.5 control_weight=3"),
    ]
    assert got[0].point == {"error_weight": None, "control_weight": None}
    assert got[5].point == {"error_weight": 2.5, "control_weight": 1e-7}
    assert got[5].law == LinearQuadraticDQ(error_weight=2.5, control_weight=1e-7)


def test_values_that_are_no_numbers_are_named_by_their_place_and_kept_as_texts():
    got = variants(
        LAWS, {"a": {"K": {}}}, {"LQR": {"form": ["log", "sin"], "error_weight": [2, [1, 1, 1, 9, 9, 9]]}}
    )
    assert [each.set for each in got] == [
        "a", "form=log error_weight=2", "form=log error_weight=#2",
        "form=sin error_weight=2", "form=sin error_weight=#2",
    ]  # fmt: skip
    assert got[2].point == {"form": '"log"', "error_weight": "[1.0, 1.0, 1.0, 9.0, 9.0, 9.0]"}
    assert got[1].point["error_weight"] == "2.0"


@pytest.mark.parametrize(
    ("sets", "grids", "text"),
    [
        ({"best": {"KK": {}}}, None,
         r"^parameter_sets\.best: unknown name 'KK'; did you mean 'K'\? \(allowed: K, LQR\)$"),
        ({"best": {"K": {"error_weight": 1}}}, None,
         r"^parameter_sets\.best\.K: unknown key 'error_weight' \(allowed: kind, .*gain, "),
        ({"best": {"K": {"gian": 1}}}, None, r"^parameter_sets\.best\.K: unknown key 'gian'; did you mean 'gain'\?"),
        ({"best": {"K": {"gain": "high"}}}, None, r"^parameter_sets\.best\.K: gain: expected"),
        ({"best": {"K": {"kind": "open-loop"}}}, None, r"^parameter_sets\.best\.K: kind: unknown name 'open-loop'"),
        (None, {"LRQ": {"error_weight": [1]}}, r"^grids\.LRQ: unknown name 'LRQ'; did you mean 'LQR'\?"),
        (None, {"K": {"error_weight": [1]}}, r"^grids\.K: unknown key 'error_weight'"),
        (None, {"K": {"gain": [1, 2, 1.0]}}, r"^grids\.K\.gain: two values are called 'gain=1'$"),
        (None, {"K": {"gain": list(range(1000)), "hysteresis": list(range(1000))}},
         r"^grids\.K: makes 1,000,000 parameter sets; at most 100,000$"),
        ({"best": {"K": {}}}, {"K": {"gain": [1]}},
         r"^parameter_sets\.best\.K: the law has a grid too; give it sets or a grid$"),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_named(sets, grids, text):
    with pytest.raises(Error, match=text):
        variants(LAWS, sets, grids)

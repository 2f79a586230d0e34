"""Points of parameter studies: known by number and seed, where they should be, and what is refused."""

import itertools

import msgspec
import numpy as np
import pytest

from dqcontrol.errors import Error
from dqcontrol.experiments.sweep import Range, Sampling

OVER = {
    "law.gain": {"low": 0.1, "high": 1000, "scale": "log"},
    "start.2": {"low": -1, "high": 3},
    "seed": {"low": 4, "high": 7, "scale": "integer"},
    "plant.kind": ["integrator", "servo", "other"],
}
METHODS = ("random", "sobol", "halton")


def sampling(**keys):
    made = msgspec.convert({"over": OVER, **keys}, Sampling)
    made.check()
    return made


def columns(points):
    return {key: [point[key] for point in points] for key in points[0]}


@pytest.mark.parametrize("method", METHODS)
def test_a_point_is_known_by_its_number(method):
    pytest.importorskip("scipy")
    one, other = (sampling(method=method, points=100, seed=3) for _ in range(2))
    whole = list(one.points_between(0, 100))
    cut = [0, 1, 17, 64, 100]
    parts = [other.points_between(a, b) for a, b in itertools.pairwise(cut)]
    assert list(itertools.chain(*parts)) == whole
    assert list(sampling(method=method, points=100, seed=4).points_between(0, 100)) != whole


@pytest.mark.parametrize("method", METHODS)
def test_points_fill_the_ranges_evenly(method):
    pytest.importorskip("scipy")
    drawn = columns(list(sampling(method=method, points=4096, seed=1).points_between(0, 4096)))
    gains = (np.log10(drawn["law.gain"]) + 1) / 4
    starts = (np.array(drawn["start.2"]) + 1) / 4
    tolerance = 0.03 if method == "random" else 0.003  # the law of large numbers; quasi-random beats it
    for shares in (gains, starts):
        assert 0 <= shares.min() <= shares.max() <= 1
        assert abs(shares.mean() - 0.5) < tolerance
        assert np.max(np.abs(np.sort(shares) - np.linspace(0, 1, 4096))) < tolerance
    seeds, counts = np.unique(drawn["seed"], return_counts=True)
    assert seeds.tolist() == [4, 5, 6, 7]
    assert all(type(seed) is int for seed in drawn["seed"])
    assert np.max(np.abs(counts / 1024 - 1)) < 0.1
    kinds = [drawn["plant.kind"].count(kind) for kind in OVER["plant.kind"]]
    assert np.max(np.abs(np.array(kinds) / 1365 - 1)) < 0.1


def test_a_grid_is_every_combination():
    over = {
        "a": [1, "x", None],
        "b": {"low": 1, "high": 100, "scale": "log", "count": 3},
        "c": {"low": 0, "high": 5, "scale": "integer", "count": 3},
    }
    grid = sampling(over=over)
    found = [tuple(point.values()) for point in grid.points_between(0, grid.size)]
    assert [(a, round(b, 9), c) for a, b, c in found] == list(
        itertools.product([1, "x", None], [1, 10, 100], [0, 2, 5])
    )


def test_ends_vary_one_key_at_a_time():
    ends = list(sampling(over={"a": {"low": 1, "high": 2, "count": 3}, "b": [7, 8]}).ends())
    assert ends == [
        {"a": 1, "b": 7},
        {"a": 1, "b": 7}, {"a": 2, "b": 7},
        {"a": 1, "b": 7}, {"a": 1, "b": 8},
    ]  # fmt: skip


def test_ends_of_a_log_range_are_exact():
    found = Range(low=0.1, high=0.3, scale="log")
    assert (found.at(0), found.at(1)) == (0.1, 0.3)
    assert 0.1 <= found.at(1e-17) <= found.at(1 - 1e-16) <= 0.3


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"over": {"a": {"low": 2, "high": 1, "count": 3}}}, r"sweep\.over\.a: low must be < high, got 2 and 1"),
        ({"over": {"a": {"low": 0, "high": 1, "scale": "log", "count": 3}}}, "a log range needs low > 0, got 0"),
        ({"over": {"a": {"low": 0, "high": 1.5, "scale": "integer"}}, "method": "random", "points": 9}, "integers"),
        ({"over": {"a": {"low": 0, "high": 1}}}, "a range in a grid needs 'count'"),
        ({"over": {"a": [1]}, "points": 9}, "a grid has as many points as its values combine to"),
        ({"method": "sobol"}, "missing key 'points', which method 'sobol' needs"),
        ({"method": "random", "points": 9, "over": {"a": {"low": 0, "high": 1, "count": 3}}}, "'count' is for grids"),
        ({"over": {k: list(range(1000)) for k in "abc"}}, "makes 1,000,000,000 points; at most 10,000,000"),
    ],
)  # fmt: skip
def test_what_is_refused(keys, message):
    with pytest.raises(Error, match=message):
        sampling(**keys)

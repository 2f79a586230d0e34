import math

import numpy as np
import pytest

from dqcontrol.errors import ShapeError, ValueRangeError
from dqcontrol.measures.repeats import mean_of, paired_difference, spread_ratio

# Student, The probable error of a mean, Biometrika 6 (1908): hours of sleep gained with two drugs, ten patients.
DEXTRO = [0.7, -1.6, -0.2, -1.2, -0.1, 3.4, 3.7, 0.8, 0.0, 2.0]
LAEVO = [1.9, 0.8, 1.1, 0.1, -0.1, 4.4, 5.5, 1.6, 4.6, 3.4]


def test_mean_and_deviation_of_a_published_table():
    # [P16 Table 6], LQR in DQ; its mean and standard deviation stand in [P16 Table 5.4].
    errors = [
        *(5.599988, 5.462487, 5.466275, 5.837564, 5.482014),
        *(5.555529, 5.309714, 5.786483, 5.567993, 5.861354),
    ]
    found = mean_of(errors)
    assert (found.count, round(found.mean, 3), round(found.deviation, 3)) == (10, 5.593, 0.182)
    assert found.variation == pytest.approx(0.182 / 5.593, rel=3e-3)


def test_student_s_sleeping_drugs():
    found = paired_difference(dict(enumerate(DEXTRO)), dict(enumerate(LAEVO)))
    assert found.pairs == 10
    assert found.mean == pytest.approx(-1.58)
    assert found.half_width == pytest.approx((2.4598858 - 0.7001142) / 2)
    assert found.p_value == pytest.approx(0.00283289, rel=1e-6)
    assert found.excludes_zero
    wider = paired_difference(dict(enumerate(DEXTRO)), dict(enumerate(LAEVO)), level=0.999)
    assert not wider.excludes_zero


def test_only_seeds_that_both_groups_have_are_paired():
    first, second = {1: 2.0, 2: 4.0, 9: 1000.0}, {2: 3.0, 1: 1.5, 7: -1000.0}
    found = paired_difference(first, second)
    assert (found.pairs, found.mean) == (2, 0.75)
    assert found.half_width == pytest.approx(12.7062 * 0.25, rel=1e-5)  # t(1) and s/√2
    lonely = paired_difference({1: 2.0}, {1: 1.0})
    assert (lonely.pairs, lonely.mean) == (1, 1.0)
    assert math.isnan(lonely.half_width)
    assert math.isnan(lonely.p_value)
    assert not lonely.excludes_zero
    none = paired_difference({1: 2.0}, {2: 1.0})
    assert none.pairs == 0
    assert math.isnan(none.mean)


def test_runs_without_noise_have_no_spread_at_all():
    found = mean_of([0.1] * 7)
    assert (found.mean, found.deviation, found.half_width()) == (0.1, 0.0, 0.0)
    same = paired_difference({1: 0.1, 2: 0.1}, {1: 0.1, 2: 0.1})
    assert (same.mean, same.half_width, same.p_value, same.excludes_zero) == (0.0, 0.0, 1.0, False)
    shifted = paired_difference({1: 0.75, 2: 0.75}, {1: 0.5, 2: 0.5})
    assert (shifted.mean, shifted.half_width, shifted.p_value, shifted.excludes_zero) == (
        0.25,
        0.0,
        0.0,
        True,
    )
    assert math.isnan(spread_ratio(mean_of([1.0, 2.0]), found).ratio)
    assert spread_ratio(found, mean_of([1.0, 2.0])).ratio == 0


def test_one_run_has_a_mean_and_no_spread():
    one = mean_of([3.0])
    assert (one.count, one.mean) == (1, 3.0)
    assert math.isnan(one.deviation)
    assert math.isnan(one.half_width())
    assert math.isnan(mean_of([-1.0, 1.0]).variation)


def test_intervals_against_scipy():
    stats = pytest.importorskip("scipy.stats")
    random = np.random.default_rng(20261122)
    for _ in range(20):
        count, level = int(random.integers(2, 60)), float(random.uniform(0.5, 0.999))
        first, second = random.normal(1.0, 0.3, count), random.normal(1.1, 0.5, count)
        truth = stats.ttest_rel(first, second)
        found = paired_difference(dict(enumerate(first)), dict(enumerate(second)), level)
        assert found.p_value == pytest.approx(truth.pvalue, rel=1e-8)
        low, high = truth.confidence_interval(level)
        assert (found.mean, found.half_width) == pytest.approx(((low + high) / 2, (high - low) / 2), rel=1e-9)
        interval = stats.ttest_1samp(first, 0.0).confidence_interval(level)
        assert mean_of(first).half_width(level) == pytest.approx((interval.high - interval.low) / 2)


def test_spread_ratio_by_tables_of_the_f_distribution():
    # F(0.975; 9, 9) = 4.026, F(0.95; 4, 6) = 4.534, F(0.95; 6, 4) = 6.163
    ten = np.arange(10.0)
    found = spread_ratio(mean_of(3 * ten), mean_of(ten))
    assert found.ratio == pytest.approx(3)
    assert (found.low, found.high) == pytest.approx((3 / math.sqrt(4.026), 3 * math.sqrt(4.026)), rel=1e-3)
    assert found.excludes_one
    found = spread_ratio(mean_of(np.arange(5.0)), mean_of(np.arange(7.0)), level=0.9)
    ratio = math.sqrt(2.5 / (28 / 6))
    assert found.ratio == pytest.approx(ratio)
    assert (found.low, found.high) == pytest.approx(
        (ratio / math.sqrt(4.534), ratio * math.sqrt(6.163)), rel=1e-3
    )
    assert not found.excludes_one


def test_the_two_sides_of_the_f_test_agree():
    first, second = mean_of([1.0, 2.0, 4.0, 8.0]), mean_of([1.0, 1.5, 2.5, 1.0, 1.2])
    one, other = spread_ratio(first, second), spread_ratio(second, first)
    assert one.p_value == pytest.approx(other.p_value)
    assert one.low == pytest.approx(1 / other.high)
    at_the_edge = spread_ratio(first, second, level=1 - one.p_value)
    assert at_the_edge.low == pytest.approx(1)
    assert spread_ratio(first, first).p_value == pytest.approx(1)


def test_ninety_five_of_a_hundred_intervals_hold_the_truth():
    random = np.random.default_rng(20261122)
    held = 0
    for sample in random.normal(5.0, 2.0, (2000, 4)):
        found = mean_of(sample)
        held += abs(found.mean - 5.0) <= found.half_width(0.95)
    assert abs(held / 2000 - 0.95) < 5 * math.sqrt(0.95 * 0.05 / 2000)


@pytest.mark.parametrize(
    ("call", "kind", "message"),
    [
        (lambda: mean_of([]), ShapeError, "values: expected at least one, got none"),
        (lambda: mean_of([1.0, math.nan]), ValueRangeError, "values: must be finite"),
        (
            lambda: mean_of([1.0, 2.0]).half_width(95),
            ValueRangeError,
            "level: must be between 0 and 1, got 95",
        ),
        (lambda: paired_difference({}, {}, 1.0), ValueRangeError, "level: must be between 0 and 1, got 1"),
        (lambda: paired_difference({1: math.inf}, {1: 0.0}), ValueRangeError, "must be finite"),
    ],
)
def test_bad_input(call, kind, message):
    with pytest.raises(kind, match=message):
        call()

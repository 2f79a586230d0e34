"""What laws refuse, and what they say."""

import numpy as np
import pytest

from dqcontrol.errors import DivergedError, Error, ShapeError, ValueRangeError
from dqcontrol.laws import DampedInverse, FilteredInverse, Proportional, ProportionalFeedforward, Schedule
from dqcontrol.references import Sample

ONE = [1.0, 0, 0, 0, 0, 0, 0, 0]
LAWS = [Proportional, ProportionalFeedforward]


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize(
    ("gain", "kind", "text"),
    [
        (0, ValueRangeError, r"^gain: must be > 0, got 0$"),
        (-2, ValueRangeError, r"^gain: must be > 0, got -2$"),
        (float("nan"), ValueRangeError, r"^gain: must be finite, got nan$"),
        (float("inf"), ValueRangeError, r"^gain: must be finite, got inf$"),
        ([1.0] * 7, ShapeError, r"^gain: expected one number or 8, got shape \(7,\)$"),
        ([1.0] * 7 + [0.0], ValueRangeError, r"^gain\[7\]: must be > 0, got 0$"),
        ([1.0] * 7 + [np.nan], ValueRangeError, r"^gain\[7\]: must be finite, got nan$"),
        (np.ones((2, 8)), ShapeError, r"^gain\[0\]: expected a number, got a list"),
        ("3", ShapeError, r"^gain: expected a number or Schedule or a list, got text '3'$"),
        (None, ShapeError, r"^gain: expected a number or Schedule or a list, got nothing$"),
        (1j, ShapeError, r"^gain: expected a number or Schedule or a list, got complex"),
        (
            lambda: Schedule([], []),
            ShapeError,
            r"^schedule.times: expected a list of length >= 1, got \[\]$",
        ),
        (
            lambda: Schedule([0], [1, 2]),
            ShapeError,
            r"^schedule: expected as many values as times.*got 2 and 1$",
        ),
        (lambda: Schedule([0, 0], [1, 2]), ValueRangeError, r"^schedule.times: must increase, got \[0, 0\]$"),
        (lambda: Schedule([1, 0], [1, 2]), ValueRangeError, r"^schedule.times: must increase, got \[1, 0\]$"),
        (lambda: Schedule([0, np.nan], [1, 2]), ValueRangeError, r"^schedule.times\[1\]: must be finite"),
        (lambda: Schedule([0, 1], [1, np.nan]), ValueRangeError, r"^schedule.values\[1\]: must be finite"),
        (
            lambda: Schedule(["a"], [1]),
            ShapeError,
            r"^schedule.times\[0\]: expected a number, got text 'a'$",
        ),
        (lambda: Schedule([0, 1], [1, 0]), ValueRangeError, r"^schedule.values\[1\]: must be > 0, got 0$"),
        (
            lambda: Schedule([0, 1e9], [1, 2]),
            ValueRangeError,
            r"gain schedule: takes 100,000,000,001 steps; at most",
        ),
    ],
)
def test_gains(make_arm, law, gain, kind, text):
    with pytest.raises(kind, match=text):
        law(gain=gain() if callable(gain) else gain).prepare(make_arm(6), None, 0.01)


@pytest.mark.parametrize("bad", [0, -1, float("nan"), "a", None])
@pytest.mark.parametrize("field", ["damped.damping", "filtered.threshold", "filtered.damping"])
def test_inverses(field, bad):
    kind, name = field.split(".")
    with pytest.raises(Error, match=rf"^inverse.{name}: (must be > 0|must be finite|expected a number), got"):
        (DampedInverse if kind == "damped" else FilteredInverse)(**{name: bad})


@pytest.mark.parametrize("bad", [1.0, -0.1, float("nan"), "a"])
def test_hysteresis(bad):
    with pytest.raises(
        Error, match=r"^hysteresis: (must be (< 1|≥ 0)|must be finite|expected a number), got"
    ):
        Proportional(gain=1.0, hysteresis=bad)


@pytest.mark.parametrize("bad", [0, -0.01, float("nan"), "a"])
def test_period(make_arm, bad):
    with pytest.raises(Error, match=r"^period: (must be > 0|must be finite|expected real numbers), got"):
        Proportional(gain=1.0).prepare(make_arm(6), None, bad)


@pytest.mark.parametrize(
    ("q", "text"),
    [
        (np.zeros(5), r"^q: expected shape \(6,\) for arm of 6, got \(5,\)$"),
        (np.zeros((2, 6)), r"^q: expected shape \(6,\) for arm of 6, got \(2, 6\)$"),
        (np.zeros(0), r"^q: expected shape \(6,\) for arm of 6, got \(0,\)$"),
        ([0.0] * 7, r"^q: expected shape \(6,\) for arm of 6, got \(7,\)$"),
        (np.full(6, np.nan), r"^q: must be finite, got \[nan"),
        ([0, 0, 0, 0, 0, np.inf], r"^q: must be finite, got"),
        ("zero", r"^q: expected real numbers, got 'zero'$"),
        (None, r"^q: expected real numbers, got None$"),
    ],
    ids=str,
)
def test_configurations(make_arm, q, text):
    law = Proportional(gain=1.0).prepare(make_arm(6), None, 0.01)
    with pytest.raises(Error, match=text):
        law.command(q, Sample(ONE), law.initial_state(np.zeros(6)))


def test_lists_integers_and_foreign_layouts_are_configurations(make_arm):
    arm, q = make_arm(6), np.array([1.0, 0, 1, 0, 1, 0])
    law = Proportional(gain=1.0).prepare(arm, None, 0.01)
    sample = Sample(arm.fkm(q + 0.1))
    wanted = law.command(q, sample, law.initial_state(q))
    frozen = q.copy()
    frozen.flags.writeable = False
    for same in (q.tolist(), q.astype(int), q.astype(np.float32), np.repeat(q, 2)[::2], frozen):
        assert np.array_equal(law.command(same, sample, law.initial_state(q)), wanted)
        assert np.array_equal(Proportional(gain=1.0).command(arm, same, sample, period=0.01), wanted)
    out = np.empty(6)
    assert law.command(q, sample, law.initial_state(q), out) is out
    with pytest.raises(ShapeError, match=r"^sample: expected references.Sample, got array"):
        law.command(q, sample.pose, law.initial_state(q))
    assert np.array_equal(out, wanted)


@pytest.mark.parametrize("state", [np.zeros(0), np.zeros(2), [0.0], np.zeros(1, dtype=int), None])
def test_state_comes_from_initial_state(make_arm, state):
    law = Proportional(gain=1.0).prepare(make_arm(6), None, 0.01)
    with pytest.raises(Error, match=r"^state: expected the array from initial_state, 1 numbers, got"):
        law.command(np.zeros(6), Sample(ONE), state)


def test_output_of_the_wrong_size(make_arm):
    law = Proportional(gain=1.0).prepare(make_arm(6), None, 0.01)
    with pytest.raises(ShapeError, match=r"^out: expected shape \(6,\), got \(3,\)$"):
        law.command(np.zeros(6), Sample(ONE), law.initial_state(np.zeros(6)), np.empty(3))


@pytest.mark.parametrize(
    "inverse", [FilteredInverse(), FilteredInverse(threshold=10), DampedInverse(damping=1e-3)]
)
@pytest.mark.parametrize("n", [5, 7])
def test_a_command_that_overflows_is_an_error(make_arm, n, inverse):
    """Where the target overflows, and where only the inverse makes it too large."""
    arm, q = make_arm(n), np.full(n, 0.4)
    law = Proportional(gain=1.7e308, inverse=inverse)
    for sample in (Sample([0, 1, 0, 0, 0, 0, 1e3, 0]), Sample([0, 0, 0, 1, 0, 0, 0, 0])):
        with pytest.raises(DivergedError, match=r"^the command is not finite$"):
            law.command(arm, q, sample, period=0.01)


def test_laws_are_frozen():
    with pytest.raises(AttributeError):
        Proportional(gain=1.0).gain = 2.0


@pytest.mark.parametrize(
    ("arguments", "named", "text"),
    [
        (
            (5,),
            {},
            r"^Proportional\(5\): give parameters by name, as Proportional\(gain=5\) \(Proportional has: gain",
        ),
        (
            (),
            {"gian": 5},
            r"^Proportional: unknown parameter 'gian'; did you mean 'gain'\? \(Proportional has:",
        ),
        ((), {}, r"^Proportional: give gain \(Proportional has: gain, "),
    ],
)
def test_parameters_have_names(arguments, named, text):
    with pytest.raises(TypeError, match=text):
        Proportional(*arguments, **named)

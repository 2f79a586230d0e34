"""Numbers in verdicts and messages: no powers of ten where a person reads percent, degrees and millimetres."""

import math

import pytest

from dqcontrol.measures.task_result import TaskResult
from dqcontrol.tables.number_texts import angle_text, force_text, length_text, number_text, percent_text


@pytest.mark.parametrize(
    ("value", "digits", "text"),
    [
        (0.0, 2, "0"),
        (0.01234, 2, "0.012"),
        (99.4, 2, "99"),
        (99.6, 2, "100"),
        (130.2, 2, "130"),
        (-99.6, 2, "-100"),
        (999.4, 3, "999"),
        (999.6, 3, "1000"),
        (46512.3, 4, "46512"),
        (1e-7, 3, "0.0000001"),
    ],
)
def test_digits_or_all_before_the_point(value, digits, text):
    assert number_text(value, digits) == text


def test_quantities():
    assert length_text(0.2003, 2) == "200 mm"
    assert length_text(-0.9996) == "−1000 mm"
    assert length_text(1.234) == "1.23 m"
    assert force_text(375.4) == "375 N"
    assert angle_text(math.radians(130.2)) == "130°"
    assert percent_text(1.0) == "100 %"


def test_what_is_far_from_its_goal():
    """A mobile base that rests 5.4 m and 130° away."""
    far = TaskResult("not reached", 5.4, math.radians(130.2), 0.001, 0.01, speed=0.0)
    assert far.words == "not reached: rests 5.4 m, 130° off"

import numpy as np
import pytest

from dqcontrol.errors import ShapeError
from dqcontrol.figures.plots import limit_margins, readings
from dqcontrol.loop.record import Record
from dqcontrol.loop.signals import Signal
from dqcontrol.robots.limits import Limits

TIME = np.linspace(0, 1, 5)


def make(**signals):
    pose = np.tile([1.0, 0, 0, 0, 0, 0, 0, 0], (5, 1))
    q = np.column_stack([TIME, -TIME])
    return Record(TIME, q, q, q, pose, np.hstack([pose, np.zeros((5, 13))]), ("a", "b"), readings=signals)


def signal(name, parts, unit, values):
    return Signal(name, parts, (unit,) * max(1, len(parts)), np.reshape(values, (5, -1)))


def lines(axes):
    return {line.get_label(): np.asarray(line.get_ydata()) for line in axes.get_lines()}


def test_forces_have_panels_with_units_and_what_was_zero_has_none():
    force = np.outer(TIME, [1.0, 2.0, 3.0])
    figure = readings(
        make(
            contact_force=signal("contact_force", ("x", "y", "z"), "N", force),
            push=signal("push", ("x", "y", "z"), "N", 0 * force),
            payload=signal("payload", (), "kg", 0.5 + 0 * TIME),
            payload_estimate=signal("payload_estimate", (), "kg", 0.5 * TIME),
            mode=signal("mode", (), "", 5 + 0 * TIME),
        )
    )
    contact, payload = figure.axes
    assert (contact.get_ylabel(), payload.get_ylabel()) == ("contact [N]", "payload [kg]")
    np.testing.assert_array_equal(lines(contact)["y"], 2 * TIME)
    np.testing.assert_array_equal(lines(payload)["estimate"], 0.5 * TIME)


def test_margins_are_shares_of_half_the_range():
    limits = Limits(np.array([-1.0, -np.inf]), np.array([3.0, 1.0]), np.full(2, np.inf), np.full(2, np.inf))
    (axes,) = limit_margins(make(), limits).axes
    found = lines(axes)
    np.testing.assert_allclose(found["a"], np.minimum(TIME + 1, 3 - TIME) / 2)
    assert "b" not in found  # open on one side


def test_nothing_to_draw_is_an_error():
    with pytest.raises(ShapeError, match="no readings of forces"):
        readings(make(mode=signal("mode", (), "", TIME)))
    with pytest.raises(ShapeError, match="no joint has both"):
        limit_margins(make(), Limits.none(2))

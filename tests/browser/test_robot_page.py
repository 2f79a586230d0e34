"""A robot alone in the browser, without a browser: sliders within limits, the hand where they put it."""

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.browser import RobotPage
from dqcontrol.browser.robot_page import reached_points

pytest.importorskip("viser", reason="the browser view needs viser: pip install 'dqcontrol[view]'")


def test_sliders_move_the_robot_within_its_limits():
    arm = dqc.load_robot("iiwa7")
    page = RobotPage(arm, 18190)
    try:
        q = np.array([0.1, -0.4, 0.2, 1.0, 0.0, arm.limits.upper[5], 9.0])
        page.set(q)
        page.tick()
        ends = np.array([[slider.min, slider.max] for slider in page._sliders])
        np.testing.assert_array_equal(ends, ends.round(1))  # 120, not 119.99998
        expected = np.minimum(q, arm.limits.upper)
        np.testing.assert_allclose(page.q, expected, atol=1e-3)  # sliders have steps
        told = page._numbers.content
        x, y, z = dqc.algebra.translation(arm.fkm(page.q))
        assert f"{x:.3f}, {y:.3f}, {z:.3f}" in told
        assert "joint_6 to its limit" in told
        assert "joint_1 to its limit" not in told
        assert f"start: [{', '.join(f'{value:.4g}' for value in page.q)}]" in told
    finally:
        page.server.stop()


def test_what_is_reached_lies_within_the_reach_and_bases_rest():
    arm = dqc.load_robot("iiwa7")
    points = reached_points(arm, arm.limits.lower, arm.limits.upper)
    shoulder = arm.frames(np.zeros(7))[1]
    far = np.linalg.norm(points - dqc.algebra.translation(shoulder), axis=1)
    assert 0.8 * 0.926 < far.max() < 0.927
    youbot = dqc.load_robot("youbot")
    low, high = (np.clip(bound, -np.pi, np.pi) for bound in (youbot.limits.lower, youbot.limits.upper))
    assert np.abs(reached_points(youbot, low, high)[:, :2]).max() < 1.2

"""Odometry that drifts: its covariance against closed forms, and against many drives."""

import numpy as np
import pytest

from dqcontrol.ros2.messages import OdometryDrift

DEVIATIONS = np.array([0.02, 0.01, 0.03])  # m/√m, rad/√m, rad/√rad


def driven(poses, seed=0):
    drift = OdometryDrift(poses[0], np.random.default_rng(seed))
    drift.deviations = DEVIATIONS
    for pose in poses[1:]:
        drift.follow(pose)
    return drift


def test_on_a_straight_way_and_a_turn_on_the_spot_the_covariance_is_the_closed_form():
    """Of small errors, so to first order: along σ_s² L, heading σ_m² L, sideways ∫ σ_m² (L − s)² ds = σ_m² L³/3."""
    way, (along, by_way, by_turn) = 4.0, DEVIATIONS**2
    straight = np.column_stack([np.linspace(0, way, 2001), np.zeros((2001, 2))])
    found = np.mean([driven(straight[::20], seed).covariance for seed in range(40)], axis=0)
    assert found[0, 0] == pytest.approx(along * way, rel=0.02)
    assert found[2, 2] == pytest.approx(by_way * way, rel=1e-9)
    assert found[1, 1] == pytest.approx(by_way * way**3 / 3, rel=0.03)
    assert found[1, 2] == pytest.approx(by_way * way**2 / 2, rel=0.03)
    spot = np.column_stack([np.ones((101, 2)), np.linspace(0, -5, 101)])
    np.testing.assert_allclose(driven(spot).covariance, np.diag([0, 0, by_turn * 5.0]), atol=1e-12)


@pytest.mark.slow
def test_many_drives_scatter_as_the_covariance_says():
    turns = 0.05 * np.sin(np.linspace(0, 9, 60))
    heading = np.concatenate([[0.3], 0.3 + np.cumsum(turns)])
    steps = 0.1 * np.column_stack([np.cos(heading[1:] - turns / 2), np.sin(heading[1:] - turns / 2)])
    poses = np.column_stack([np.vstack([np.zeros(2), np.cumsum(steps, axis=0)]), heading])
    ends = [driven(poses, seed) for seed in range(300)]
    errors = np.array([each.pose - poses[-1] for each in ends])
    said = np.mean([each.covariance for each in ends], axis=0)
    np.testing.assert_allclose(np.var(errors, axis=0), np.diag(said), rtol=0.25)
    squares = [e @ np.linalg.solve(each.covariance, e) for e, each in zip(errors, ends, strict=True)]
    print(f"mean of eᵀP⁻¹e over {len(ends)} drives of 6 m: {np.mean(squares):.2f}")
    assert np.mean(squares) == pytest.approx(3.0, abs=0.45)  # χ² with 3 degrees: the mean of 300 has σ = 0.14
    assert np.abs(errors.mean(axis=0)).max() < 0.02


def test_without_deviations_it_is_where_the_base_is():
    drift = OdometryDrift(np.array([0.2, -0.1, 0.4]), np.random.default_rng(0))
    for pose in np.random.default_rng(1).uniform(-1, 1, (20, 3)):
        drift.follow(pose)
        np.testing.assert_array_equal(drift.pose, pose)
    assert not drift.covariance.any()

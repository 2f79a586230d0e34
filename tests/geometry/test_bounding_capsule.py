"""Capsules around points contain them, and are about as small as the truth where it is known."""

import numpy as np
import pytest
from shape_samples import random_pose, random_shape

import dqcontrol as dqc
from dqcontrol import geometry


def depth(capsule, points):
    return max(geometry.distance(geometry.Point(point), capsule).distance for point in points)


def surface(capsule, rng, count=400):
    """Points on a capsule's surface."""
    along = capsule.start + rng.uniform(0, 1, (count, 1)) * (capsule.end - capsule.start)
    ends = np.where(rng.uniform(size=(count, 1)) < 0.5, capsule.start, capsule.end)
    out = rng.normal(size=(count, 3))
    axis = (capsule.end - capsule.start) / np.linalg.norm(capsule.end - capsule.start)
    across = out - (out @ axis)[:, None] * axis
    middle = along + capsule.radius * across / np.linalg.norm(across, axis=1)[:, None]
    round_ends = ends + capsule.radius * out / np.linalg.norm(out, axis=1)[:, None]
    return np.vstack([middle, round_ends])


def test_points_of_a_capsule_give_it_back():
    rng = np.random.default_rng(1)
    for _ in range(2):
        capsule = random_shape("capsule", rng)
        points = surface(capsule, rng)
        points = points[[geometry.distance(geometry.Point(p), capsule).distance > -1e-9 for p in points]]
        found = geometry.bounding_capsule(points)
        assert depth(found, points) < 1e-12
        assert found.volume < 1.02 * capsule.volume


def test_points_of_boxes_are_inside():
    rng = np.random.default_rng(2)
    for _ in range(3):
        corners = rng.uniform(0.1, 1, 3) * (np.indices((2, 2, 2)).reshape(3, 8).T - 0.5)
        pose = random_pose(rng)
        matrix = dqc.algebra.matrix_from_pose(pose)
        points = corners @ matrix[:3, :3].T + matrix[:3, 3]
        found = geometry.bounding_capsule(points)
        assert depth(found, points) < 1e-12
        ball = 4 / 3 * np.pi * np.linalg.norm(corners[0]) ** 3
        assert found.volume <= ball * (1 + 1e-9)


def test_degenerate_points():
    one = geometry.bounding_capsule([[1, 2, 3], [1, 2, 3]])
    assert (one.radius, one.start.tolist()) == (0.0, [1, 2, 3])
    line = geometry.bounding_capsule([[0, 0, 0], [1, 0, 0], [0.3, 0, 0]])
    assert line.volume < 1e-6
    assert depth(line, [[0, 0, 0], [1, 0, 0]]) < 1e-12
    with pytest.raises(dqc.Error, match="points: expected"):
        geometry.bounding_capsule(np.zeros((0, 3)))

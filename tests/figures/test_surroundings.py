"""What stands around a path, in figures: faces lie on the shapes, are cut off, and appear where the things are."""

import numpy as np
import pytest
from obstacles import around, plane, sphere

import dqcontrol as dqc
from dqcontrol import algebra
from dqcontrol.figures.surroundings import corners_of, faces_near, faces_of
from dqcontrol.geometry import Box, Capsule, Cylinder, InfiniteCylinder, Plane, Point, Sphere, distance

TURNED = algebra.pose(algebra.rotation_from_axis_angle([0.6, 0.8, 0.0], 0.7), [0.1, 0.2, 0.3])


@pytest.mark.parametrize(
    "shape",
    [
        Sphere([0.1, 0.2, 0.3], 0.2),
        Capsule([0, 0, 0], [0.1, 0.3, -0.2], 0.1),
        Box(TURNED, [0.1, 0.2, 0.4]),
        Plane([0, 0.6, 0.8], 0.3),
        Cylinder([0.1, 0, 0], [0.3, 0.1, 0.2], 0.1),
        InfiniteCylinder([0.1, 0, 0], [0, 0.6, 0.8], 0.1),
    ],
    ids=lambda each: type(each).__name__,
)
def test_corners_lie_on_the_shape(shape):
    corners = np.vstack(list(faces_of(shape, 1.0)))
    rounding = 1e-7 if isinstance(shape, Cylinder) else 1e-9  # found by iteration
    assert max(abs(distance(Point(corner), shape).distance) for corner in corners) < rounding


def constraints(**obstacles):
    return dqc.laws.Constraints(**around(obstacles))


def test_a_ball_that_moves_appears_twice_and_what_is_far_does_not():
    path = np.array([[0.0, 0, 0.5], [1, 0, 0.5]])
    times = np.array([0.0, 1.0, 2.0])
    ball = sphere(center=(0.2, 0, 0.5), radius=0.1, velocity=(0.3, 0, 0))
    far = sphere(center=(9, 0, 0.5), radius=0.1)
    first, last = faces_near(constraints(ball=ball, far=far), path, times)
    assert first.strength < last.strength
    moved = corners_of([last]).mean(axis=0) - corners_of([first]).mean(axis=0)
    np.testing.assert_allclose(moved, [0.6, 0, 0], atol=1e-12)
    assert faces_near(None, path, times) == []


def test_planes_are_cut_off_around_the_path():
    path = np.array([[0.0, 0, 0.5], [1, 0, 0.5]])
    wall = plane(normal=(1, 0, 0), offset=-0.2)
    (drawn,) = faces_near(constraints(wall=wall), path, np.array([0.0, 1.0]))
    corners = corners_of([drawn])
    np.testing.assert_allclose(corners[:, 0], -0.2)
    np.testing.assert_allclose([corners[:, 1].min(), corners[:, 1].max()], [-0.5, 0.5])
    np.testing.assert_allclose([corners[:, 2].min(), corners[:, 2].max()], [0, 1], atol=2e-3)

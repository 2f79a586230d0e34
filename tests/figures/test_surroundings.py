"""What stands around a path, in figures: faces lie on the shapes, are cut off, and appear where the things are."""

import numpy as np
import pytest
from obstacles import around, column, plane, sphere

import dqcontrol as dqc
from dqcontrol import algebra
from dqcontrol.figures.surroundings import corners_of, entries, faces_near, faces_of
from dqcontrol.geometry import Box, Capsule, Cylinder, InfiniteCylinder, Plane, Point, Sphere, distance
from dqcontrol.loop import Record
from dqcontrol.loop.signals import DISTANCE, Signal

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
    return dqc.constraints.Constraints(**around(obstacles))


def recorded(times, **distances):
    """A run of these times, with distances to things by name, m."""
    count = len(times)
    q, pose = np.zeros((count, 1)), np.tile([1.0, 0, 0, 0, 0, 0, 0, 0], (count, 1))
    values = np.column_stack([*distances.values(), np.zeros(count)])[:, : len(distances)]
    readings = (
        {DISTANCE: Signal(DISTANCE, tuple(distances), ("m",) * len(distances), values)} if distances else {}
    )
    desired = np.hstack([pose, np.zeros((count, 13))])
    return Record(np.asarray(times, float), q, q, q, pose, desired, ("a",), readings=readings)


def test_a_ball_that_moves_is_drawn_where_it_was_nearest_and_what_is_far_is_not():
    path = np.array([[0.0, 0, 0.5], [1, 0, 0.5]])
    ball = sphere(center=(0.2, 0, 0.5), radius=0.1, velocity=(0.3, 0, 0))
    far = sphere(center=(9, 0, 0.5), radius=0.1)
    things = constraints(ball=ball, far=far)
    for distances, shift in (({}, 0.6), ({"ball": [0.3, 0.1, 0.2]}, 0.3)):
        record = recorded([0.0, 1.0, 2.0], **distances)
        first, nearest = faces_near(things, path, record)
        assert first.strength < nearest.strength
        moved = corners_of([nearest]).mean(axis=0) - corners_of([first]).mean(axis=0)
        np.testing.assert_allclose(moved, [shift, 0, 0], atol=1e-12)
    assert [each.get_label() for each in entries([first, nearest])] == [
        "ball at the start",
        "ball, nearest at 1 s",
    ]
    assert faces_near(None, path, record) == []


def test_planes_are_cut_off_around_the_path():
    path = np.array([[0.0, 0, 0.5], [1, 0, 0.5]])
    wall = plane(normal=(1, 0, 0), offset=-0.2)
    (drawn,) = faces_near(constraints(wall=wall), path, recorded([0.0, 1.0]))
    corners = corners_of([drawn])
    np.testing.assert_allclose(corners[:, 0], -0.2)
    np.testing.assert_allclose([corners[:, 1].min(), corners[:, 1].max()], [-0.25, 0.25])
    np.testing.assert_allclose([corners[:, 2].min(), corners[:, 2].max()], [0.25, 0.75], atol=2e-3)


@pytest.mark.parametrize("direction", [(0, 0, 1), (0, 0.6, 0.8)])
def test_a_cylinder_is_drawn_whole_seen_along_its_axis_too(direction):
    """The area of its faces, seen along the axis, is that of its circle."""
    path = np.array([[0.0, 0, 0.5], [1, 0.2, 0.5]])
    post = column(point=(0.5, 0.1, 0.4), direction=direction, radius=0.05)
    (drawn,) = faces_near(constraints(post=post), path, recorded([0.0, 1.0]))
    onto = np.linalg.svd(np.array([direction], dtype=float))[2][1:]
    areas = []
    for face in drawn.faces:
        x, y = (face @ onto.T).T
        areas.append(0.5 * abs(x @ np.roll(y, 1) - y @ np.roll(x, 1)))
    assert max(areas) == pytest.approx(np.pi * 0.05**2, rel=0.02)


@pytest.mark.parametrize("x", [0.5, 1.3], ids=["inside", "half outside"])
def test_a_short_cylinder_is_drawn_to_its_own_ends_and_no_farther_than_the_picture(x):
    path = np.array([[0.0, 0, 0.5], [1, 0.2, 0.5]])
    can = dqc.world.Body(cylinder=(0.05, 0.2), position=(x, 0.1, 0.5), rpy=(0, np.pi / 2, 0))
    things = dqc.constraints.Constraints(world=dqc.World(bodies={"can": can}), clear_of="all")
    (drawn,) = faces_near(things, path, recorded([0.0, 1.0]))
    corners = corners_of([drawn])[:, 0]
    assert [corners.min(), corners.max()] == pytest.approx([x - 0.1, min(x + 0.1, 1.25)])

"""Meshes of rods, balls and boxes against trimesh's."""

import numpy as np
import pytest

from dqcontrol.figures.robot_bodies import Surface, ball, box, rod

trimesh = pytest.importorskip("trimesh")
TURN = trimesh.transformations.random_rotation_matrix(np.array([0.1, 0.7, 0.4]))[:3, :3]


@pytest.mark.parametrize(
    ("solid", "volume", "low", "high"),
    [
        (rod([0, 0, 0], [0, 0, 1], 0.2), np.pi * 0.04, [-0.2, -0.2, 0], [0.2, 0.2, 1]),
        (rod([1, 0, 0], [1, 2, 0], 0.2), 2 * np.pi * 0.04, [0.8, 0, -0.2], [1.2, 2, 0.2]),
        (
            rod([0, 0, 0], [0, 0, 1], 0.2, round_ends=True),
            np.pi * 0.04 * (1 + 4 / 3 * 0.2),
            [-0.2, -0.2, -0.2],
            [0.2, 0.2, 1.2],
        ),
        (ball([1, 2, 3], 0.5), np.pi / 6, [0.5, 1.5, 2.5], [1.5, 2.5, 3.5]),
        (box([1, 2, 3], [0, 0, 1]), 6.0, [-0.5, -1, -0.5], [0.5, 1, 2.5]),
        (box([1, 2, 3], [0, 0, 1], TURN), 6.0, None, None),
    ],
)
def test_volumes_and_extents_are_those_of_the_shapes(solid, volume, low, high):
    mesh = trimesh.Trimesh(solid.vertices, solid.faces)  # which joins vertices at edges
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(volume, rel=0.02)  # positive: faces look out
    if low is None:
        corners = trimesh.creation.box([1, 2, 3]).vertices @ TURN.T + [0, 0, 1]
        np.testing.assert_allclose(
            np.unique(mesh.vertices.round(9), axis=0), np.unique(corners.round(9), axis=0)
        )
    else:
        np.testing.assert_allclose(mesh.bounds, [low, high], atol=0.005)


def test_curves_are_smooth_and_edges_are_not():
    """A vertex belongs to faces that meet at less than 40° alone, so that light goes over no edge."""
    joined = Surface.joined([rod([0, 0, 0], [0, 0.3, 0], 0.1), box([1, 1, 1]), ball([0, 0, 0], 1.0)])
    a, b, c = (joined.vertices[joined.faces[:, i]] for i in range(3))
    normals = np.cross(b - a, c - a)
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    for vertex in range(len(joined.vertices)):
        own = normals[(joined.faces == vertex).any(axis=1)]
        if len(own):
            assert (own @ own.T).min() > np.cos(np.radians(40)), vertex

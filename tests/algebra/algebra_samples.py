"""Poses, twists and angles for the tests of the algebra, drawn where formulas break first."""

import hypothesis.extra.numpy as hnp
import numpy as np
from hypothesis import given, settings, strategies as st

SHAPES = st.sampled_from([(), (1,), (3,), (2, 2), (0,)])
SPECIAL_ANGLES = [
    0.0,
    1e-300,
    1e-15,
    1e-9,
    1e-7,
    1e-4,
    0.3,
    np.pi / 2,
    np.pi - 1e-9,
    np.pi,
    np.pi + 1e-9,
    2 * np.pi - 1e-3,
]


def cases(*strategies, **named):
    """Run a test on the same 60 drawn cases each time."""
    return lambda test: settings(max_examples=60, deadline=None, derandomize=True)(
        given(*strategies, **named)(test)
    )


def rotation_about(axis, angle):
    """Return (cos θ/2, n sin θ/2) from the definition."""
    axis, angle = np.asarray(axis, dtype=float), np.asarray(angle, dtype=float)[..., None]
    n = axis / np.linalg.norm(axis, axis=-1, keepdims=True)
    return np.concatenate(
        [np.broadcast_to(np.cos(angle / 2), (*n.shape[:-1], 1)), n * np.sin(angle / 2)], axis=-1
    )


def quaternion_product(a, b):
    """Return the product from the definition (scalar and vector part)."""
    w = a[..., :1] * b[..., :1] - np.sum(a[..., 1:] * b[..., 1:], axis=-1, keepdims=True)
    return np.concatenate(
        [w, a[..., :1] * b[..., 1:] + b[..., :1] * a[..., 1:] + np.cross(a[..., 1:], b[..., 1:])], axis=-1
    )


def pose_at(r, p):
    """Return r + ε½pr from the definition."""
    p = np.concatenate([np.zeros((*p.shape[:-1], 1)), p], axis=-1)
    return np.concatenate([r, 0.5 * quaternion_product(p, r)], axis=-1)


def arrays(shape, tail, bound):
    return hnp.arrays(np.float64, (*shape, *tail), elements=st.floats(-bound, bound, allow_subnormal=False))


@st.composite
def poses(draw, shape=None, largest_angle=2 * np.pi - 1e-3):
    """Draw a batch of poses with angles up to 2π − 1e-3, near 0 and π among them, positions within 3 m."""
    shape = draw(SHAPES) if shape is None else shape
    axis = draw(arrays(shape, (3,), 1.0))
    axis = np.where(np.linalg.norm(axis, axis=-1, keepdims=True) < 1e-3, [0.0, 0.6, 0.8], axis)
    specials = [angle for angle in SPECIAL_ANGLES if angle <= largest_angle]
    angle = draw(
        hnp.arrays(np.float64, shape, elements=st.sampled_from(specials) | st.floats(0, largest_angle))
    )
    return pose_at(rotation_about(axis, angle), draw(arrays(shape, (3,), 3.0)))


@st.composite
def dual_quaternions(draw, shape=None):
    """Draw a batch of any dual quaternions."""
    return draw(arrays(draw(SHAPES) if shape is None else shape, (8,), 5.0))


def random_poses(rng, *shape):
    """Return poses with evenly spread rotations and normal positions."""
    r = rng.normal(size=(*shape, 4))
    return pose_at(r / np.linalg.norm(r, axis=-1, keepdims=True), rng.normal(size=(*shape, 3)))


def error(a, b):
    """Return the largest difference; 0 for empty batches."""
    assert np.shape(a) == np.shape(b)
    return np.abs(np.asarray(a) - np.asarray(b)).max(initial=0.0)

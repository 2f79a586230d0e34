"""Shapes in space: their signed distances, with points, normals and Jacobians; and capsules around points."""

from dqcontrol.geometry.signed_distance import Distance, distance, distance_jacobian, distance_rate
from dqcontrol.geometry.shapes import (
    Box,
    Capsule,
    Cylinder,
    HalfSpace,
    Line,
    Plane,
    Point,
    Shape,
    Sphere,
)

__all__ = [
    "Box",
    "Capsule",
    "Cylinder",
    "Distance",
    "HalfSpace",
    "Line",
    "Plane",
    "Point",
    "Shape",
    "Sphere",
    "distance",
    "distance_jacobian",
    "distance_rate",
]

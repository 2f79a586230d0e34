"""Shapes in space: their signed distances, with points, normals and Jacobians; and capsules around points."""

from dqcontrol.geometry.bounding_capsule import bounding_capsule
from dqcontrol.geometry.floor_map import FloorMap, load_map
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
from dqcontrol.geometry.signed_distance import Distance, distance, distance_jacobian, distance_rate

__all__ = [
    "Box",
    "Capsule",
    "Cylinder",
    "Distance",
    "FloorMap",
    "HalfSpace",
    "Line",
    "Plane",
    "Point",
    "Shape",
    "Sphere",
    "bounding_capsule",
    "distance",
    "distance_jacobian",
    "distance_rate",
    "load_map",
]

from .bounding_capsule import bounding_capsule as bounding_capsule
from .floor_map import (
    FloorMap as FloorMap,
    load_map as load_map,
    save_map as save_map,
)
from .shapes import (
    Box as Box,
    Capsule as Capsule,
    Cylinder as Cylinder,
    Distance as Distance,
    HalfSpace as HalfSpace,
    Hull as Hull,
    InfiniteCylinder as InfiniteCylinder,
    Line as Line,
    Plane as Plane,
    Point as Point,
    Shape as Shape,
    Sphere as Sphere,
    distance as distance,
    distance_jacobian as distance_jacobian,
    distance_rate as distance_rate,
)

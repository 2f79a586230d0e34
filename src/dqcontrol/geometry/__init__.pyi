from .bounding_capsule import bounding_capsule as bounding_capsule
from .floor_map import (
    FloorMap as FloorMap,
)
from .floor_map import (
    load_map as load_map,
)
from .shapes import (
    Box as Box,
)
from .shapes import (
    Capsule as Capsule,
)
from .shapes import (
    Cylinder as Cylinder,
)
from .shapes import (
    HalfSpace as HalfSpace,
)
from .shapes import (
    Line as Line,
)
from .shapes import (
    Plane as Plane,
)
from .shapes import (
    Point as Point,
)
from .shapes import (
    Shape as Shape,
)
from .shapes import (
    Sphere as Sphere,
)
from .signed_distance import (
    Distance as Distance,
)
from .signed_distance import (
    distance as distance,
)
from .signed_distance import (
    distance_jacobian as distance_jacobian,
)
from .signed_distance import (
    distance_rate as distance_rate,
)

from .body import (
    Body as Body,
    Held as Held,
    Hinge as Hinge,
    Motion as Motion,
    SetDown as SetDown,
    Slide as Slide,
    Solid as Solid,
    Watch as Watch,
)
from .footprint import (
    Footprint as Footprint,
    floor_around as floor_around,
    footprint as footprint,
    stands as stands,
)
from .world import World as World

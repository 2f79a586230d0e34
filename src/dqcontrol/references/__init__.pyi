from .curve import Curve as Curve
from .drawing import (
    Drawing as Drawing,
    DrawingFile as DrawingFile,
    load_drawing as load_drawing,
    parse_drawing as parse_drawing,
)
from .drive_through import DriveThrough as DriveThrough
from .drive_to import DriveTo as DriveTo
from .jerk_limited import JerkLimited as JerkLimited
from .modifiers import (
    CornerStops as CornerStops,
    Follow as Follow,
    StartRamp as StartRamp,
    Transformed as Transformed,
)
from .planar import (
    Circle as Circle,
    Search as Search,
    Spiral as Spiral,
    Square as Square,
)
from .points import (
    Points as Points,
    ViaPoints as ViaPoints,
    load_points as load_points,
    position_path as position_path,
)
from .previewed import Previewed as Previewed
from .random_goals import random_goals as random_goals
from .reference import Reference as Reference
from .sample import (
    POSE as POSE,
    TIME as TIME,
    TWIST as TWIST,
    Sample as Sample,
    motion_samples as motion_samples,
)
from .sequence import (
    Guarded as Guarded,
    OnTouchedPlane as OnTouchedPlane,
    Repeat as Repeat,
    Sequence as Sequence,
)
from .set_points import Grip as Grip, Release as Release, SetPoint as SetPoint
from .straight import Straight as Straight
from .strokes import (
    Arc as Arc,
    Rest as Rest,
    StraightStroke as StraightStroke,
)

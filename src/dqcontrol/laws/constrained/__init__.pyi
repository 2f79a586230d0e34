from .constraints import (
    Angle as Angle,
)
from .constraints import (
    BoxObstacle as BoxObstacle,
)
from .constraints import (
    BoxZone as BoxZone,
)
from .constraints import (
    CapsuleObstacle as CapsuleObstacle,
)
from .constraints import (
    Constraints as Constraints,
)
from .constraints import (
    CylinderObstacle as CylinderObstacle,
)
from .constraints import (
    CylinderZone as CylinderZone,
)
from .constraints import (
    LineOfSight as LineOfSight,
)
from .constraints import (
    MapObstacle as MapObstacle,
)
from .constraints import (
    PlaneObstacle as PlaneObstacle,
)
from .constraints import (
    PlaneZone as PlaneZone,
)
from .constraints import (
    SphereObstacle as SphereObstacle,
)
from .constraints import (
    SphereZone as SphereZone,
)
from .programs import (
    LevelSolution as LevelSolution,
)
from .programs import (
    ProgramSolution as ProgramSolution,
)
from .programs import (
    lexicographic_program as lexicographic_program,
)
from .programs import (
    quadratic_program as quadratic_program,
)

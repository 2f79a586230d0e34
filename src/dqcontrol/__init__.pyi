from . import (
    algebra as algebra,
)
from . import (
    browser as browser,
)
from . import (
    errors as errors,
)
from . import (
    experiments as experiments,
)
from . import (
    export as export,
)
from . import (
    figures as figures,
)
from . import (
    films as films,
)
from . import (
    geometry as geometry,
)
from . import (
    laws as laws,
)
from . import (
    limits as limits,
)
from . import (
    logs as logs,
)
from . import (
    loop as loop,
)
from . import (
    measures as measures,
)
from . import (
    plants as plants,
)
from . import (
    recording as recording,
)
from . import (
    references as references,
)
from . import (
    reports as reports,
)
from . import (
    reproductions as reproductions,
)
from . import (
    robots as robots,
)
from . import (
    tuning as tuning,
)
from .algebra import DualQuaternion as DualQuaternion
from .errors import Error as Error
from .experiments import (
    Run as Run,
)
from .experiments import (
    Study as Study,
)
from .experiments import (
    run_study as run_study,
)
from .experiments.run import run as run
from .logs import calibrate as calibrate
from .logs import excite as excite
from .logs import identify as identify
from .loop import Record as Record
from .loop import simulate as simulate
from .references import Sample as Sample
from .robots import (
    CarLikeBase as CarLikeBase,
)
from .robots import (
    Chassis as Chassis,
)
from .robots import (
    DifferentialDrive as DifferentialDrive,
)
from .robots import (
    HolonomicBase as HolonomicBase,
)
from .robots import (
    Inertia as Inertia,
)
from .robots import (
    Kinematics as Kinematics,
)
from .robots import (
    Limits as Limits,
)
from .robots import (
    MecanumBase as MecanumBase,
)
from .robots import (
    OmniBase as OmniBase,
)
from .robots import (
    Robot as Robot,
)
from .robots import (
    SerialArm as SerialArm,
)
from .robots import (
    Solution as Solution,
)
from .robots import (
    SteeredTricycle as SteeredTricycle,
)
from .robots import (
    TreeRobot as TreeRobot,
)
from .robots import (
    TwoArms as TwoArms,
)
from .robots import (
    WholeBody as WholeBody,
)
from .robots import (
    load_mobile as load_mobile,
)
from .robots import (
    load_robot as load_robot,
)
from .robots import (
    load_tree as load_tree,
)
from .robots import (
    robot_names as robot_names,
)
from .tuning import (
    Learning as Learning,
)
from .tuning import (
    Tuning as Tuning,
)
from .tuning import (
    learn as learn,
)
from .tuning import (
    tune as tune,
)

__version__: str
__all__: list[str]

from . import (
    algebra as algebra,
    browser as browser,
    compiled as compiled,
    constraints as constraints,
    contact as contact,
    controller as controller,
    devices as devices,
    errors as errors,
    experiments as experiments,
    export as export,
    figures as figures,
    films as films,
    geometry as geometry,
    laws as laws,
    limits as limits,
    logs as logs,
    loop as loop,
    measures as measures,
    planning as planning,
    plants as plants,
    recording as recording,
    references as references,
    reports as reports,
    robots as robots,
    supervisor as supervisor,
    tables as tables,
    tuning as tuning,
    world as world,
)
from .algebra import DualQuaternion as DualQuaternion
from .browser.play.play_page import play as play
from .errors import Error as Error
from .experiments import (
    Run as Run,
    Study as Study,
    load_world as load_world,
    run_study as run_study,
)
from .experiments.run import run as run
from .logs import calibrate as calibrate, excite as excite, identify as identify
from .loop import Record as Record, simulate as simulate
from .references import Sample as Sample
from .robots import (
    CarLikeBase as CarLikeBase,
    Chassis as Chassis,
    DifferentialDrive as DifferentialDrive,
    HolonomicBase as HolonomicBase,
    Inertia as Inertia,
    Kinematics as Kinematics,
    Limits as Limits,
    MecanumBase as MecanumBase,
    OmniBase as OmniBase,
    Robot as Robot,
    SerialArm as SerialArm,
    Solution as Solution,
    SteeredTricycle as SteeredTricycle,
    TreeRobot as TreeRobot,
    TwoArms as TwoArms,
    WholeBody as WholeBody,
    load_robot as load_robot,
    robot_names as robot_names,
)
from .tuning import (
    Learning as Learning,
    Tuning as Tuning,
    learn as learn,
    tune as tune,
)
from .world import World as World

__version__: str
__all__: list[str]

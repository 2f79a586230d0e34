from .cascade import (
    Cascade as Cascade,
)
from .cascade import (
    ClassicCascade as ClassicCascade,
)
from .classic import (
    ClassicProportional as ClassicProportional,
)
from .classic import (
    OpenLoop as OpenLoop,
)
from .classic_whole_body import ClassicWholeBody as ClassicWholeBody
from .constrained import (
    Angle as Angle,
)
from .constrained import (
    BoxObstacle as BoxObstacle,
)
from .constrained import (
    BoxZone as BoxZone,
)
from .constrained import (
    CapsuleObstacle as CapsuleObstacle,
)
from .constrained import (
    Constraints as Constraints,
)
from .constrained import (
    CylinderObstacle as CylinderObstacle,
)
from .constrained import (
    CylinderZone as CylinderZone,
)
from .constrained import (
    LevelSolution as LevelSolution,
)
from .constrained import (
    LineOfSight as LineOfSight,
)
from .constrained import (
    MapObstacle as MapObstacle,
)
from .constrained import (
    PlaneObstacle as PlaneObstacle,
)
from .constrained import (
    PlaneZone as PlaneZone,
)
from .constrained import (
    ProgramSolution as ProgramSolution,
)
from .constrained import (
    SphereObstacle as SphereObstacle,
)
from .constrained import (
    SphereZone as SphereZone,
)
from .constrained import (
    lexicographic_program as lexicographic_program,
)
from .constrained import (
    quadratic_program as quadratic_program,
)
from .decoupled import (
    DecoupledProportional as DecoupledProportional,
)
from .decoupled import (
    PartialProportional as PartialProportional,
)
from .feedback_linearization import FeedbackLinearization as FeedbackLinearization
from .feedforward import ProportionalFeedforward as ProportionalFeedforward
from .gains import Schedule as Schedule
from .h_infinity import (
    HInfinity as HInfinity,
)
from .h_infinity import (
    HInfinityTracking as HInfinityTracking,
)
from .inverses import (
    DampedInverse as DampedInverse,
)
from .inverses import (
    FilteredInverse as FilteredInverse,
)
from .inverses import (
    ManipulabilityInverse as ManipulabilityInverse,
)
from .joint_motion import JointMotion as JointMotion
from .law import (
    Law as Law,
)
from .law import (
    PreparedLaw as PreparedLaw,
)
from .linear_quadratic import (
    LinearQuadraticDQ as LinearQuadraticDQ,
)
from .linear_quadratic import (
    LinearQuadraticR8 as LinearQuadraticR8,
)
from .null_space import (
    BestHeading as BestHeading,
)
from .null_space import (
    JointCentring as JointCentring,
)
from .null_space import (
    LimitAvoidance as LimitAvoidance,
)
from .null_space import (
    ManipulabilityAscent as ManipulabilityAscent,
)
from .null_space import (
    Posture as Posture,
)
from .own_law import OwnLaw as OwnLaw
from .plan_following import GuidedProportional as GuidedProportional
from .proportional import Proportional as Proportional
from .reduced_gradient import ReducedGradient as ReducedGradient
from .riccati import Steps as Steps
from .task_levels import (
    FurtherTask as FurtherTask,
)
from .task_levels import (
    PreparedTasks as PreparedTasks,
)

"""Control laws: frozen parameters, each with one compiled function."""

from dqcontrol.laws.cascade import Cascade, ClassicCascade
from dqcontrol.laws.classic import ClassicProportional, OpenLoop
from dqcontrol.laws.classic_whole_body import ClassicWholeBody
from dqcontrol.laws.constrained import (
    Angle,
    BoxObstacle,
    BoxZone,
    CapsuleObstacle,
    Constraints,
    CylinderObstacle,
    CylinderZone,
    LevelSolution,
    LineOfSight,
    PlaneObstacle,
    PlaneZone,
    ProgramSolution,
    SphereObstacle,
    SphereZone,
    lexicographic_program,
    quadratic_program,
)
from dqcontrol.laws.decoupled import DecoupledProportional, PartialProportional
from dqcontrol.laws.feedback_linearization import FeedbackLinearization
from dqcontrol.laws.feedforward import ProportionalFeedforward
from dqcontrol.laws.gains import Schedule
from dqcontrol.laws.h_infinity import HInfinity, HInfinityTracking
from dqcontrol.laws.inverses import DampedInverse, FilteredInverse, ManipulabilityInverse
from dqcontrol.laws.joint_motion import JointMotion
from dqcontrol.laws.law import Law, PreparedLaw
from dqcontrol.laws.linear_quadratic import LinearQuadraticDQ, LinearQuadraticR8
from dqcontrol.laws.null_space import (
    BestHeading,
    JointCentring,
    LimitAvoidance,
    ManipulabilityAscent,
    Posture,
)
from dqcontrol.laws.own_law import OwnLaw
from dqcontrol.laws.plan_following import GuidedProportional
from dqcontrol.laws.proportional import Proportional
from dqcontrol.laws.reduced_gradient import ReducedGradient
from dqcontrol.laws.riccati import Steps
from dqcontrol.laws.task_levels import FurtherTask, PreparedTasks

__all__ = [
    "Angle",
    "BestHeading",
    "BoxObstacle",
    "BoxZone",
    "CapsuleObstacle",
    "Cascade",
    "ClassicCascade",
    "ClassicProportional",
    "ClassicWholeBody",
    "Constraints",
    "CylinderObstacle",
    "CylinderZone",
    "DampedInverse",
    "DecoupledProportional",
    "FeedbackLinearization",
    "FilteredInverse",
    "FurtherTask",
    "GuidedProportional",
    "HInfinity",
    "HInfinityTracking",
    "JointCentring",
    "JointMotion",
    "Law",
    "LevelSolution",
    "LimitAvoidance",
    "LineOfSight",
    "LinearQuadraticDQ",
    "LinearQuadraticR8",
    "ManipulabilityAscent",
    "ManipulabilityInverse",
    "OpenLoop",
    "OwnLaw",
    "PartialProportional",
    "PlaneObstacle",
    "PlaneZone",
    "Posture",
    "PreparedLaw",
    "PreparedTasks",
    "ProgramSolution",
    "Proportional",
    "ProportionalFeedforward",
    "ReducedGradient",
    "Schedule",
    "SphereObstacle",
    "SphereZone",
    "Steps",
    "lexicographic_program",
    "quadratic_program",
]

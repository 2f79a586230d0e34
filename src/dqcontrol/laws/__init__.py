"""Control laws: frozen parameters, each with one compiled function."""

from dqcontrol.laws.cascade import Cascade
from dqcontrol.laws.classic import ClassicProportional, OpenLoop
from dqcontrol.laws.classic_whole_body import ClassicWholeBody
from dqcontrol.laws.constrained import (
    LevelSolution,
    ProgramSolution,
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
from dqcontrol.laws.riccati import Steps

__all__ = [
    "BestHeading",
    "Cascade",
    "ClassicProportional",
    "ClassicWholeBody",
    "DampedInverse",
    "DecoupledProportional",
    "FeedbackLinearization",
    "FilteredInverse",
    "GuidedProportional",
    "HInfinity",
    "HInfinityTracking",
    "JointCentring",
    "JointMotion",
    "Law",
    "LevelSolution",
    "LimitAvoidance",
    "LinearQuadraticDQ",
    "LinearQuadraticR8",
    "ManipulabilityAscent",
    "ManipulabilityInverse",
    "OpenLoop",
    "OwnLaw",
    "PartialProportional",
    "Posture",
    "PreparedLaw",
    "ProgramSolution",
    "Proportional",
    "ProportionalFeedforward",
    "Schedule",
    "Steps",
    "lexicographic_program",
    "quadratic_program",
]

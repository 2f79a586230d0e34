from . import parts as parts
from .decoupled import (
    DecoupledProportional as DecoupledProportional,
    PartialProportional as PartialProportional,
)
from .feedback_linearization import FeedbackLinearization as FeedbackLinearization
from .feedforward import ProportionalFeedforward as ProportionalFeedforward
from .h_infinity import (
    HInfinity as HInfinity,
    HInfinityTracking as HInfinityTracking,
)
from .integral import IntegralPoseLaw as IntegralPoseLaw
from .inverses import (
    DampedInverse as DampedInverse,
    FilteredInverse as FilteredInverse,
    Inverse as Inverse,
    ManipulabilityInverse as ManipulabilityInverse,
)
from .joint_motion import JointMotion as JointMotion
from .law import Law as Law, LoopRates as LoopRates
from .linear_quadratic import (
    LinearQuadraticDQ as LinearQuadraticDQ,
    LinearQuadraticR8 as LinearQuadraticR8,
)
from .null_space import (
    AnyNullSpace as AnyNullSpace,
    BestHeading as BestHeading,
    JointCentring as JointCentring,
    LimitAvoidance as LimitAvoidance,
    ManipulabilityAscent as ManipulabilityAscent,
    Posture as Posture,
)
from .open_loop import OpenLoop as OpenLoop
from .own_law import OwnLaw as OwnLaw
from .plan_following import GuidedProportional as GuidedProportional
from .pose_inverse import DampedPoseInverse as DampedPoseInverse
from .pose_law import PoseLaw as PoseLaw, Schedule as Schedule
from .proportional import Proportional as Proportional
from .riccati import Steps as Steps

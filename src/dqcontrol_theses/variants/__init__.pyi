from .cascade import (
    Cascade as Cascade,
    ClassicCascade as ClassicCascade,
)
from .classic_proportional import ClassicProportional as ClassicProportional
from .classic_whole_body import ClassicWholeBody as ClassicWholeBody
from .euler_riccati import EulerLinearQuadraticR8 as EulerLinearQuadraticR8
from .original_clamping import OriginalClamping as OriginalClamping
from .published_linearization import PublishedLinearization as PublishedLinearization
from .reduced_gradient import ReducedGradient as ReducedGradient
from .tiring_motors import TiringMotors as TiringMotors

from .clamping import ModifiedClamping as ModifiedClamping
from .command_limits import CommandLimits as CommandLimits
from .compensation import Compensation as Compensation
from .position_limit import (
    POSITION_LIMIT as POSITION_LIMIT,
    PositionLimit as PositionLimit,
    input_ranges as input_ranges,
    position_limits as position_limits,
)
from .weighted_least_norm import WeightedLeastNorm as WeightedLeastNorm

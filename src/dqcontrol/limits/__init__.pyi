from .command_limits import CommandLimits as CommandLimits
from .compensation import Compensation as Compensation
from .position_limit import (
    POSITION_LIMIT as POSITION_LIMIT,
    ModifiedClamping as ModifiedClamping,
    PositionLimit as PositionLimit,
    WeightedLeastNorm as WeightedLeastNorm,
    input_ranges as input_ranges,
    position_limits as position_limits,
)

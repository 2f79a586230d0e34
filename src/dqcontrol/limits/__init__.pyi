from .clamping import ModifiedClamping as ModifiedClamping
from .command_limits import CommandLimits as CommandLimits
from .compensation import Compensation as Compensation
from .position_limit import (
    POSITION_LIMIT as POSITION_LIMIT,
    PositionLimit as PositionLimit,
    input_ranges as input_ranges,
    position_limits as position_limits,
)
from .supervisor import (
    DeclaredPayload as DeclaredPayload,
    KeepOutZones as KeepOutZones,
    LinkPoint as LinkPoint,
    Supervisor as Supervisor,
    WorkspaceBox as WorkspaceBox,
)
from .supervisor.interventions import (
    Intervention as Intervention,
    describe_stop as describe_stop,
    list_interventions as list_interventions,
    stop_category as stop_category,
)
from .supervisor.prepared_supervisor import PreparedSupervisor as PreparedSupervisor
from .weighted_least_norm import WeightedLeastNorm as WeightedLeastNorm

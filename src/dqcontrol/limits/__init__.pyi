from .clamping import (
    ModifiedClamping as ModifiedClamping,
)
from .clamping import (
    OriginalClamping as OriginalClamping,
)
from .command_limits import CommandLimits as CommandLimits
from .compensation import Compensation as Compensation
from .supervisor import (
    CircularZone as CircularZone,
)
from .supervisor import (
    DeclaredPayload as DeclaredPayload,
)
from .supervisor import (
    KeepOutZones as KeepOutZones,
)
from .supervisor import (
    LinkPoint as LinkPoint,
)
from .supervisor import (
    MapZone as MapZone,
)
from .supervisor import (
    PolygonalZone as PolygonalZone,
)
from .supervisor import (
    Supervisor as Supervisor,
)
from .supervisor import (
    WorkspaceBox as WorkspaceBox,
)
from .supervisor.interventions import (
    Intervention as Intervention,
)
from .supervisor.interventions import (
    describe_stop as describe_stop,
)
from .supervisor.interventions import (
    list_interventions as list_interventions,
)
from .supervisor.interventions import (
    stop_category as stop_category,
)
from .supervisor.prepared_supervisor import PreparedSupervisor as PreparedSupervisor
from .weighted_least_norm import WeightedLeastNorm as WeightedLeastNorm

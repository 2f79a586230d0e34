from .interventions import (
    Intervention as Intervention,
    describe_stop as describe_stop,
    list_interventions as list_interventions,
    stop_category as stop_category,
)
from .prepared_supervisor import PreparedSupervisor as PreparedSupervisor
from .supervisor import (
    KeepOutZones as KeepOutZones,
    LinkPoint as LinkPoint,
    Supervisor as Supervisor,
    WorkspaceBox as WorkspaceBox,
)

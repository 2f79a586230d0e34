from .interventions import (
    Intervention as Intervention,
)
from .interventions import (
    describe_stop as describe_stop,
)
from .interventions import (
    list_interventions as list_interventions,
)
from .interventions import (
    stop_category as stop_category,
)
from .keep_out_zones import (
    CircularZone as CircularZone,
)
from .keep_out_zones import (
    KeepOutZones as KeepOutZones,
)
from .keep_out_zones import (
    MapZone as MapZone,
)
from .keep_out_zones import (
    PolygonalZone as PolygonalZone,
)
from .prepared_supervisor import PreparedSupervisor as PreparedSupervisor
from .supervisor import (
    DeclaredPayload as DeclaredPayload,
)
from .supervisor import (
    LinkPoint as LinkPoint,
)
from .supervisor import (
    Supervisor as Supervisor,
)
from .supervisor import (
    WorkspaceBox as WorkspaceBox,
)

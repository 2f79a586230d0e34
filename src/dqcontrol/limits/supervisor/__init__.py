"""The supervisor, which all commands to a robot go through."""

from dqcontrol.limits.supervisor.interventions import (
    Intervention,
    describe_stop,
    list_interventions,
    stop_category,
)
from dqcontrol.limits.supervisor.keep_out_zones import CircularZone, KeepOutZones, MapZone, PolygonalZone
from dqcontrol.limits.supervisor.prepared_supervisor import PreparedSupervisor
from dqcontrol.limits.supervisor.supervisor import (
    DeclaredPayload,
    LinkPoint,
    Supervisor,
    WorkspaceBox,
)

__all__ = [
    "CircularZone",
    "DeclaredPayload",
    "Intervention",
    "KeepOutZones",
    "LinkPoint",
    "MapZone",
    "PolygonalZone",
    "PreparedSupervisor",
    "Supervisor",
    "WorkspaceBox",
    "describe_stop",
    "list_interventions",
    "stop_category",
]

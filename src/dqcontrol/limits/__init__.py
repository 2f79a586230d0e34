"""Limits: what is done to a command before it leaves."""

from dqcontrol.limits.clamping import ModifiedClamping, OriginalClamping
from dqcontrol.limits.command_limits import CommandLimits
from dqcontrol.limits.compensation import Compensation
from dqcontrol.limits.supervisor import (
    CircularZone,
    DeclaredPayload,
    KeepOutZones,
    LinkPoint,
    MapZone,
    PolygonalZone,
    Supervisor,
    WorkspaceBox,
)
from dqcontrol.limits.supervisor.interventions import (
    Intervention,
    describe_stop,
    list_interventions,
    stop_category,
)
from dqcontrol.limits.supervisor.prepared_supervisor import PreparedSupervisor
from dqcontrol.limits.weighted_least_norm import WeightedLeastNorm

__all__ = [
    "CircularZone",
    "CommandLimits",
    "Compensation",
    "DeclaredPayload",
    "Intervention",
    "KeepOutZones",
    "LinkPoint",
    "MapZone",
    "ModifiedClamping",
    "OriginalClamping",
    "PolygonalZone",
    "PreparedSupervisor",
    "Supervisor",
    "WeightedLeastNorm",
    "WorkspaceBox",
    "describe_stop",
    "list_interventions",
    "stop_category",
]

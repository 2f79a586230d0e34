"""The supervisor, which all commands to a robot go through."""

from dqcontrol.limits.supervisor.interventions import Intervention, list_interventions
from dqcontrol.limits.supervisor.prepared_supervisor import PreparedSupervisor
from dqcontrol.limits.supervisor.supervisor import Supervisor, WorkspaceBox

__all__ = [
    "Intervention",
    "PreparedSupervisor",
    "Supervisor",
    "WorkspaceBox",
    "list_interventions",
]

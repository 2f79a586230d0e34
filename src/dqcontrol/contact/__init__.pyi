from .admittance import (
    Admittance as Admittance,
    Compliance as Compliance,
    DeflectionLimits as DeflectionLimits,
    ForceReference as ForceReference,
    ForceSensor as ForceSensor,
    LostContact as LostContact,
    SilentSensor as SilentSensor,
    Tool as Tool,
    WantedWrench as WantedWrench,
)
from .admittance_stage import AdmittanceStage as AdmittanceStage
from .limits import (
    ContactLimits as ContactLimits,
    LoosePart as LoosePart,
    contact_limits as contact_limits,
)
from .tool_identification import (
    IdentifiedTool as IdentifiedTool,
    identify_tool as identify_tool,
    tool_orientations as tool_orientations,
)

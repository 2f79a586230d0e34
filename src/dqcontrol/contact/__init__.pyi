from .admittance import (
    Admittance as Admittance,
    AdmittanceStage as AdmittanceStage,
    Compliance as Compliance,
    DeflectionLimits as DeflectionLimits,
    ForceReference as ForceReference,
    ForceSensor as ForceSensor,
    GoesOn as GoesOn,
    LostContact as LostContact,
    SilentSensor as SilentSensor,
    WantedWrench as WantedWrench,
)
from .impedance import Impedance as Impedance, PreparedImpedance as PreparedImpedance
from .limits import (
    ContactLimits as ContactLimits,
    LoosePart as LoosePart,
    bears as bears,
    contact_limits as contact_limits,
)
from .tool import (
    IdentifiedTool as IdentifiedTool,
    Tool as Tool,
    gravity_condition as gravity_condition,
    identify_tool as identify_tool,
    load_tool as load_tool,
    tare_tool as tare_tool,
    tool_orientations as tool_orientations,
)

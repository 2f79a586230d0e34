from .calibration import (
    Calibration as Calibration,
    calibrate as calibrate,
)
from .evaluation import evaluate_log as evaluate_log
from .joint_log import (
    JointLog as JointLog,
    read_joint_log as read_joint_log,
)
from .servos import (
    Excitation as Excitation,
    Identification as Identification,
    JointIdentification as JointIdentification,
    excite as excite,
    identify as identify,
)
from .tools import (
    ToolIdentification as ToolIdentification,
    ToolMotion as ToolMotion,
    tool_from_logs as tool_from_logs,
    tool_motion as tool_motion,
)

from .calibration import (
    Calibration as Calibration,
)
from .calibration import (
    calibrate as calibrate,
)
from .evaluation import evaluate_log as evaluate_log
from .joint_log import (
    JointLog as JointLog,
)
from .joint_log import (
    read_joint_log as read_joint_log,
)
from .servos import (
    Excitation as Excitation,
)
from .servos import (
    Identification as Identification,
)
from .servos import (
    JointIdentification as JointIdentification,
)
from .servos import (
    excite as excite,
)
from .servos import (
    identify as identify,
)

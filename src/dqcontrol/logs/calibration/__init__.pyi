from .kinematic_calibration import (
    Calibration as Calibration,
)
from .kinematic_calibration import (
    Correction as Correction,
)
from .kinematic_calibration import (
    HandErrors as HandErrors,
)
from .kinematic_calibration import (
    calibrate as calibrate,
)
from .measured_poses import (
    MeasuredPoses as MeasuredPoses,
)
from .measured_poses import (
    read_measured_poses as read_measured_poses,
)

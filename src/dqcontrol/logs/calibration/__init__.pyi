from .kinematic_calibration import (
    Calibration as Calibration,
    Correction as Correction,
    HandErrors as HandErrors,
    calibrate as calibrate,
)
from .measured_poses import (
    MeasuredPoses as MeasuredPoses,
    read_measured_poses as read_measured_poses,
)

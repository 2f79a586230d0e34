"""The geometry of an arm, found from measured poses of its hand."""

from dqcontrol.logs.calibration.kinematic_calibration import Calibration, Correction, HandErrors, calibrate
from dqcontrol.logs.calibration.measured_poses import MeasuredPoses, read_measured_poses

__all__ = [
    "Calibration",
    "Correction",
    "HandErrors",
    "MeasuredPoses",
    "calibrate",
    "read_measured_poses",
]

"""Users' own logs of joints: read, and measured against a reference."""

from dqcontrol.logs.calibration import Calibration, calibrate
from dqcontrol.logs.evaluation import evaluate_log
from dqcontrol.logs.joint_log import JointLog, read_joint_log
from dqcontrol.logs.servos import Excitation, Identification, JointIdentification, excite, identify

__all__ = [
    "Calibration",
    "Excitation",
    "Identification",
    "JointIdentification",
    "JointLog",
    "calibrate",
    "evaluate_log",
    "excite",
    "identify",
    "read_joint_log",
]

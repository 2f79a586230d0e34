"""Users' own logs of joints: read, and measured against a reference."""

from dqcontrol.logs.evaluation import evaluate_log
from dqcontrol.logs.joint_log import JointLog, read_joint_log

__all__ = [
    "JointLog",
    "evaluate_log",
    "read_joint_log",
]

"""What servos a robot has, found from logs of commands and measured positions."""

from dqcontrol.logs.servos.excitation import Excitation, excite
from dqcontrol.logs.servos.identification import Identification, identify
from dqcontrol.logs.servos.joint_gates import JointIdentification

__all__ = [
    "Excitation",
    "Identification",
    "JointIdentification",
    "excite",
    "identify",
]

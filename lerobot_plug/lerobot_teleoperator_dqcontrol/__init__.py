"""A leader arm that dqcontrol's laws drive, as a teleoperator of LeRobot: ``--teleop.type=dqcontrol``."""

from lerobot_teleoperator_dqcontrol.config_dqcontrol import DqcontrolTeleoperatorConfig
from lerobot_teleoperator_dqcontrol.dqcontrol_teleoperator import DqcontrolTeleoperator

__all__ = ["DqcontrolTeleoperator", "DqcontrolTeleoperatorConfig"]

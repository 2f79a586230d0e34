"""Arms of dqcontrol, simulated in physics, as a robot of LeRobot: ``--robot.type=dqcontrol``."""

from lerobot_teleoperator_dqcontrol import DqcontrolTeleoperator, DqcontrolTeleoperatorConfig

from lerobot_robot_dqcontrol.config_dqcontrol import DqcontrolRobotConfig
from lerobot_robot_dqcontrol.dqcontrol_robot import DqcontrolRobot

__all__ = ["DqcontrolRobot", "DqcontrolRobotConfig", "DqcontrolTeleoperator", "DqcontrolTeleoperatorConfig"]

from .driver import Driver as Driver
from .franka import FrankaArm as FrankaArm
from .lerobot import LeRobotArm as LeRobotArm
from .universal_robots import UniversalRobot as UniversalRobot
from .xarm import XArm as XArm

from .driver import Driver as Driver
from .franka import FrankaArm as FrankaArm
from .universal_robots import UniversalRobot as UniversalRobot

from .driver import Driver as Driver
from .universal_robots import UniversalRobot as UniversalRobot

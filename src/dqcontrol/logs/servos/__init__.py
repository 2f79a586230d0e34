"""What servos a robot has, found from logs of commands and measured positions."""

from dqcontrol.moved import offered

__getattr__, __dir__, __all__ = offered(__name__, __file__)

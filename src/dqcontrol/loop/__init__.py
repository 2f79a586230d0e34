"""The closed loop, compiled and interpreted, and what it saw."""

from dqcontrol.moved import offered

__getattr__, __dir__, __all__ = offered(__name__, __file__)

"""Desired motions: pose, twist and twist rate over time."""

from dqcontrol.moved import offered

__getattr__, __dir__, __all__ = offered(__name__, __file__)

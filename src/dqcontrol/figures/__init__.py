"""Figures of runs. matplotlib is imported when the first one is made."""

from dqcontrol.moved import offered

__getattr__, __dir__, __all__ = offered(__name__, __file__)

"""The geometry of an arm, found from measured poses of its hand."""

from dqcontrol.moved import offered

__getattr__, __dir__, __all__ = offered(__name__, __file__)

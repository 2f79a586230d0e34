"""Controllers as libraries in C: a prepared law, its supervisor and its reference for a robot's own computer."""

from dqcontrol.moved import offered

__getattr__, __dir__, __all__ = offered(__name__, __file__)

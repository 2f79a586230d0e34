"""Experiments of the source documents run again, and what these printed: their numbers and their claims."""

from dqcontrol.moved import offered

__getattr__, __dir__, __all__ = offered(__name__, __file__)

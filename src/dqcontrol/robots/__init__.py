"""Robots: chains, their Jacobians, and where they come from."""

from dqcontrol.moved import offered

__getattr__, __dir__, __all__ = offered(__name__, __file__)

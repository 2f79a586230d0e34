"""Runs as files: MCAP recordings, written whole or while the robot moves, and exports for other programs."""

from dqcontrol.moved import offered

__getattr__, __dir__, __all__ = offered(__name__, __file__)

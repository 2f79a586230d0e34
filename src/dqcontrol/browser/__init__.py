"""Runs in a browser: `Track` is what there is to see of one, `Page` shows them; `RobotPage` shows a robot alone."""

from dqcontrol.moved import offered

__getattr__, __dir__, __all__ = offered(__name__, __file__)

"""Numbers that judge runs, and the tables that show them."""

from dqcontrol.moved import offered

__getattr__, __dir__, __all__ = offered(__name__, __file__)

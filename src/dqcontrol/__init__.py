"""Dual quaternion control laws for arms: compiled simulation, physics, experiments."""

from dqcontrol.moved import offered, register

__version__ = "0.1.0"

# As in all rooms: what is offered stands in `__init__.pyi`, and is imported when it is first used.
__getattr__, __dir__, __all__ = offered(__name__, __file__)

register()

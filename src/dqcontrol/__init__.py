"""Dual quaternion control laws for arms: compiled simulation, physics, experiments."""

import lazy_loader

__version__ = "0.1.0"

# As in all rooms: what is offered stands in `__init__.pyi`, and is imported when it is first used.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

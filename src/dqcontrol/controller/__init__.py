"""The controller: a law prepared for one robot, with tasks, limits and constraints, as one compiled step."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

"""The geometry of an arm, found from measured poses of its end effector."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

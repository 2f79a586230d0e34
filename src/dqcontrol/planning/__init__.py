"""Ways around what stands in the way: proved edge by edge, planned, timed so that laws let them pass."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

"""The numbers: dual quaternions as arrays (…, 8) and as the class `DualQuaternion`."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

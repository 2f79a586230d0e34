"""The world around a robot: bodies with shapes and poses, masses, joints and stiffness, said once for everybody."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

"""Learning from repetition: the reference is shifted until the end effector goes where it should."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

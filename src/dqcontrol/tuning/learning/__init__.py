"""Learning from repetition: the reference is shifted from repeat to repeat until the hand goes where it should."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

"""Identification of a robot's servos from logs of commands and measured positions."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

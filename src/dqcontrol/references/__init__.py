"""Desired motions: pose, twist and twist rate over time."""

import lazy_loader

from dqcontrol.moved import names_moved_from

_offered, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
__getattr__ = names_moved_from(__name__, _offered)

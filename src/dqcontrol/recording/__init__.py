"""Runs as files: MCAP recordings, written whole or while the robot moves, and exports for other programs."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

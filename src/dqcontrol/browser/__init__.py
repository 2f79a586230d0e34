"""Runs in a browser: `Track` is what there is to see of one, `Page` shows them; `RobotPage` shows a robot alone."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

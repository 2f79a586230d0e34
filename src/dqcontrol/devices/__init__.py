"""Devices in a person's hand that drive a robot: keys, gamepads, knobs, phones; all move a `dqcontrol.loop.Live`."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

"""What a person holds to drive a robot: keys, gamepads, knobs, phones; all of them move a `dqcontrol.loop.Live`."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

"""The numbers: dual quaternions as arrays (…, 8) and as the class `DualQuaternion`."""

from dqcontrol.moved import offered

__getattr__, __dir__, __all__ = offered(__name__, __file__)

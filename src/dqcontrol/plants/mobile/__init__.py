"""Mobile manipulators on wheels in MuJoCo."""

from dqcontrol.plants.mobile.mobile_plant import MobilePlant

__all__ = [
    "MobilePlant",
]

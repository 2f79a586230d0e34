"""Arms with elastic joints and joint controllers, in MuJoCo."""

from dqcontrol.plants.compliant.compliant_plant import CompliantPlant

__all__ = [
    "CompliantPlant",
]

"""Plants: what moves when a law commands it, and what disturbs it."""

from dqcontrol.plants.camera import Camera, FiducialLoss
from dqcontrol.plants.compliant import CompliantPlant
from dqcontrol.plants.disturbance import (
    BandLimitedTwist,
    ConstantTwist,
    Disturbance,
    SinusoidalTwist,
    WorstCase,
)
from dqcontrol.plants.integrator import Integrator
from dqcontrol.plants.loads import EncoderLoss, Payload, Push
from dqcontrol.plants.mujoco import MujocoPlant
from dqcontrol.plants.own import OwnPlant
from dqcontrol.plants.plant import CompiledPlant, LivePlant, Plant
from dqcontrol.plants.servo import Servo

__all__ = [
    "BandLimitedTwist",
    "Camera",
    "CompiledPlant",
    "CompliantPlant",
    "ConstantTwist",
    "Disturbance",
    "EncoderLoss",
    "FiducialLoss",
    "Integrator",
    "LivePlant",
    "MujocoPlant",
    "OwnPlant",
    "Payload",
    "Plant",
    "Push",
    "Servo",
    "SinusoidalTwist",
    "WorstCase",
]

"""Plants: what moves when a law commands it, and what disturbs it."""

from dqcontrol.plants.camera import Camera, FiducialLoss
from dqcontrol.plants.compliant import CompliantPlant
from dqcontrol.plants.coppeliasim import CoppeliaPlant
from dqcontrol.plants.disturbance import (
    BandLimitedTwist,
    ConstantTwist,
    Disturbance,
    SinusoidalTwist,
    WorstCase,
)
from dqcontrol.plants.gripper import Gripper, GripperEvent
from dqcontrol.plants.integrator import Integrator
from dqcontrol.plants.loads import EncoderLoss, Payload, Push, WristFault
from dqcontrol.plants.mobile import MobilePlant
from dqcontrol.plants.mujoco import MujocoPlant
from dqcontrol.plants.obstacle import Obstacle
from dqcontrol.plants.odometry import Odometry
from dqcontrol.plants.own import OwnPlant
from dqcontrol.plants.payload_compensation import PayloadCompensation
from dqcontrol.plants.plant import CompiledPlant, LivePlant, Plant, limits_before
from dqcontrol.plants.scene import Basket, Cube, Scene
from dqcontrol.plants.servo import Servo
from dqcontrol.plants.wheeled_base import WheeledBase

__all__ = [
    "BandLimitedTwist",
    "Basket",
    "Camera",
    "CompiledPlant",
    "CompliantPlant",
    "ConstantTwist",
    "CoppeliaPlant",
    "Cube",
    "Disturbance",
    "EncoderLoss",
    "FiducialLoss",
    "Gripper",
    "GripperEvent",
    "Integrator",
    "LivePlant",
    "MobilePlant",
    "MujocoPlant",
    "Obstacle",
    "Odometry",
    "OwnPlant",
    "Payload",
    "PayloadCompensation",
    "Plant",
    "Push",
    "Scene",
    "Servo",
    "SinusoidalTwist",
    "WheeledBase",
    "WorstCase",
    "WristFault",
    "limits_before",
]

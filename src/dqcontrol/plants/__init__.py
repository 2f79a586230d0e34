"""Plants: what moves when a law commands it, and what disturbs it."""

from dqcontrol.plants.camera import Camera, FiducialLoss
from dqcontrol.plants.compliant import CompliantPlant
from dqcontrol.plants.compliant.loads_and_faults import EncoderLoss, Payload, Push, WristFault
from dqcontrol.plants.compliant.obstacle import Obstacle
from dqcontrol.plants.compliant.payload_compensation import PayloadCompensation
from dqcontrol.plants.coppeliasim import CoppeliaPlant
from dqcontrol.plants.disturbance import (
    BandLimitedTwist,
    ConstantTwist,
    Disturbance,
    SinusoidalTwist,
    WorstCase,
)
from dqcontrol.plants.integrator import Integrator
from dqcontrol.plants.live_plant import LivePlant, MovedPlant
from dqcontrol.plants.mobile import MobilePlant
from dqcontrol.plants.mobile.gripper import Gripper, GripperEvent
from dqcontrol.plants.mobile.odometry import Odometry
from dqcontrol.plants.mobile.scene import Basket, Cube, Scene, TableBlock
from dqcontrol.plants.mobile.wheeled_base import WheeledBase
from dqcontrol.plants.mujoco import MujocoPlant
from dqcontrol.plants.own_plant import OwnPlant
from dqcontrol.plants.plant import CompiledPlant, Plant, limits_before
from dqcontrol.plants.servo import Servo, load_servo
from dqcontrol.plants.tiring_motors import TiringMotors

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
    "MovedPlant",
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
    "TableBlock",
    "TiringMotors",
    "WheeledBase",
    "WorstCase",
    "WristFault",
    "limits_before",
    "load_servo",
]

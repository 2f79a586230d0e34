"""Plants: what moves when a law commands it."""

from dqcontrol.plants.integrator import Integrator
from dqcontrol.plants.mujoco import MujocoPlant
from dqcontrol.plants.own import OwnPlant
from dqcontrol.plants.plant import CompiledPlant, LivePlant, Plant
from dqcontrol.plants.servo import Servo

__all__ = ["CompiledPlant", "Integrator", "LivePlant", "MujocoPlant", "OwnPlant", "Plant", "Servo"]

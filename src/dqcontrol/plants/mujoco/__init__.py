"""Rigid arms in MuJoCo."""

from dqcontrol.plants.mujoco.mujoco_plant import MujocoPlant

__all__ = [
    "MujocoPlant",
]

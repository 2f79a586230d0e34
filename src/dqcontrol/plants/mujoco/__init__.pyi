from .mujoco_plant import MujocoPlant as MujocoPlant

"""A wrist's force sensor and its tool in MuJoCo."""

from __future__ import annotations

from typing import Any

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.errors import ValueRangeError
from dqcontrol.plants.mujoco.gripper import BODIES
from dqcontrol.plants.mujoco.mujoco_model import add_geom, weigh
from dqcontrol.plants.plant import Channel
from dqcontrol.plants.sensors import CHANNELS, Wrist
from dqcontrol.robots.files.mjcf import import_mujoco
from dqcontrol.robots.robot import Robot

TOOL = "wrist tool"  # its geom; body, site and sensors are named alike
_FORCE, _TORQUE = f"{TOOL} force", f"{TOOL} torque"
_SIDES = 64  # of a rod that ends flat: its radius is right within 0.06 %
_STREAM = 6  # of the sensor's noise, beside that of the encoders


def add_wrist(spec: Any, wrist: Wrist, robot: Robot, timestep: float, compensated: float) -> None:
    """Add a tool, welded to the last link at the end effector, and sensors of what it exerts there.

    Parameters
    ----------
    spec, robot
        ``mjSpec`` and whose it is.
    wrist
        Sensor and tool.
    timestep
        s; contacts are as stiff as it allows.
    compensated
        Share of the tool's weight that the arm carries.

    Raises
    ------
    ValueRangeError
        If the robot has several end effectors.
    """
    if len(robot.ends) != 1:
        raise ValueRangeError(f"plant.wrist: is at one end effector, and {robot.name} has {len(robot.ends)}")
    end, link = robot.chain[robot.ends[0]], int(robot.parents[robot.ends[0]]) + 1
    body = spec.body(f"link_{link}").add_body(name=TOOL, pos=end[4:7], quat=end[:4])
    size = (wrist.length**2 + 3 * wrist.radius**2) / 12  # of a rod, m²
    weigh(body, wrist.mass, wrist.center, wrist.mass * np.array([size, size, 0.5 * wrist.radius**2]))
    body.gravcomp = compensated
    if wrist.length:
        long = max(wrist.length, 2 * wrist.radius)
        if wrist.flat:  # MuJoCo's contacts of cylinders jump where their rims touch edges
            spec.add_mesh(name=TOOL, uservert=_prism(wrist.radius, long).ravel())
            geom = add_geom(body, "MESH", [], name=TOOL, meshname=TOOL)
        else:
            ends = [0, 0, -long, 0, 0, -wrist.radius]
            geom = add_geom(body, "CAPSULE", [wrist.radius], name=TOOL, fromto=ends)
        geom.conaffinity, geom.friction = BODIES, [0.0, 0.0, 0.0]
        geom.solref[:2] = 2.0 * timestep, 1.0
    body.add_site(name=TOOL, pos=np.zeros(3), size=[1e-3] * 3, group=4)
    sense_site(spec, TOOL, {"force": _FORCE, "torque": _TORQUE})


def sense_site(spec: Any, site: str, names: dict[str, str]) -> None:
    """Add sensors of force and torque, by these names, between the body of a site and the one that carries it."""
    mujoco = import_mujoco()
    for kind, name in names.items():
        sensor = getattr(mujoco.mjtSensor, f"mjSENS_{kind.upper()}")
        spec.add_sensor(name=name, type=sensor, objtype=mujoco.mjtObj.mjOBJ_SITE, objname=site)


def _prism(radius: float, length: float) -> Array:
    """Return the corners of a rod along z that ends at z = 0, (2 · sides, 3), m."""
    half = np.pi / _SIDES
    turn = 2 * half * np.arange(_SIDES)
    around = radius / np.sqrt(np.cos(half)) * np.column_stack([np.cos(turn), np.sin(turn), np.zeros(_SIDES)])
    return np.concatenate([around, around - [0.0, 0.0, length]])


class MujocoWrist:
    """A force sensor at work.

    Attributes
    ----------
    wrench
        What it shows: force and torque of tool and environment on the end effector, its axes, shape (6,).
    channels, readings
        That, and the force of what is touched, base axes, the mean of a period: contacts of hard things come and go
        from one time step to the next.
    filtered
        Behind the filter, without noise, updated at every time step.
    """

    def __init__(self, wrist: Wrist, model: Any, data: Any, seed: int) -> None:
        self._step = import_mujoco().mj_step
        force, torque = (int(model.sensor(name).adr[0]) for name in (_FORCE, _TORQUE))
        self._shown = data.sensordata[force : force + 3], data.sensordata[torque : torque + 3]
        self._external: Array = data.cfrc_ext[model.body(TOOL).id, 3:]  # which the sensors let MuJoCo compute
        self._kept, self._noise, self._bias = wrist.kept(model.opt.timestep), wrist.noise, wrist.bias
        self._rng = np.random.default_rng([seed, _STREAM])
        self.channels: tuple[Channel, ...] = CHANNELS
        self.readings: Array = np.zeros(9)
        self.wrench: Array = self.readings[:6]
        self.filtered: Array = self._unfiltered()
        self._touch, self._steps = np.zeros(3), 0

    def _unfiltered(self) -> Array:
        """Return force and torque that the tool exerts, and the bias; MuJoCo shows what acts on the tool."""
        return self._bias - np.concatenate(self._shown)

    def advance(self, model: Any, data: Any, count: int) -> None:
        """Take so many time steps, and feel at each."""
        for _ in range(count):
            self._step(model, data, 1)
            self.filtered += (1.0 - self._kept) * (self._unfiltered() - self.filtered)
            self._touch += self._external
        self._steps += count

    def read(self) -> None:
        """Update what it shows."""
        self.wrench[:] = self.filtered + self._noise * self._rng.standard_normal(6)
        self.readings[6:] = self._touch / max(self._steps, 1)
        self._touch[:], self._steps = 0.0, 0

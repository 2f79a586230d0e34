"""Mecanum and omni wheels in MuJoCo, roller by roller, under a box."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.plants.mobile.wheeled_base import (
    RIM,
    TYRE,
    SolidBase,
    add_chassis,
    shown,
    solid_cylinder,
    touching,
)
from dqcontrol.plants.mujoco.mujoco_model import import_mujoco
from dqcontrol.robots.kinematics.axes import z_onto
from dqcontrol.robots.roller_bases import RollerBase, RollerWheel

_ROLLER = 0.25  # of the wheel's radius: the rollers' own, in their middle
_ROLLERS_SHARE = 0.3  # of the wheel's mass


def add_roller_base(spec: Any, base: SolidBase, drive: RollerBase, mount: Array) -> Any:
    """Add a box on wheels with rollers to an ``mjSpec``; return the box.

    A roller is an ellipsoid about its axis, as thick as makes its wheel round: of two neighbours one touches the floor,
    or both. Rollers turn freely.

    Parameters
    ----------
    spec
        ``mjSpec``.
    base, drive
        Parameters and geometry.
    mount
        Where what the base carries begins, shape (3,), m; a post leads there.
    """
    half = np.array([*np.abs([[wheel.x, wheel.y] for wheel in drive.wheels]).max(axis=0), base.height / 2])
    inertia = base.mass / 3 * (np.sum(half**2) - half**2)
    size = half - [0, 0.4 * drive.wheel_radius, 0]  # between its wheels
    body = add_chassis(spec, base, import_mujoco().mjtGeom.mjGEOM_BOX, size, inertia, mount)
    for i, wheel in enumerate(drive.wheels):
        _add_wheel(body, f"wheel_{i + 1}", wheel, base, drive.wheel_radius)
    return body


def _add_wheel(body: Any, name: str, wheel: RollerWheel, base: SolidBase, radius: float) -> None:
    """Add a hub that turns about its axle, and the rollers on it."""
    mujoco, half = import_mujoco(), 0.5 * wheel.heading
    hub = body.add_body(
        name=name, pos=[wheel.x, wheel.y, radius], quat=[math.cos(half), 0, 0, math.sin(half)]
    )
    hub_mass, thick = (1 - _ROLLERS_SHARE) * base.wheel_mass, _ROLLER * radius
    hub.mass, hub.ipos, hub.explicitinertial = hub_mass, [0, 0, 0], True
    hub.inertia = solid_cylinder(hub_mass, radius, 0.6 * radius, 1)
    joint = hub.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 1, 0])
    joint.frictionloss = base.rolling_resistance
    out = radius - thick
    long = math.sqrt(thick * out) / math.cos(wheel.roller)  # as its curvature along the wheel is the wheel's
    cylinder = mujoco.mjtGeom.mjGEOM_CYLINDER
    ends = [0, -0.5 * long, 0, 0, 0.5 * long, 0]
    shown(hub.add_geom(type=cylinder, fromto=ends, size=[out - 0.5 * thick, 0, 0], rgba=RIM, mass=0))
    mass = _ROLLERS_SHARE * base.wheel_mass / base.roller_count
    for k in range(base.roller_count):
        angle = math.tau * k / base.roller_count
        along = np.array([math.cos(angle), 0.0, math.sin(angle)])
        axis = math.cos(wheel.roller) * along + math.sin(wheel.roller) * np.array([0.0, 1.0, 0.0])
        place = [out * math.sin(angle), 0.0, -out * math.cos(angle)]
        roller = hub.add_body(name=f"{name}_roller_{k + 1}", pos=place, quat=z_onto(axis)[:4])
        roller.mass, roller.ipos, roller.explicitinertial = mass, [0, 0, 0], True
        roller.inertia = [mass * thick**2] * 3
        turning = roller.add_joint(type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 0, 1])
        turning.frictionloss = base.roller_friction
        ellipsoid = mujoco.mjtGeom.mjGEOM_ELLIPSOID
        touching(roller.add_geom(type=ellipsoid, size=[thick, thick, long], rgba=TYRE, mass=0), base.friction)

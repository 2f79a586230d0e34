"""Mecanum and omni wheels in MuJoCo, roller by roller: how far a base really comes, and how much it slips."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dqcontrol.arrays import Array
from dqcontrol.errors import ValueRangeError, as_array, as_positive
from dqcontrol.plants.mobile.wheeled_base import yaw_of
from dqcontrol.plants.mujoco.mujoco_model import compiled, import_mujoco
from dqcontrol.robots.axes import z_onto
from dqcontrol.robots.roller_bases import RollerBase, RollerWheel

_ROLLER = 0.25  # of the wheel's radius: the rollers' own, in their middle
_CONTACT_STEPS, _STIFF_FRICTION = 5, 100.0  # as in `mobile_plant`
_HEIGHT = 0.12  # m: of the box that stands for the body


class RollerPhysics:
    """A base on mecanum or omni wheels on a floor, each roller a body of its own.

    A roller is an ellipsoid about its axis, as thick as makes its wheel round: of two neighbours one touches the floor,
    or both. Rollers turn freely; the wheels are turned by speed controllers. Friction is Coulomb's.

    Parameters
    ----------
    base
        Wheels and limits.
    mass
        Of the body with all that stands on it, kg: a box over the wheels.
    friction
        Coulomb's coefficient of rollers on the floor; 0.8 is that of rubber on a short carpet, our assumption.
    roller_count
        Of rollers a wheel.
    roller_friction
        Torque against each roller's turning, N·m.
    wheel_torque
        Largest, N·m.
    timestep
        s.

    Attributes
    ----------
    pose
        x, y and φ of its middle, m and rad, shape (3,).
    slip
        Speed of each wheel's contact along the axis of the roller that it is on, against the floor, m/s, shape (k,).
    model, data
        MuJoCo's own.

    Raises
    ------
    MissingExtraError
        If mujoco is not installed.
    ShapeError, ValueRangeError
        If a number is out of its range.

    Examples
    --------
    >>> import dqcontrol as dqc
    >>> base = dqc.MecanumBase(wheel_radius=0.05, half_track=0.15, half_wheelbase=0.24)
    >>> robot = RollerPhysics(base, mass=20.0)
    >>> for _ in range(25):
    ...     robot.step([0.0, 0.2, 0.0], 0.02)  # 0.2 m/s to the left, for 0.5 s
    >>> bool(0.08 < robot.pose[1] < 0.102)
    True
    """

    model: Any
    data: Any

    def __init__(
        self,
        base: RollerBase,
        *,
        mass: float,
        friction: float = 0.8,
        roller_count: int = 12,
        roller_friction: float = 1e-4,
        wheel_torque: float = 5.0,
        timestep: float = 1e-3,
    ) -> None:
        self.base, self._radius = base, base.wheel_radius
        numbers = {"mass": mass, "friction": friction, "wheel_torque": wheel_torque, "timestep": timestep}
        for name, value in numbers.items():
            as_positive(name, value)
        as_positive("roller_friction", roller_friction, zero_allowed=True)
        if not isinstance(roller_count, int) or not 8 <= roller_count <= 32:
            raise ValueRangeError(
                f"roller_count: must be 8 … 32, got {roller_count!r}: fewer make no round wheel"
            )
        self.model = self._model(mass, friction, roller_count, roller_friction, wheel_torque, timestep)
        self.data = import_mujoco().MjData(self.model)
        self._timestep = timestep
        names = [f"wheel_{i}" for i in range(len(base.wheels))]
        self._wheels = [int(self.model.joint(name).dofadr[0]) for name in names]
        self.pose: Array = np.zeros(3)
        self.slip: Array = np.zeros(len(names))
        self.data.qpos[2] = self._radius
        import_mujoco().mj_step(self.model, self.data, round(0.3 / timestep))  # onto its contacts
        self._start = self.data.qpos[:2].copy(), yaw_of(self.data.qpos[3:7])

    def step(self, twist: ArrayLike, period: float) -> None:
        """Let the wheels turn as v_x, v_y (m/s) and ω (rad/s) in the base's own axes need, (3,), for a period, s."""
        speeds = self.base.wheel_speeds(as_array("twist", twist, (3,)))
        fastest = self.base.rim_speed / self._radius
        self.data.ctrl[:] = speeds * min(1.0, fastest / max(np.abs(speeds).max(), 1e-12))
        steps = max(1, round(as_positive("period", period) / self._timestep))
        import_mujoco().mj_step(self.model, self.data, steps)
        data, (place, heading) = self.data, self._start
        self.pose[2] += math.remainder(yaw_of(data.qpos[3:7]) - heading - self.pose[2], math.tau)
        away = data.qpos[:2] - place
        c, s = math.cos(heading), math.sin(heading)
        self.pose[:2] = c * away[0] + s * away[1], c * away[1] - s * away[0]
        rates = np.array([data.qvel[0], data.qvel[1], data.qvel[5]])
        own = self.base.own_twist(yaw_of(data.qpos[3:7]), rates)
        rollers = np.array([math.cos(wheel.roller) for wheel in self.base.wheels])
        self.slip[:] = self._radius * rollers * (self.base.wheel_speeds(own) - data.qvel[self._wheels])

    def _model(
        self, mass: float, friction: float, count: int, bearing: float, torque: float, timestep: float
    ) -> Any:
        mujoco = import_mujoco()
        spec = mujoco.MjSpec()
        spec.compiler.degree = False
        option = spec.option
        option.timestep, option.integrator = timestep, mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        option.cone, option.impratio = mujoco.mjtCone.mjCONE_ELLIPTIC, _STIFF_FRICTION
        floor = spec.worldbody.add_geom(name="ground", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1])
        floor.contype, floor.conaffinity, floor.friction = 1, 0, [0, 0, 0]  # the rollers' counts
        body = spec.worldbody.add_body(name="base")
        body.add_freejoint(name="base")
        wheels = self.base.wheels
        half = np.abs([[wheel.x, wheel.y] for wheel in wheels]).max(axis=0)
        extent = np.array([2 * half[0], 2 * half[1], _HEIGHT])
        body.mass, body.ipos, body.explicitinertial = mass, [0, 0, 0.05], True
        body.inertia = mass / 12 * (np.sum(extent**2) - extent**2)
        for i, wheel in enumerate(wheels):
            self._add_wheel(body, f"wheel_{i}", wheel, friction, count, bearing)
            motor = spec.add_actuator(
                name=f"wheel_{i}",
                target=f"wheel_{i}",
                trntype=mujoco.mjtTrn.mjTRN_JOINT,
                gaintype=mujoco.mjtGain.mjGAIN_FIXED,
                biastype=mujoco.mjtBias.mjBIAS_AFFINE,
            )
            gain = mass / len(wheels) * self._radius**2 / 0.02
            motor.gainprm[0], motor.biasprm[2] = gain, -gain
            motor.forcerange, motor.forcelimited = (-torque, torque), mujoco.mjtLimited.mjLIMITED_TRUE
        model = compiled(spec)
        model.geom_solref[:] = (_CONTACT_STEPS * timestep, 1)
        return model

    def _add_wheel(
        self, body: Any, name: str, wheel: RollerWheel, friction: float, count: int, bearing: float
    ) -> None:
        """Add a hub that turns about its axle, and the rollers on it."""
        mujoco, radius = import_mujoco(), self._radius
        half = 0.5 * wheel.heading
        # relative to the middle of the base at the height of its axles
        hub = body.add_body(name=name, pos=[wheel.x, wheel.y, 0], quat=[math.cos(half), 0, 0, math.sin(half)])
        hub.mass, hub.ipos, hub.explicitinertial = 0.3, [0, 0, 0], True
        hub.inertia = [0.5 * 0.3 * radius**2] * 3
        hub.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 1, 0])
        thick = _ROLLER * radius
        out = radius - thick
        long = math.sqrt(thick * out) / math.cos(
            wheel.roller
        )  # as its curvature along the wheel is the wheel's
        for k in range(count):
            angle = math.tau * k / count
            along = np.array([math.cos(angle), 0.0, math.sin(angle)])
            axis = math.cos(wheel.roller) * along + math.sin(wheel.roller) * np.array([0.0, 1.0, 0.0])
            place = [out * math.sin(angle), 0.0, -out * math.cos(angle)]
            roller = hub.add_body(name=f"{name}_roller_{k}", pos=place, quat=z_onto(axis)[:4])
            roller.mass, roller.ipos, roller.explicitinertial = 0.01, [0, 0, 0], True
            roller.inertia = [0.01 * thick**2] * 3
            joint = roller.add_joint(type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 0, 1])
            joint.frictionloss = bearing
            geom = roller.add_geom(type=mujoco.mjtGeom.mjGEOM_ELLIPSOID, size=[thick, thick, long], mass=0)
            geom.contype, geom.conaffinity, geom.condim, geom.friction = 0, 1, 3, [friction, 0, 0]


def drive_square(robot: RollerPhysics, side: float = 2.0, speed: float = 0.4) -> tuple[Array, Array, float]:
    """Drive a square without turning, ahead, left, back and right, and say how far it came.

    Each side is driven with minimum jerk, at a mean of ``speed``, m/s.

    Returns
    -------
    tuple
        Length of each side in physics, (4,), m; where it ends, x, y and φ, (3,), of the zero of kinematics; and the
        greatest slip of a wheel, m/s.
    """
    period, seconds = 0.02, side / speed
    lengths, greatest = np.zeros(4), 0.0
    for k in range(4):
        way = np.array([[1.0, 0], [0, 1], [-1, 0], [0, -1]])[k]
        begin = robot.pose[:2].copy()
        count = round(seconds / period)
        for i in range(count + 25):  # half a second at rest
            t = min((i + 0.5) / count, 1.0)
            v = 30 * side / seconds * (t * (1 - t)) ** 2
            robot.step([*(v * way), 0.0], period)
            greatest = max(greatest, float(np.abs(robot.slip).max()))
        lengths[k] = np.linalg.norm(robot.pose[:2] - begin)
    return lengths, robot.pose.copy(), greatest

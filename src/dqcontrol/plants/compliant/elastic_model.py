"""A serial arm with series elastic joints as a MuJoCo model: rotor, spring, link."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dqcontrol.arrays import Array
from dqcontrol.errors import ShapeError, ValueRangeError
from dqcontrol.plants.mujoco import mujoco_model
from dqcontrol.plants.mujoco.world_model import add_links, add_world
from dqcontrol.plants.mujoco.wrist_sensor import sense_site
from dqcontrol.robots.files.mjcf import import_mujoco
from dqcontrol.robots.robot import Robot
from dqcontrol.world import World

_ROTOR_MASS = 1e-14  # kg; a rotor is nothing but a moment of inertia, and its mass is in the links' data
TICK = 1e-3  # s, of the joint controllers
INTEGRATORS = {False: "IMPLICITFAST", True: "RK4"}  # by `accurate`
# Radians a step of the fastest spring: half of the 2 at which semi-implicit Euler becomes unstable; RK4, stable to 2√2,
# errs by 1.2⁵/120 = 2 % of a radian a step.
_MOST_PHASE = {False: 1.0, True: 1.2}
MOST_STEPS = 16  # a tick


@dataclass(frozen=True, eq=False)
class Actuation:
    """What lies between the motors' currents and the links.

    Attributes
    ----------
    rotor_inertia
        Seen at the joint, shape (n,), kg m².
    friction
        Of the gear, on the rotor's side of the spring, shape (n,), N·m·s/rad.
    stiffness
        Of the springs, shape (n,), N·m/rad; infinite for a rigid joint.
    damping
        Of the springs, shape (n,), N·m·s/rad.
    dry_friction
        Of the gear, on the rotor's side of the spring, shape (n,), N·m, whatever the speed.
    """

    rotor_inertia: Array
    friction: Array
    stiffness: Array
    damping: Array
    dry_friction: Array

    @property
    def elastic(self) -> NDArray[np.bool_]:
        """Which joints have a spring."""
        return np.isfinite(self.stiffness)


@dataclass(frozen=True, eq=False)
class Hand:
    """A body at the end of the arm, in the tool's frame: mass in kg, centre (3,) in m, tensor (3, 3) in kg m²."""

    mass: float
    center: Array
    tensor: Array


def elastic_model(
    robot: Robot,
    actuation: Actuation,
    *,
    hand: Hand | None = None,
    gravity: tuple[float, float, float] = (0.0, 0.0, -9.809),
    accurate: bool = False,
    stops: bool = True,
    world: World | None = None,
) -> Any:
    """Return the ``mjModel`` of an arm whose links hang on springs.

    The coordinates are the n link angles, then one rotor angle (seen at the joint) for each joint with a spring. A
    rotor turns about a fixed axis: the energy that the motion of its link gives it, small with high gears, is left out
    (Spong, *Modeling and control of elastic joint robots*, 1987). A rigid joint has its rotor on the link's side.

    Bodies: ``link_i``, ``rotor_i``, and ``hand`` at the tool with the sensors ``force`` and ``torque``, which give what
    the last link exerts on the hand, in the hand's axes. Actuators bear the joints' names; their control is the motor's
    torque at the joint in N·m.

    Parameters
    ----------
    robot
        An arm of revolute joints with inertias.
    actuation
        Its motors and springs.
    hand
        What the arm carries for good; None: nothing.
    gravity
        m/s², base frame.
    accurate
        True: Runge-Kutta of fourth order, which keeps the energy; False: Euler's, implicit in the velocities.
    stops
        Whether position limits stop the links.
    world
        What the links touch, each other included; None: nothing. The last one's shape is the hand's, so that the
        sensors feel it; coordinates of bodies come after those of the rotors.

    Raises
    ------
    ShapeError, ValueRangeError
        If the arm has sliding joints or no inertias, or these are impossible.
    """
    mujoco = import_mujoco()
    if "prismatic" in robot.joint_types:
        raise ShapeError(
            f"plant: compliant joints turn, and {robot.name} has sliding ones; use mujoco as plant"
        )
    spec = mujoco_model.skeleton(robot)
    mujoco_model.add_inertias(spec, robot)
    for i, name in enumerate(robot.joint_names):
        joint, driven = spec.joint(name), name
        if not stops:
            joint.limited = mujoco.mjtLimited.mjLIMITED_FALSE
        # A stop that gives way by milliradians, as stiff as the tick allows.
        joint.solref_limit, joint.solimp_limit[:2] = (4 * TICK, 1), (0.99, 0.999)
        if actuation.elastic[i]:
            driven = f"rotor_{i + 1}"
            rotor = spec.worldbody.add_body(name=driven)
            mujoco_model.weigh(rotor, _ROTOR_MASS, np.zeros(3), [actuation.rotor_inertia[i]] * 3)
            rotor.add_joint(name=driven, axis=[0, 0, 1])
            spring = spec.add_tendon(name=f"spring of {name}", springlength=[0, 0])
            spring.wrap_joint(driven, 1.0)
            spring.wrap_joint(name, -1.0)
        else:
            joint.armature = actuation.rotor_inertia[i]
        mujoco_model.add_motor(spec, name, driven)
    _add_hand(spec, robot, hand)
    option = spec.option
    option.gravity = gravity
    option.timestep = TICK
    option.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{INTEGRATORS[accurate]}")
    option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET  # a reset would hide that it diverged
    if world is None:
        option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT  # nothing here touches anything
    else:
        add_links(spec, robot, TICK, hand="hand")
        add_world(spec, world.bodies, TICK)
    model = mujoco_model.compiled(spec)
    n, elastic = len(robot.joint_names), actuation.elastic
    springs = len(actuation.stiffness[elastic])
    rotors = slice(n, n + springs)
    model.dof_damping[:n] = np.where(elastic, 0.0, actuation.friction)
    model.dof_damping[rotors] = actuation.friction[elastic]
    model.dof_frictionloss[:n] = np.where(elastic, 0.0, actuation.dry_friction)
    model.dof_frictionloss[rotors] = actuation.dry_friction[elastic]
    if springs:
        model.tendon_stiffness[:] = actuation.stiffness[elastic]
        model.tendon_damping[:] = actuation.damping[elastic]
    return model


def _add_hand(spec: Any, robot: Robot, hand: Hand | None) -> None:
    tool = robot.chain[-1]
    body = spec.body(f"link_{len(robot.joint_names)}").add_body(name="hand", pos=tool[4:7], quat=tool[:4])
    # its centre is left to MuJoCo: that of what is drawn, by which it scales how soft contacts are
    mujoco_model.weigh(body, 0.0, body.ipos, np.zeros(3))
    if hand is not None:
        moments, axes = np.linalg.eigh(hand.tensor)
        axes[:, 2] = np.cross(axes[:, 0], axes[:, 1])
        mujoco_model.weigh(body, hand.mass, hand.center, moments, axes)
    # Of no mass before a payload is taken; pushes act on it, at the tool's point.
    mujoco_model.weigh(body.add_body(name="payload"), 0.0, np.zeros(3), np.zeros(3))
    body.add_site(name="wrist")
    sense_site(spec, "wrist", {"force": "force", "torque": "torque"})


def steps_per_tick(inertia: Array, robot: Robot, actuation: Actuation, accurate: bool) -> int:
    """Return how many time steps a tick of 1 ms needs for the springs.

    Parameters
    ----------
    inertia
        Links and rotors, shape (n + springs, n + springs), kg m².

    Raises
    ------
    ValueRangeError
        If a spring is too stiff for what it moves.
    """
    joints = np.flatnonzero(actuation.elastic)
    if not len(joints):
        return 1
    stiffness, size = actuation.stiffness[joints], len(inertia)
    stretch = np.zeros((len(joints), size))
    stretch[np.arange(len(joints)), joints] = -1.0
    stretch[:, size - len(joints) :] = np.eye(len(joints))
    root = np.linalg.inv(np.linalg.cholesky(inertia))  # makes a symmetric problem of K over M
    squares, modes = np.linalg.eigh(root @ stretch.T @ (stiffness[:, None] * stretch) @ root.T)
    phase = TICK * float(np.sqrt(squares[-1]))
    steps = math.ceil(phase / _MOST_PHASE[accurate])
    if steps > MOST_STEPS:
        worst = joints[int(np.abs(stretch @ root.T @ modes[:, -1]).argmax())]
        most = actuation.stiffness[worst] * (MOST_STEPS * _MOST_PHASE[accurate] / phase) ** 2
        raise ValueRangeError(
            f"plant.springs: joint {worst + 1} '{robot.joint_names[worst]}' has "
            f"{actuation.stiffness[worst]:g} N·m/rad; for what it moves that is too stiff by far: "
            f"at most about {most:.2g}, or null for a rigid joint"
        )
    return steps

"""A compliant arm put together: its model in MuJoCo and its controllers' numbers, at rest and in balance."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from dqcontrol.arrays import Array
from dqcontrol.errors import ValueRangeError, as_each, as_positive
from dqcontrol.plants.compliant.controller_file import (
    ControllerFile,
    constants_table,
    gravity_bodies,
    load_controllers,
    static_state,
)
from dqcontrol.plants.compliant.elastic_model import TICK, elastic_model, joint_inertia, steps_per_tick
from dqcontrol.plants.compliant.joint_columns import LOWER, MODES, UPPER, WITH_GRAVITY
from dqcontrol.plants.compliant.loads_and_faults import PayloadScale
from dqcontrol.plants.mujoco.mujoco_model import import_mujoco
from dqcontrol.plants.plant import start_within_limits
from dqcontrol.robots.robot import Robot

if TYPE_CHECKING:
    from dqcontrol.plants.compliant.compliant_plant import CompliantPlant


@dataclass(frozen=True, eq=False)
class Arm:
    """An arm ready to move.

    Attributes
    ----------
    robot, file
        What it is made of.
    model, data
        MuJoCo's, at the start configuration.
    constants, state
        Of the joint controllers, columns of `joint_table`, one row a joint.
    bodies
        Table of the controllers' model of gravity, shape (n, 4).
    rotors
        Which coordinate of the model is each joint's motor, shape (n,).
    scale
        What weighs the payload; None if nothing does.
    ticks, exchange, steps
        Ticks of the joint controllers in a period, and from one exchange with the control loop to the next; steps of
        the physics in a tick.
    """

    robot: Robot
    file: ControllerFile
    model: Any
    data: Any
    constants: Array
    state: Array
    bodies: Array
    rotors: Array
    scale: PayloadScale | None
    ticks: int
    exchange: int
    steps: int


def assemble(plant: CompliantPlant, robot: Robot, start: ArrayLike, period: float) -> Arm:
    """Put the arm of a plant together, at rest at start (n,), rad, for control periods period, s.

    Raises
    ------
    Error
        If something does not fit the robot, or its motors cannot hold it at start.
    """
    mujoco = import_mujoco()
    file = load_controllers(robot, plant.controllers)
    start, ticks, n = start_within_limits(robot, start), _ticks("period", period), robot.configuration_size
    exchange = 1 if plant.exchange_period is None else _ticks("plant.exchange_period", plant.exchange_period)
    dry_friction = as_each("plant.dry_friction", plant.dry_friction, n)
    actuation = replace(file.actuation(plant.springs), dry_friction=dry_friction)
    elastic = actuation.elastic
    hand = file.hand(plant.hand)
    model = elastic_model(
        robot, actuation, hand=hand, gravity=plant.gravity, accurate=plant.accurate, world=plant.world
    )
    data: Any = mujoco.MjData(model)
    data.qpos[:n] = start
    mujoco.mj_forward(model, data)
    load = data.qfrc_bias[:n].copy()
    own = n + int(elastic.sum())  # coordinates of links and rotors; those of the world come after
    data.qpos[n:own] = (start + load / actuation.stiffness)[elastic]
    inertia = joint_inertia(model, data)[:own, :own]
    steps = steps_per_tick(inertia, robot, actuation, plant.accurate)
    model.opt.timestep = TICK / steps
    mujoco.mj_forward(model, data)
    moved = np.diag(inertia)[:n] + np.where(elastic, actuation.rotor_inertia, 0.0)
    constants = constants_table(plant, file, actuation, moved)
    constants[:, LOWER] = np.maximum(constants[:, LOWER], robot.limits.lower)
    constants[:, UPPER] = np.minimum(constants[:, UPPER], robot.limits.upper)
    state = static_state(robot, constants, MODES[plant.mode], start, load, plant.gravity_factor)
    rotors = np.arange(n, dtype=np.float64)
    rotors[elastic] = n + np.arange(np.count_nonzero(elastic))
    bodies, scale = gravity_bodies(robot, hand), None
    if plant.payload_compensation is not None:
        if plant.mode not in WITH_GRAVITY:
            raise ValueRangeError(
                f"plant.payload_compensation: needs a mode with a model of gravity, {', '.join(WITH_GRAVITY)}; "
                f"got {plant.mode}"
            )
        exact = ticks * TICK
        scale = PayloadScale(plant.payload_compensation, robot, hand, bodies, plant.gravity, exact)
    return Arm(robot, file, model, data, constants, state, bodies, rotors, scale, ticks, exchange, steps)


def _ticks(field: str, period: float) -> int:
    """Return how many ticks of the joint controllers a period has."""
    period = as_positive(field, period)
    ticks = round(period / TICK)
    if ticks < 1 or abs(ticks * TICK - period) > 1e-9 * period:
        raise ValueRangeError(
            f"{field}: must be a multiple of the joint controllers' {TICK:g} s, got {period:g} s "
            f"({max(1, ticks) * TICK:g} would do)"
        )
    return ticks

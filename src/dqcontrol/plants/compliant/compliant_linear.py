"""A compliant arm as its control loop sees it near its start: differences of the kernel that moves it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from msgspec.structs import replace as changed

from dqcontrol.arrays import Array
from dqcontrol.plants.compliant import joint_columns as column
from dqcontrol.plants.compliant.compliant_arm import assemble
from dqcontrol.plants.compliant.controller_file import static_state
from dqcontrol.plants.compliant.filters import MEMORY
from dqcontrol.plants.compliant.running_compliant import RunningCompliant
from dqcontrol.plants.linear_model import LinearModel

if TYPE_CHECKING:
    from dqcontrol.plants.compliant.compliant_plant import CompliantPlant
    from dqcontrol.robots.robot import Robot


MODES = ("THETA", "THETA_GC")  # those that follow a commanded angle at once
_HORIZON = 0.2  # s, in which what matters of a state is seen: more than a spring's or a filter's time
_CHANGE = 1e-5  # rad, rad/s, N·m
_REMEMBERED = [  # by each joint controller from one period to the next; the measured angle first
    column.ANGLE,
    column.TARGET,
    column.ENCODER,
    column.VELOCITY,
    column.SENSED,
    column.TORQUE_RATE,
    *range(column.ANGLE_MEMORY, column.TORQUE_RATE_MEMORY + MEMORY),
]
_OF_THE_LOOP = {column.ANGLE: column.TOLD, column.TARGET: column.ASKED}  # the same where all ticks exchange
_LEFT_OUT = [column.POSITION_I, column.TORQUE_I, column.ANGLE_RESOLUTION, column.TORQUE_RESOLUTION]
_WITHOUT: dict[str, Any] = {
    "pushes": [],
    "payload": None,
    "payload_compensation": None,
    "world": None,
    "encoder_losses": [],
    "dry_friction": 0.0,
    "base_shaking": 0.0,
    "wrist_fault": None,
}
_LIMITS = [column.SLEW, column.MAX_TORQUE, column.MAX_CURRENT, column.UPPER]


def linearised(plant: CompliantPlant, robot: Robot, start: Array, period: float) -> LinearModel | None:
    """Return all joints together: what a period makes of small changes of state and commands about rest at start.

    None if commands do not move the joints, as without stiffness, or if an exchange does not begin each period: then
    one period is not like the next.

    Left out: gravity, steps and noise of sensors, loads, dry friction, contacts, limits, and the joint controllers'
    integrals, which bear their share of gravity at their limits.
    """
    still = changed(plant, gravity=(0.0, 0.0, 0.0), encoder_noise=0.0, **_WITHOUT)
    arm = assemble(still, robot, start, period)
    if arm.ticks % arm.exchange:
        return None
    at_once = arm.exchange == 1
    remembered = _REMEMBERED if at_once else [*_OF_THE_LOOP.values(), *_REMEMBERED]
    arm.constants[:, _LEFT_OUT] = 0.0
    arm.constants[:, _LIMITS] = np.inf
    arm.constants[:, column.LOWER] = -np.inf
    arm.model.jnt_limited[:] = 0
    n, mode = len(start), column.MODES[plant.mode]
    rest = static_state(robot, arm.constants, mode, arm.data.qpos[:n].copy(), np.zeros(n), 1.0)
    live = RunningCompliant(still, replace(arm, state=rest), 0)
    state, qpos, qvel = arm_state = live.memory.state, live.data.qpos, live.data.qvel
    rest = [part.copy() for part in arm_state]

    def after_a_period(change: Array, command: Array) -> Array:
        for part, before in zip(arm_state, rest, strict=True):
            part[:] = before
        known, angles, rates = np.split(change, [n * len(remembered), -len(qvel)])
        state[:, remembered] += known.reshape(-1, n).T
        if at_once:
            state[:, list(_OF_THE_LOOP.values())] = state[:, list(_OF_THE_LOOP)]
        qpos[:] += angles
        qvel[:] += rates
        live.step(command)
        return np.concatenate([state[:, remembered].T.ravel(), qpos, qvel])

    size = n * len(remembered) + len(qpos) + len(qvel)
    zero_state, idle = np.zeros(size), np.zeros(n)
    return LinearModel(
        _slopes(lambda change: after_a_period(change, idle), size),
        _slopes(lambda command: after_a_period(zero_state, command), n),
    ).reduced(round(_HORIZON / period))


def _slopes(function: Callable[[Array], Array], size: int) -> Array:
    """Return the derivatives of a function at zero by central differences, a column each argument."""
    steps = _CHANGE * np.eye(size)
    return np.column_stack([(function(step) - function(-step)) / (2 * _CHANGE) for step in steps])

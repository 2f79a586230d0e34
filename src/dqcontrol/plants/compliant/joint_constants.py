"""The numbers that joint controllers start with: constants, and a state in balance."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from dqcontrol.arrays import Array
from dqcontrol.errors import ValueRangeError, as_each
from dqcontrol.plants.compliant import joint_columns as column
from dqcontrol.plants.compliant.controller_file import ControllerFile
from dqcontrol.plants.compliant.elastic_model import TICK, Actuation, Hand
from dqcontrol.plants.compliant.filters import butterworth
from dqcontrol.robots.robot import Robot

if TYPE_CHECKING:
    from dqcontrol.plants.compliant.compliant_plant import CompliantPlant


_POSITION_MODES = (column.MODES["THETA_GC"], column.MODES["THETA_GC_MJ"])
_SERVO_MODES = (column.MODES["THETA"], column.MODES["THETA_MJ"])


def constants_table(
    plant: CompliantPlant, file: ControllerFile, actuation: Actuation, inertia: Array
) -> Array:
    """Return the joint controllers' constants, shape (n, CONSTANTS); ``inertia`` (n,) is what each motor moves."""
    n = len(file.joints)
    table = np.zeros((n, column.CONSTANTS))

    def put(index: int, value: ArrayLike) -> None:
        table[:, index] = value

    put(column.LOWER, file.column("range", "lower"))
    put(column.UPPER, file.column("range", "upper"))
    fastest = file.column("range", "slew_rate")
    if plant.slew_rate is not None:
        fastest = np.minimum(fastest, as_each("plant.slew_rate", plant.slew_rate, n))
    put(column.SLEW, TICK * fastest)
    put(column.SPEED, as_each("plant.speed", plant.speed, n))
    put(column.STIFFNESS, as_each("plant.stiffness", plant.stiffness, n))
    put(column.TORQUE_ASKED, as_each("plant.torque", plant.torque, n))
    put(column.DUTY_ASKED, as_each("plant.duty", plant.duty, n))
    put(column.POSITION_P, file.column("position_loop", "k_p"))
    put(column.POSITION_I, TICK * file.column("position_loop", "k_i"))
    put(column.POSITION_D, file.column("position_loop", "k_d"))
    put(column.POSITION_LIMIT, file.column("position_loop", "integral_limit"))
    put(column.POSITION_RANGE, file.column("position_loop", "integral_range"))
    put(column.TORQUE_P, file.column("torque_loop", "k_p"))
    put(column.TORQUE_I, TICK * file.column("torque_loop", "k_i"))
    put(column.TORQUE_D, file.column("torque_loop", "k_d"))
    put(column.TORQUE_LIMIT, file.column("torque_loop", "integral_limit"))
    put(column.TORQUE_RANGE, file.column("torque_loop", "integral_range"))
    torque_constant = file.column("motor", "torque_constant")
    put(column.FEEDFORWARD, file.column("torque_loop", "feedforward") / torque_constant)
    rate = 2 * math.pi * file.column("angle_servo", "bandwidth")
    put(column.SERVO_P, inertia * rate**2)
    put(column.SERVO_D, 2 * file.column("angle_servo", "damping_ratio") * inertia * rate)
    put(column.MAX_TORQUE, file.column("range", "torque"))
    put(column.MAX_CURRENT, file.column("motor", "max_current"))
    put(column.TORQUE_CONSTANT, torque_constant)
    put(column.RESISTANCE, file.column("motor", "resistance"))
    put(column.VOLTAGE, file.column("motor", "voltage"))
    put(column.MAX_DUTY, file.column("motor", "max_duty"))
    put(column.NOMINAL_CURRENT, file.column("motor", "nominal_current"))
    put(column.HEATING, -np.expm1(-TICK / file.column("motor", "thermal_time")))
    put(column.OVERLOAD_TICKS, np.ceil(file.column("motor", "overload_time") / TICK))
    own = file.column("sensors", "angle_resolution")
    put(column.ANGLE_RESOLUTION, own if plant.encoder_resolution is None else plant.encoder_resolution)
    put(column.ANGLE_NOISE, plant.encoder_noise)
    put(column.TORQUE_RESOLUTION, file.column("sensors", "torque_resolution"))
    put(column.SPRING, np.where(actuation.elastic, actuation.stiffness, 0.0))
    put(column.SPRING_DAMPING, np.where(actuation.elastic, actuation.damping, 0.0))
    for row, joint in zip(table, file.joints, strict=True):
        for first, cutoff in (
            (column.ANGLE_FILTER, joint.sensors.angle_cutoff),
            (column.VELOCITY_FILTER, joint.sensors.velocity_cutoff),
            (column.TORQUE_RATE_FILTER, joint.sensors.torque_rate_cutoff),
        ):
            coefficients = butterworth(cutoff, TICK)
            row[first : first + len(coefficients)] = coefficients
    return table


def gravity_bodies(robot: Robot, hand: Hand | None) -> Array:
    """Return the body table of the controllers' model, the hand in the last body, shape (n, 4)."""
    if robot.inertia is None:
        raise ValueRangeError(f"inertia: {robot.name} has none, so its gravity torque is unknown")
    bodies = robot.inertia.table.copy()
    if hand is not None:
        mass, center = bodies[-1, 0], bodies[-1, 1:].copy()
        w, v, position = robot.chain[-1, 0], robot.chain[-1, 1:4], robot.chain[-1, 4:7]
        at = position + hand.center + 2 * np.cross(v, w * hand.center + np.cross(v, hand.center))
        bodies[-1, 0] = mass + hand.mass
        bodies[-1, 1:] = (mass * center + hand.mass * at) / bodies[-1, 0]
    return bodies


def static_state(
    robot: Robot, constants: Array, mode: int, q: Array, load: Array, gravity_factor: float
) -> Array:
    """Return the controllers' state in which they hold a load at q, shape (n, STATE).

    In balance the motor's torque and the spring's are the load g. The torque loop makes it of the desired torque τ by
    k_τ (k_p (τ − g) + I) + f τ = g, with I = 0 unless there is an integral gain; the position loop makes τ of the
    reference r by τ = s (k_p (r − q) + I) + γ g, with γ the gravity factor. Integrals take what they can.

    Parameters
    ----------
    mode
        Of all joints; modes without position control are left as they are at rest.
    q
        Shape (n,), rad.
    load
        Shape (n,), N·m.

    Raises
    ------
    ValueRangeError
        If a desired torque or a current beyond its limit would be needed.
    """
    state = np.zeros((len(q), column.STATE))
    state[:, column.TARGET] = state[:, column.REFERENCE] = state[:, column.GOAL] = q
    state[:, column.ENCODER], state[:, column.SENSED], state[:, column.MOTOR_TORQUE] = q, load, load
    if mode in _SERVO_MODES:
        spring = np.where(constants[:, column.SPRING] > 0, constants[:, column.SPRING], np.inf)
        state[:, column.TARGET] += load / spring + load / constants[:, column.SERVO_P]
    elif mode in _POSITION_MODES:
        for row, number, name, g in zip(state, constants, robot.joint_names, load, strict=True):
            desired = _held_by_torque_loop(row, number, g)
            if abs(desired) > number[column.MAX_TORQUE]:
                raise ValueRangeError(
                    f"start: joint '{name}' would need a desired torque of {desired:.3g} N·m to hold {g:.3g} N·m; "
                    f"its limit is {number[column.MAX_TORQUE]:g}"
                )
            _held_by_position_loop(row, number, desired - gravity_factor * g)
    for number, name, g in zip(constants, robot.joint_names, load, strict=True):
        if (
            mode in _SERVO_MODES + _POSITION_MODES
            and abs(g) > number[column.TORQUE_CONSTANT] * number[column.MAX_CURRENT]
        ):
            raise ValueRangeError(
                f"start: joint '{name}' needs {g / number[column.TORQUE_CONSTANT]:.3g} A to hold {g:.3g} N·m; "
                f"its limit is {number[column.MAX_CURRENT]:g} A"
            )
    state[:, column.REFERENCE] = state[:, column.GOAL] = state[:, column.TARGET]
    return state


def _held_by_torque_loop(state: Array, constants: Array, load: float) -> float:
    """Set the torque loop's integral so that it holds a load, and return the desired torque that goes with it."""
    current = load / constants[column.TORQUE_CONSTANT]
    proportional, forward = constants[column.TORQUE_P], constants[column.FEEDFORWARD]
    if constants[column.TORQUE_I] > 0:
        limit = constants[column.TORQUE_LIMIT]
        state[column.TORQUE_INTEGRAL] = np.clip(current - forward * load, -limit, limit)
    gain = proportional + forward
    if gain == 0:
        return load
    return float((current - state[column.TORQUE_INTEGRAL] + proportional * load) / gain)


def _held_by_position_loop(state: Array, constants: Array, torque: float) -> None:
    """Set the position loop's integral and target so that they make a torque, as far as they can."""
    stiffness = constants[column.STIFFNESS]
    if stiffness * constants[column.POSITION_P] == 0:
        return
    wanted = torque / stiffness
    if constants[column.POSITION_I] > 0:
        limit = constants[column.POSITION_LIMIT]
        state[column.POSITION_INTEGRAL] = np.clip(wanted, -limit, limit)
    state[column.TARGET] += (wanted - state[column.POSITION_INTEGRAL]) / constants[column.POSITION_P]

"""Columns of the joint controllers' numbers in the table of constants and in that of state.

Both tables have one row a joint; all quantities are seen at the joint, in SI units, per tick of 1 ms where it says so.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from dqcontrol.compiled.compile import inline

# numbers a filter: gain and pole of its first section, gain and poles of its second
COEFFICIENTS, MEMORY = 5, 3


def butterworth(cutoff: float, period: float) -> NDArray[np.float64]:
    """Return the coefficients of a third-order Butterworth filter, shape (5,).

    A first-order section g₁ (1 + z⁻¹) / (1 + a z⁻¹) and a second-order one g₂ (1 + z⁻¹)² / (1 + b z⁻¹ + c z⁻²), by
    the bilinear transform with the cutoff at its place.

    Parameters
    ----------
    cutoff
        Hz, where the gain is √½; below half the sampling rate.
    period
        Sampling time, s.

    Examples
    --------
    >>> bool(abs(butterworth(250.0, 1e-3)[1]) < 1e-12)  # a quarter of the sampling rate
    True
    """
    w = math.tan(math.pi * cutoff * period)
    second = 1 + w + w * w  # poles of s² + s + 1
    of_second = w * w / second, 2 * (w * w - 1) / second, (1 - w + w * w) / second
    return np.array([w / (1 + w), (w - 1) / (1 + w), *of_second])


@inline
def rest(coefficients, memory, value):
    """Set a filter's memory as if it had seen the value for ever."""
    memory[0] = value * (coefficients[0] - coefficients[1])
    memory[1] = value * (1.0 - coefficients[2])
    memory[2] = value * (coefficients[2] - coefficients[4])


@inline
def filtered(coefficients, memory, value):
    """Return the filter's answer to the next value."""
    first = coefficients[0] * value + memory[0]
    memory[0] = coefficients[0] * value - coefficients[1] * first
    second = coefficients[2] * first + memory[1]
    memory[1] = 2.0 * coefficients[2] * first - coefficients[3] * second + memory[2]
    memory[2] = coefficients[2] * first - coefficients[4] * second
    return second


# Constants.
(
    LOWER,  # of the reference, rad
    UPPER,
    SLEW,  # rad a tick
    SPEED,  # mean speed of minimum-jerk motions, rad/s
    STIFFNESS,  # 0 … 1
    TORQUE_ASKED,  # in the modes TORQUE and TORQUE_GC, N·m
    DUTY_ASKED,  # in the mode PWM, share of the voltage
    POSITION_P,  # N·m/rad; gains, limit and reach in the order that `integrated` takes, as those of the torque loop
    POSITION_I,  # N·m/rad a tick
    POSITION_D,  # N·m·s/rad
    POSITION_LIMIT,  # N·m
    POSITION_RANGE,  # rad
    TORQUE_P,  # A/(N·m)
    TORQUE_I,  # A/(N·m) a tick
    TORQUE_D,  # A·s/(N·m)
    TORQUE_LIMIT,  # A
    TORQUE_RANGE,  # N·m
    FEEDFORWARD,  # A/(N·m)
    SERVO_P,  # N·m/rad
    SERVO_D,  # N·m·s/rad
    MAX_TORQUE,  # N·m
    MAX_CURRENT,  # A
    TORQUE_CONSTANT,  # N·m/A
    RESISTANCE,  # Ω
    VOLTAGE,  # V
    MAX_DUTY,
    NOMINAL_CURRENT,  # A
    HEATING,  # share of the difference in temperature that a tick takes off
    OVERLOAD_TICKS,
    ANGLE_RESOLUTION,  # rad
    ANGLE_NOISE,  # rad
    TORQUE_RESOLUTION,  # N·m
    SPRING,  # N·m/rad; 0 for a rigid joint
    SPRING_DAMPING,  # N·m·s/rad
    ANGLE_FILTER,  # coefficients
) = range(35)
VELOCITY_FILTER = ANGLE_FILTER + COEFFICIENTS
TORQUE_RATE_FILTER = VELOCITY_FILTER + COEFFICIENTS
CONSTANTS = TORQUE_RATE_FILTER + COEFFICIENTS

# State.
(
    TARGET,  # q_desired as commanded, rad
    REFERENCE,  # what the controller follows, rad
    REFERENCE_VELOCITY,  # of a minimum-jerk motion, rad/s
    REFERENCE_ACCELERATION,
    GOAL,  # where the minimum-jerk motion ends
    MOTION_TIME,  # since its start, s
    MOTION_DURATION,
    ENCODER,  # last reading, rad
    ANGLE,  # filtered
    VELOCITY,
    SENSED,  # torque, N·m
    TORQUE_RATE,  # N·m/s
    POSITION_INTEGRAL,  # N·m
    TORQUE_INTEGRAL,  # A
    ANGLE_AT_SWITCH,
    TORQUE_AT_SWITCH,
    DUTY_AT_SWITCH,
    DUTY,
    DESIRED_TORQUE,  # N·m
    CURRENT,  # A
    MOTOR_TORQUE,  # N·m
    GRAVITY,  # that the model expects, N·m
    HEAT,  # of the winding, 1 at nominal current
    HOT_TICKS,
    LOST_TICKS,  # without encoder
    MOTION,  # six coefficients of the quintic
) = range(26)
ANGLE_MEMORY = MOTION + 6
VELOCITY_MEMORY = ANGLE_MEMORY + MEMORY
TORQUE_RATE_MEMORY = VELOCITY_MEMORY + MEMORY
ASKED = TORQUE_RATE_MEMORY + MEMORY  # q_desired as the control loop left it, until the next exchange, rad
TOLD = ASKED + 1  # the angle that the control loop was given at the last exchange, rad
STATE = TOLD + 1

# Numbers that the joints share, in `shared`.
(
    MODE,
    ASKED_MODE,
    RAMP,  # 0 … 1
    RAMP_STEP,  # a tick
    AGE,  # ticks since the last command
    MOST_AGE,
    MOST_LOST,
    FAULT,  # see below; 0 while all is well
    FAULTY_JOINT,
    TICKS,  # since the start
    PAYLOAD,  # kg, as attached at present
    EXCHANGE,  # ticks from one exchange with the control loop to the next
    SHARED,  # how many they are
) = range(13)

_MODES = ("OFF", "PWM", "TORQUE", "THETA", "TORQUE_GC", "THETA_GC", "THETA_MJ", "THETA_GC_MJ")
MODES = {name: number for number, name in enumerate(_MODES)}
OFF, PWM, TORQUE, THETA, TORQUE_GC, THETA_GC, THETA_MJ, THETA_GC_MJ = MODES.values()
WITH_GRAVITY = ("TORQUE_GC", "THETA_GC", "THETA_GC_MJ")
STALE, ENCODER_LOST, OVERLOAD = 1, 2, 3
FAULTS = {STALE: "no command", ENCODER_LOST: "encoder lost", OVERLOAD: "motor too hot"}

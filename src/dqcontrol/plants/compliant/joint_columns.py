"""Columns of the joint controllers' numbers in the table of constants and in that of state.

Both tables have one row a joint; all quantities are seen at the joint, in SI units, per tick of 1 ms where it says so.
"""

from __future__ import annotations

from dqcontrol.plants.compliant.filters import COEFFICIENTS, MEMORY

# Constants.
(
    LOWER,  # of the reference, rad
    UPPER,
    SLEW,  # rad a tick
    SPEED,  # mean speed of minimum-jerk motions, rad/s
    STIFFNESS,  # 0 … 1
    TORQUE_ASKED,  # in the modes TORQUE and TORQUE_GC, N·m
    DUTY_ASKED,  # in the mode PWM, share of the voltage
    POSITION_P,  # N·m/rad
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
) = range(34)
ANGLE_FILTER = 34
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
) = range(25)
MOTION = 25  # six coefficients of the quintic
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
) = range(12)
SHARED = 12

MODES = {
    "OFF": 0,
    "PWM": 1,
    "TORQUE": 2,
    "THETA": 3,
    "TORQUE_GC": 4,
    "THETA_GC": 5,
    "THETA_MJ": 6,
    "THETA_GC_MJ": 7,
}
WITH_GRAVITY = ("TORQUE_GC", "THETA_GC", "THETA_GC_MJ")
STALE, ENCODER_LOST, OVERLOAD = 1, 2, 3
FAULTS = {STALE: "no command", ENCODER_LOST: "encoder lost", OVERLOAD: "motor too hot"}

"""One tick of the joint controllers of the M3 software: sensors, modes, torque loop, safety.

The laws are those of the Meka's real-time software, with the signs of its negative gains turned: e is desired minus
measured. What every mode does stands in docs/physics.md.
"""

from __future__ import annotations

import math

from dqcontrol.compiled.compile import inline
from dqcontrol.plants.compliant import joint_columns as column
from dqcontrol.plants.compliant.elastic_model import TICK
from dqcontrol.plants.compliant.joint_columns import COEFFICIENTS, MEMORY, filtered
from dqcontrol.robots.kinematics.gravity import gravity_torque

LEAST_SPEED = 1e-3  # rad/s


@inline
def step_reference(constants, state, ramp, smooth):
    """Move the reference of one joint by a tick.

    r = s q_d + (1 − s) q_s, s the ramp since the mode's start at q_s, kept in the joint's range; then either the rate
    is limited or, if ``smooth``, a minimum-jerk quintic leads to r in |r − x| / speed, planned anew where r changes.
    """
    asked = ramp * state[column.TARGET] + (1.0 - ramp) * state[column.ANGLE_AT_SWITCH]
    asked = min(max(asked, constants[column.LOWER]), constants[column.UPPER])
    if not smooth:
        move = asked - state[column.REFERENCE]
        state[column.REFERENCE] += min(max(move, -constants[column.SLEW]), constants[column.SLEW])
        return
    if asked != state[column.GOAL]:
        state[column.GOAL] = asked
        _plan(constants, state)
    state[column.MOTION_TIME] += TICK
    t = state[column.MOTION_TIME]
    if t >= state[column.MOTION_DURATION]:
        state[column.REFERENCE] = state[column.GOAL]
        state[column.REFERENCE_VELOCITY] = 0.0
        state[column.REFERENCE_ACCELERATION] = 0.0
    else:
        c = state[column.MOTION : column.MOTION + 6]
        state[column.REFERENCE] = c[0] + t * (c[1] + t * (c[2] + t * (c[3] + t * (c[4] + t * c[5]))))
        rate = c[1] + t * (2 * c[2] + t * (3 * c[3] + t * (4 * c[4] + t * 5 * c[5])))
        state[column.REFERENCE_VELOCITY] = rate
        state[column.REFERENCE_ACCELERATION] = 2 * c[2] + t * (6 * c[3] + t * (12 * c[4] + t * 20 * c[5]))
    reference = max(state[column.REFERENCE], constants[column.LOWER])
    state[column.REFERENCE] = min(reference, constants[column.UPPER])


@inline
def _plan(constants, state):
    """Plan the quintic from the reference's position, velocity and acceleration to rest at the goal."""
    x, v, a = state[column.REFERENCE], state[column.REFERENCE_VELOCITY], state[column.REFERENCE_ACCELERATION]
    way = state[column.GOAL] - x
    duration = abs(way) / max(LEAST_SPEED, constants[column.SPEED])
    state[column.MOTION_TIME], state[column.MOTION_DURATION] = 0.0, duration
    if duration <= TICK:
        return
    d = duration
    c = state[column.MOTION : column.MOTION + 6]
    c[0], c[1], c[2] = x, v, 0.5 * a
    c[3] = (20.0 * way - 12.0 * v * d - 3.0 * a * d * d) / (2.0 * d**3)
    c[4] = (-30.0 * way + 16.0 * v * d + 3.0 * a * d * d) / (2.0 * d**4)
    c[5] = (12.0 * way - 6.0 * v * d - a * d * d) / (2.0 * d**5)


@inline
def clamped(value, limit):
    """Return the value within ± the limit."""
    return min(max(value, -limit), limit)


@inline
def quantised(value, step):
    """Return the value as a sensor with this step gives it."""
    return step * math.floor(value / step + 0.5) if step > 0.0 else value


@inline
def _through(constants, state, first, memory, value):
    """Return a value through a filter of a joint, whose coefficients and memory begin there."""
    return filtered(constants[first : first + COEFFICIENTS], state[memory : memory + MEMORY], value)


@inline
def sense(constants, state, angle, torque, lost):
    """Read one joint's encoder and torque sensor, and filter them; a lost encoder stays where it was."""
    before = state[column.ENCODER]
    if lost:
        state[column.LOST_TICKS] += 1.0
    else:
        state[column.LOST_TICKS] = 0.0
        state[column.ENCODER] = quantised(angle, constants[column.ANGLE_RESOLUTION])
    angle = state[column.ENCODER]
    state[column.ANGLE] = _through(constants, state, column.ANGLE_FILTER, column.ANGLE_MEMORY, angle)
    rate = (state[column.ENCODER] - before) / TICK
    state[column.VELOCITY] = _through(constants, state, column.VELOCITY_FILTER, column.VELOCITY_MEMORY, rate)
    before = state[column.SENSED]
    state[column.SENSED] = quantised(torque, constants[column.TORQUE_RESOLUTION])
    rate = (state[column.SENSED] - before) / TICK
    first, memory = column.TORQUE_RATE_FILTER, column.TORQUE_RATE_MEMORY
    state[column.TORQUE_RATE] = _through(constants, state, first, memory, rate)


@inline
def integrated(integral, loop, error):
    """Return the integral part after a tick: it grows only while the error is within reach, and shrinks always.

    A loop's constants are P, I, D, the limit of its integral and the reach.
    """
    if loop[1] == 0.0:
        return 0.0
    if abs(error) < loop[4] or integral * error <= 0.0:
        return clamped(integral + loop[1] * error, loop[3])
    return integral


@inline
def position_torque(constants, state):
    """Return what the position loop asks for, N·m: stiffness · PID, and gravity."""
    error = state[column.REFERENCE] - state[column.ANGLE]
    loop = constants[column.POSITION_P : column.POSITION_RANGE + 1]
    integral = integrated(state[column.POSITION_INTEGRAL], loop, error)
    state[column.POSITION_INTEGRAL] = integral
    torque = loop[0] * error + integral - loop[2] * state[column.VELOCITY]
    return constants[column.STIFFNESS] * torque + state[column.GRAVITY]


@inline
def torque_current(constants, state):
    """Return the current that the torque loop asks for, A.

    On a rigid joint the sensor would feel the motor's own torque: it takes the one at which the loop ends.
    """
    desired = state[column.DESIRED_TORQUE]
    error = desired - state[column.SENSED]
    loop, forward = constants[column.TORQUE_P : column.TORQUE_RANGE + 1], constants[column.FEEDFORWARD]
    integral = integrated(state[column.TORQUE_INTEGRAL], loop, error)
    state[column.TORQUE_INTEGRAL] = integral
    if constants[column.SPRING] == 0.0:
        asked = (loop[0] + forward) * desired + integral
        return asked / (1.0 + constants[column.TORQUE_CONSTANT] * loop[0])
    return loop[0] * error + integral - loop[2] * state[column.TORQUE_RATE] + forward * desired


@inline
def drive(constants, state, mode, ramp, rotor, rotor_velocity):
    """Write the motor torque of one joint, N·m at the joint."""
    state[column.DESIRED_TORQUE] = 0.0
    current = 0.0
    if mode == column.PWM:
        duty = ramp * constants[column.DUTY_ASKED] + (1.0 - ramp) * state[column.DUTY_AT_SWITCH]
        voltage = constants[column.VOLTAGE] * clamped(duty, constants[column.MAX_DUTY])
        induced = constants[column.TORQUE_CONSTANT] * rotor_velocity
        current = (voltage - induced) / constants[column.RESISTANCE]
    elif mode in (column.THETA, column.THETA_MJ):
        step_reference(constants, state, ramp, mode == column.THETA_MJ)
        away = state[column.REFERENCE] - rotor
        torque = constants[column.SERVO_P] * away - constants[column.SERVO_D] * rotor_velocity
        torque = ramp * torque + (1.0 - ramp) * state[column.TORQUE_AT_SWITCH]
        current = torque / constants[column.TORQUE_CONSTANT]
    elif mode != column.OFF:
        if mode in (column.THETA_GC, column.THETA_GC_MJ):
            step_reference(constants, state, ramp, mode == column.THETA_GC_MJ)
            torque = position_torque(constants, state)
        else:
            weight = state[column.GRAVITY] if mode == column.TORQUE_GC else 0.0
            torque = constants[column.TORQUE_ASKED] + weight
        torque = ramp * torque + (1.0 - ramp) * state[column.TORQUE_AT_SWITCH]
        state[column.DESIRED_TORQUE] = clamped(torque, constants[column.MAX_TORQUE])
        current = torque_current(constants, state)
    current = clamped(current, constants[column.MAX_CURRENT])
    state[column.CURRENT] = current
    state[column.MOTOR_TORQUE] = constants[column.TORQUE_CONSTANT] * current
    induced = constants[column.TORQUE_CONSTANT] * rotor_velocity
    state[column.DUTY] = (constants[column.RESISTANCE] * current + induced) / constants[column.VOLTAGE]
    load = current / constants[column.NOMINAL_CURRENT]
    state[column.HEAT] += constants[column.HEATING] * (load * load - state[column.HEAT])
    state[column.HOT_TICKS] = state[column.HOT_TICKS] + 1.0 if state[column.HEAT] > 1.0 else 0.0


@inline
def watch(constants, state, shared):
    """Find a fault, and switch all motors off."""
    if shared[column.FAULT] != 0.0:
        return
    if shared[column.AGE] > shared[column.MOST_AGE]:
        shared[column.FAULT], shared[column.FAULTY_JOINT] = column.STALE, -1.0
    for i in range(state.shape[0]):
        if state[i, column.LOST_TICKS] >= shared[column.MOST_LOST]:
            shared[column.FAULT], shared[column.FAULTY_JOINT] = column.ENCODER_LOST, i
        elif state[i, column.HOT_TICKS] >= constants[i, column.OVERLOAD_TICKS]:
            shared[column.FAULT], shared[column.FAULTY_JOINT] = column.OVERLOAD, i
    if shared[column.FAULT] != 0.0:
        shared[column.ASKED_MODE] = column.OFF


@inline
def switch(state, shared):
    """Enter the mode asked for: keep what is measured now as the ramp's start, and forget all integrals."""
    shared[column.MODE], shared[column.RAMP] = shared[column.ASKED_MODE], 0.0
    for i in range(state.shape[0]):
        state[i, column.ANGLE_AT_SWITCH] = state[i, column.ANGLE]
        state[i, column.TORQUE_AT_SWITCH] = state[i, column.SENSED]
        state[i, column.DUTY_AT_SWITCH] = state[i, column.DUTY]
        state[i, column.REFERENCE] = state[i, column.ANGLE]
        state[i, column.GOAL] = state[i, column.ANGLE]
        state[i, column.REFERENCE_VELOCITY] = 0.0
        state[i, column.REFERENCE_ACCELERATION] = 0.0
        state[i, column.MOTION_TIME] = 0.0
        state[i, column.MOTION_DURATION] = 0.0
        state[i, column.POSITION_INTEGRAL] = 0.0
        state[i, column.TORQUE_INTEGRAL] = 0.0


@inline
def control(arm):
    """Run all joint controllers of an `ArmMemory` for a tick."""
    constants, state, shared, angles = arm.constants, arm.state, arm.shared, arm.angles
    n = state.shape[0]
    shared[column.AGE] += 1.0
    watch(constants, state, shared)
    if shared[column.ASKED_MODE] != shared[column.MODE]:
        switch(state, shared)
    shared[column.RAMP] = min(1.0, shared[column.RAMP] + shared[column.RAMP_STEP])
    mode = int(shared[column.MODE])
    if mode in (column.TORQUE_GC, column.THETA_GC, column.THETA_GC_MJ):
        for i in range(n):
            angles[i] = state[i, column.ANGLE]
        gravity_torque(arm.chain, arm.bodies, angles, arm.gravity, arm.torques, arm.work)
        for i in range(n):
            state[i, column.GRAVITY] = arm.gravity_factor * arm.torques[i]
    for i in range(n):
        drive(constants[i], state[i], mode, shared[column.RAMP], arm.rotor_angles[i], arm.rotor_velocities[i])

"""One tick of the joint controllers of the M3 software: sensors, modes, torque loop, safety.

The laws are those of the Meka's real-time software, with the signs of its negative gains turned: e is desired minus
measured. What every mode does stands in docs/physics.md.
"""

from __future__ import annotations

import math

from dqcontrol.compiled.compile import inlined
from dqcontrol.plants.compliant import joint_columns as of
from dqcontrol.plants.compliant.elastic_model import TICK
from dqcontrol.plants.compliant.filters import COEFFICIENTS, MEMORY, filtered
from dqcontrol.plants.compliant.joint_reference import step_reference
from dqcontrol.robots.gravity import gravity_torque

OFF, PWM, TORQUE, THETA = of.MODES["OFF"], of.MODES["PWM"], of.MODES["TORQUE"], of.MODES["THETA"]
TORQUE_GC, THETA_GC = of.MODES["TORQUE_GC"], of.MODES["THETA_GC"]
THETA_MJ, THETA_GC_MJ = of.MODES["THETA_MJ"], of.MODES["THETA_GC_MJ"]


@inlined
def clamped(value, limit):
    """Return the value within ± the limit."""
    return min(max(value, -limit), limit)


@inlined
def quantised(value, step):
    """Return the value as a sensor with this step gives it."""
    return step * math.floor(value / step + 0.5) if step > 0.0 else value


@inlined
def sense(constants, state, angle, torque, lost):
    """Read one joint's encoder and torque sensor, and filter them; a lost encoder stays where it was."""
    before = state[of.ENCODER]
    if lost:
        state[of.LOST_TICKS] += 1.0
    else:
        state[of.LOST_TICKS] = 0.0
        state[of.ENCODER] = quantised(angle, constants[of.ANGLE_RESOLUTION])
    state[of.ANGLE] = filtered(
        constants[of.ANGLE_FILTER : of.ANGLE_FILTER + COEFFICIENTS],
        state[of.ANGLE_MEMORY : of.ANGLE_MEMORY + MEMORY],
        state[of.ENCODER],
    )
    state[of.VELOCITY] = filtered(
        constants[of.VELOCITY_FILTER : of.VELOCITY_FILTER + COEFFICIENTS],
        state[of.VELOCITY_MEMORY : of.VELOCITY_MEMORY + MEMORY],
        (state[of.ENCODER] - before) / TICK,
    )
    before = state[of.SENSED]
    state[of.SENSED] = quantised(torque, constants[of.TORQUE_RESOLUTION])
    state[of.TORQUE_RATE] = filtered(
        constants[of.TORQUE_RATE_FILTER : of.TORQUE_RATE_FILTER + COEFFICIENTS],
        state[of.TORQUE_RATE_MEMORY : of.TORQUE_RATE_MEMORY + MEMORY],
        (state[of.SENSED] - before) / TICK,
    )


@inlined
def integrated(integral, gain, error, limit, reach):
    """Return the integral part after a tick: it grows only while the error is within reach, and shrinks always."""
    if gain == 0.0:
        return 0.0
    if abs(error) < reach or integral * error <= 0.0:
        return clamped(integral + gain * error, limit)
    return integral


@inlined
def position_torque(constants, state):
    """Return what the position loop asks for, N·m: stiffness · PID, and gravity."""
    error = state[of.REFERENCE] - state[of.ANGLE]
    state[of.POSITION_INTEGRAL] = integrated(
        state[of.POSITION_INTEGRAL],
        constants[of.POSITION_I],
        error,
        constants[of.POSITION_LIMIT],
        constants[of.POSITION_RANGE],
    )
    torque = (
        constants[of.POSITION_P] * error
        + state[of.POSITION_INTEGRAL]
        - constants[of.POSITION_D] * state[of.VELOCITY]
    )
    return constants[of.STIFFNESS] * torque + state[of.GRAVITY]


@inlined
def torque_current(constants, state):
    """Return the current that the torque loop asks for, A.

    On a rigid joint the sensor would feel the motor's own torque: it takes the one at which the loop ends.
    """
    desired = state[of.DESIRED_TORQUE]
    error = desired - state[of.SENSED]
    state[of.TORQUE_INTEGRAL] = integrated(
        state[of.TORQUE_INTEGRAL],
        constants[of.TORQUE_I],
        error,
        constants[of.TORQUE_LIMIT],
        constants[of.TORQUE_RANGE],
    )
    if constants[of.SPRING] == 0.0:
        asked = (constants[of.TORQUE_P] + constants[of.FEEDFORWARD]) * desired + state[of.TORQUE_INTEGRAL]
        return asked / (1.0 + constants[of.TORQUE_CONSTANT] * constants[of.TORQUE_P])
    return (
        constants[of.TORQUE_P] * error
        + state[of.TORQUE_INTEGRAL]
        - constants[of.TORQUE_D] * state[of.TORQUE_RATE]
        + constants[of.FEEDFORWARD] * desired
    )


@inlined
def drive(constants, state, mode, ramp, rotor, rotor_velocity):
    """Write the motor torque of one joint, N·m at the joint."""
    state[of.DESIRED_TORQUE] = 0.0
    current = 0.0
    if mode == PWM:
        duty = ramp * constants[of.DUTY_ASKED] + (1.0 - ramp) * state[of.DUTY_AT_SWITCH]
        voltage = constants[of.VOLTAGE] * clamped(duty, constants[of.MAX_DUTY])
        current = (voltage - constants[of.TORQUE_CONSTANT] * rotor_velocity) / constants[of.RESISTANCE]
    elif mode in (THETA, THETA_MJ):
        step_reference(constants, state, ramp, mode == THETA_MJ)
        torque = (
            constants[of.SERVO_P] * (state[of.REFERENCE] - rotor) - constants[of.SERVO_D] * rotor_velocity
        )
        torque = ramp * torque + (1.0 - ramp) * state[of.TORQUE_AT_SWITCH]
        current = torque / constants[of.TORQUE_CONSTANT]
    elif mode != OFF:
        if mode in (THETA_GC, THETA_GC_MJ):
            step_reference(constants, state, ramp, mode == THETA_GC_MJ)
            torque = position_torque(constants, state)
        else:
            torque = constants[of.TORQUE_ASKED] + (state[of.GRAVITY] if mode == TORQUE_GC else 0.0)
        torque = ramp * torque + (1.0 - ramp) * state[of.TORQUE_AT_SWITCH]
        state[of.DESIRED_TORQUE] = clamped(torque, constants[of.MAX_TORQUE])
        current = torque_current(constants, state)
    current = clamped(current, constants[of.MAX_CURRENT])
    state[of.CURRENT] = current
    state[of.MOTOR_TORQUE] = constants[of.TORQUE_CONSTANT] * current
    state[of.DUTY] = (
        constants[of.RESISTANCE] * current + constants[of.TORQUE_CONSTANT] * rotor_velocity
    ) / constants[of.VOLTAGE]
    load = current / constants[of.NOMINAL_CURRENT]
    state[of.HEAT] += constants[of.HEATING] * (load * load - state[of.HEAT])
    state[of.HOT_TICKS] = state[of.HOT_TICKS] + 1.0 if state[of.HEAT] > 1.0 else 0.0


@inlined
def watch(constants, state, shared):
    """Find a fault, and switch all motors off."""
    if shared[of.FAULT] != 0.0:
        return
    if shared[of.AGE] > shared[of.MOST_AGE]:
        shared[of.FAULT], shared[of.FAULTY_JOINT] = of.STALE, -1.0
    for i in range(state.shape[0]):
        if state[i, of.LOST_TICKS] >= shared[of.MOST_LOST]:
            shared[of.FAULT], shared[of.FAULTY_JOINT] = of.ENCODER_LOST, i
        elif state[i, of.HOT_TICKS] >= constants[i, of.OVERLOAD_TICKS]:
            shared[of.FAULT], shared[of.FAULTY_JOINT] = of.OVERLOAD, i
    if shared[of.FAULT] != 0.0:
        shared[of.ASKED_MODE] = OFF


@inlined
def switch(state, shared):
    """Enter the mode asked for: keep what is measured now as the ramp's start, and forget all integrals."""
    shared[of.MODE], shared[of.RAMP] = shared[of.ASKED_MODE], 0.0
    for i in range(state.shape[0]):
        state[i, of.ANGLE_AT_SWITCH] = state[i, of.ANGLE]
        state[i, of.TORQUE_AT_SWITCH] = state[i, of.SENSED]
        state[i, of.DUTY_AT_SWITCH] = state[i, of.DUTY]
        state[i, of.REFERENCE] = state[i, of.ANGLE]
        state[i, of.GOAL] = state[i, of.ANGLE]
        state[i, of.REFERENCE_VELOCITY] = 0.0
        state[i, of.REFERENCE_ACCELERATION] = 0.0
        state[i, of.MOTION_TIME] = 0.0
        state[i, of.MOTION_DURATION] = 0.0
        state[i, of.POSITION_INTEGRAL] = 0.0
        state[i, of.TORQUE_INTEGRAL] = 0.0


@inlined
def control(
    constants, state, shared, chain, bodies, gravity, factor, angles, torques, work, rotors, rotor_velocities
):
    """Run all joint controllers for a tick; ``angles``, ``torques`` (n,) and ``work`` are scratch."""
    n = state.shape[0]
    shared[of.AGE] += 1.0
    watch(constants, state, shared)
    if shared[of.ASKED_MODE] != shared[of.MODE]:
        switch(state, shared)
    shared[of.RAMP] = min(1.0, shared[of.RAMP] + shared[of.RAMP_STEP])
    mode = int(shared[of.MODE])
    if mode in (TORQUE_GC, THETA_GC, THETA_GC_MJ):
        for i in range(n):
            angles[i] = state[i, of.ANGLE]
        gravity_torque(chain, bodies, angles, gravity, torques, work)
        for i in range(n):
            state[i, of.GRAVITY] = factor * torques[i]
    for i in range(n):
        drive(constants[i], state[i], mode, shared[of.RAMP], rotors[i], rotor_velocities[i])

"""One step of the supervisor, compiled: what leaves of what a law wants."""

from __future__ import annotations

import math

from dqcontrol.compiled.compile import OK, READ, READ2, STATUS, WRITE, WRONG_SIZE, inlined, kernel, types
from dqcontrol.compiled.intrinsics import ADDRESS, as_matrix
from dqcontrol.limits.command_limits import scale_down
from dqcontrol.limits.supervisor.braking import braked, fastest_stoppable
from dqcontrol.limits.supervisor.interventions import (
    ACCELERATION,
    COMMAND,
    EMERGENCY,
    MEASUREMENT,
    POSITION,
    REJOINING,
    SOFT_STOP,
    TRACKING,
    VELOCITY,
    WORKSPACE,
)
from dqcontrol.limits.supervisor.supervisor_geometry import avoid_singularity, stays_inside
from dqcontrol.limits.supervisor.supervisor_layout import (
    AT_REST,
    BAD,
    BOXED,
    DT,
    END,
    ENDING,
    FAULT,
    FROM_MEASURED,
    HEAD,
    HOLDING,
    INDEX,
    MEMORY,
    MODE,
    NOW,
    RAMP,
    RESET,
    RETURNING,
    RUNNING,
    SCALE,
    SLOW,
    STALE,
    STOP_NOW,
    STOPPED,
    WINDOW,
)

_FAR = 1e6  # rad or m: no measurement says so
_MOST = 1e9  # of wanted rates: beyond that only the direction matters

# kinematics, chain, measured, age (s), request, wanted, parameters, state, work, out
SUPERVISOR = STATUS(
    ADDRESS,  # of the kinematics
    READ2,
    READ,
    types.float64,
    types.intp,
    READ,
    READ,
    WRITE,
    WRITE,
    WRITE,
)


@inlined
def _judge(measured, age, request, wanted, parameters, tracking, moved, is_joint, position, at_rest, state):
    """Keep a good measurement, note what is wrong, change the mode; return what is wrong now."""
    n, m = measured.shape[0], wanted.shape[0]
    good = state[MEMORY : MEMORY + n]
    seen = age <= parameters[STALE]
    for i in range(n):
        seen = seen and abs(measured[i]) < _FAR
    wrong = 0
    if seen:
        for i in range(n):
            good[i] = measured[i]
        for i in range(m):
            if not math.isfinite(wanted[i]):
                wrong = COMMAND
    else:
        wrong = MEASUREMENT
    state[BAD] = state[BAD] + 1.0 if wrong else 0.0
    fault = wrong if state[BAD] >= 2.0 else 0
    far, near = False, True
    for i in range(m):
        if is_joint[i] != 0.0:
            distance = abs(good[int(moved[i])] - position[i])
            far = far or not distance <= tracking[i]
            near = near and distance <= 0.5 * tracking[i]
    if seen and far and state[MODE] == RUNNING:
        fault |= TRACKING
    if request == STOP_NOW:
        fault |= EMERGENCY
    elif request == END:
        state[ENDING] = 1.0
    if state[ENDING] != 0.0 and state[SCALE] == 0.0 and at_rest and state[MODE] == RUNNING:
        fault |= SOFT_STOP
    if fault:
        state[FAULT] = float(int(state[FAULT]) | fault)
        state[MODE] = STOPPED
    elif request == RESET and state[MODE] == STOPPED and at_rest and not wrong:
        state[FAULT] = 0.0
        state[SCALE], state[ENDING], state[HOLDING] = 0.0, 0.0, 0.0
        state[MODE] = RETURNING
    if state[MODE] == RETURNING and near:
        state[MODE] = RUNNING
    return wrong


@inlined
def _accelerate(rates, rate, position, acceleration, lower, upper, is_joint, drives, dt):
    """Bring wanted rates within reach of the present ones, and joints to rates from which they stop in time."""
    m = rates.shape[0]
    done = 0
    for k in range(drives.shape[0]):  # both inputs by the same share: the rims keep their limit
        first = int(drives[k, 0]) - k
        share = 1.0
        for i in range(first, first + 2):
            change, step = abs(rates[i] - rate[i]), acceleration[i] * dt
            if change * share > step:
                share = step / change
        if share < 1.0:
            done |= ACCELERATION
            for i in range(first, first + 2):
                rates[i] = rate[i] + share * (rates[i] - rate[i])
    for i in range(m):
        step = acceleration[i] * dt
        reached = min(max(rates[i], rate[i] - step), rate[i] + step)
        if abs(reached - rates[i]) > 1e-9:
            done |= ACCELERATION
        rates[i] = reached
        if is_joint[i] != 0.0:
            least = -fastest_stoppable(position[i] - lower[i], acceleration[i], dt)
            most = fastest_stoppable(upper[i] - position[i], acceleration[i], dt)
            kept = min(max(reached, least), most)
            if kept != reached:
                done |= POSITION
            rates[i] = kept
    return done


@inlined
def _commit(rates, rate, position, m, window, velocity, lower, upper, is_joint, dt, state, n):
    """Move the position command, smoothed over the window; return whether all is at rest."""
    base = MEMORY + n
    sent, sent_rate = state[base : base + m], state[base + m : base + 2 * m]
    past = as_matrix(state[base + 4 * m : base + 4 * m + window * m], window, m)
    row = int(state[INDEX])
    state[INDEX] = float((row + 1) % window)
    still = True
    for i in range(m):
        rate[i] = rates[i]
        position[i] = min(max(position[i] + dt * rate[i], lower[i]), upper[i])
        past[row, i] = rate[i]
        total = 0.0
        for k in range(window):
            total += past[k, i]
        sent_rate[i] = min(max(total / window, -velocity[i]), velocity[i])
        sent[i] += dt * sent_rate[i]
        if is_joint[i] != 0.0:
            sent[i] = min(max(sent[i], lower[i]), upper[i])
        still = still and sent_rate[i] == 0.0
    return still


@kernel(SUPERVISOR)
def supervise(kinematics, chain, measured, age, request, wanted, parameters, state, work, out):
    """Write the inputs that leave, and move the position command in the state; return AT_REST once stopped."""
    n, m, dt, window = measured.shape[0], wanted.shape[0], parameters[DT], int(parameters[WINDOW])
    base = MEMORY + n
    if (
        chain.shape[0] != n + 1
        or out.shape[0] != m
        or (parameters.shape[0] - HEAD - 7 * m) % 4 != 0
        or parameters.shape[0] < HEAD + 7 * m
        or state.shape[0] != base + (4 + window) * m
    ):
        return WRONG_SIZE
    acceleration = parameters[HEAD : HEAD + m]
    lower, upper = parameters[HEAD + m : HEAD + 2 * m], parameters[HEAD + 2 * m : HEAD + 3 * m]
    tracking = parameters[HEAD + 3 * m : HEAD + 4 * m]
    moved, is_joint = parameters[HEAD + 4 * m : HEAD + 5 * m], parameters[HEAD + 5 * m : HEAD + 6 * m]
    speeds = parameters[HEAD + 6 * m :]
    velocity = speeds[0:m]
    drives = as_matrix(speeds[m:], (speeds.shape[0] - m) // 4, 4)
    good = state[MEMORY:base]
    sent, sent_rate = state[base : base + m], state[base + m : base + 2 * m]
    position, rate = state[base + 2 * m : base + 3 * m], state[base + 3 * m : base + 4 * m]
    rates = work[work.shape[0] - m :]
    asked = work[work.shape[0] - 2 * m : work.shape[0] - m]

    at_rest = True
    for i in range(m):
        at_rest = at_rest and sent_rate[i] == 0.0
    wrong = _judge(
        measured, age, request, wanted, parameters, tracking, moved, is_joint, sent, at_rest, state
    )
    now = wrong
    aim = 1.0 if state[MODE] == RUNNING and state[ENDING] == 0.0 else 0.0
    state[SCALE] = min(max(aim, state[SCALE] - parameters[RAMP]), state[SCALE] + parameters[RAMP])

    following = state[MODE] == RUNNING and not wrong
    for i in range(m):
        goal = good[int(moved[i])]
        rates[i] = 0.0
        if following:
            rates[i] = wanted[i]
            if parameters[FROM_MEASURED] != 0.0 and is_joint[i] != 0.0:
                rates[i] = (goal + dt * wanted[i] - position[i]) / dt
            rates[i] = min(max(rates[i] * state[SCALE], -_MOST), _MOST)
        elif state[MODE] == RETURNING and not wrong and is_joint[i] != 0.0:
            room = abs(goal - position[i])
            rates[i] = math.copysign(
                min(fastest_stoppable(room, acceleration[i], dt), _MOST), goal - position[i]
            )
    if state[ENDING] != 0.0 and state[MODE] == RUNNING:
        now |= SOFT_STOP
    if state[MODE] == RETURNING:
        now |= REJOINING
    if following and parameters[SLOW] > 0.0:
        now |= avoid_singularity(kinematics, chain, parameters, good, rates, moved, is_joint, state, work)
    for i in range(m):
        asked[i] = rates[i]
    scale_down(good, speeds, rates)
    for i in range(m):
        if rates[i] != asked[i] and following:
            now |= VELOCITY
        rates[i] = min(max(rates[i], -velocity[i]), velocity[i])
    done = _accelerate(rates, rate, position, acceleration, lower, upper, is_joint, drives, dt)
    if following:
        now |= done
    if parameters[BOXED] != 0.0:
        share = 1.0
        while share > 0.0 and not stays_inside(
            kinematics,
            chain,
            good,
            rates,
            share,
            rate,
            position,
            acceleration,
            moved,
            is_joint,
            parameters,
            work,
        ):
            share = 0.5 * share if share > 0.2 else 0.0
        if share < 1.0:
            now |= WORKSPACE
            for i in range(m):
                safe = braked(rate[i], acceleration[i] * dt)
                rates[i] = safe + share * (rates[i] - safe)
    still = _commit(rates, rate, position, m, window, velocity, lower, upper, is_joint, dt, state, n)
    for i in range(m):
        out[i] = sent_rate[i]
        if parameters[FROM_MEASURED] != 0.0 and is_joint[i] != 0.0:
            out[i] = (sent[i] - good[int(moved[i])]) / dt
    if state[MODE] == STOPPED:
        now |= int(state[FAULT])
    state[NOW] = float(now)
    return AT_REST if state[MODE] == STOPPED and still else OK

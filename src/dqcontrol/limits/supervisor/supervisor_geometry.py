"""What a supervisor keeps of the hand: its distance from singularities, and its box."""

from __future__ import annotations

from dqcontrol.algebra.dual_quaternion_kernels import translation
from dqcontrol.compiled.compile import OK, inlined
from dqcontrol.compiled.intrinsics import as_matrix
from dqcontrol.limits.supervisor.braking import braked
from dqcontrol.limits.supervisor.interventions import HELD, SLOWED
from dqcontrol.limits.supervisor.supervisor_layout import BOX, DT, HOLD, HOLDING, SLOW
from dqcontrol.robots.dexterity_step import smallest_singular_value
from dqcontrol.robots.kinematics_kernels import call_chain, hand_jacobian

_BRAKING_STEPS = 2000  # whoever brakes longer than that goes no faster


@inlined
def avoid_singularity(kinematics, chain, parameters, good, rates, moved, is_joint, state, work):
    """Slow the rates, or hold, where they lead towards a singularity; return which."""
    n, m = good.shape[0], rates.shape[0]
    buffer = work[0 : 8 + 14 * m]
    at = 8 + 14 * m
    jacobian = as_matrix(work[at : at + 6 * m], 6, m)
    at += 6 * m
    gram, vectors = as_matrix(work[at : at + 36], 6, 6), as_matrix(work[at + 36 : at + 72], 6, 6)
    column = work[at + 72 : at + 78]
    hand, config = work[at + 78 : at + 81], work[at + 81 : at + 81 + n]
    slow, hold = parameters[SLOW], parameters[HOLD]
    fastest = 0.0
    for i in range(m):
        if is_joint[i] != 0.0:
            fastest = max(fastest, abs(rates[i]))
    here, ahead = 0.0, 0.0
    for look in range(2):
        for i in range(n):
            config[i] = good[i]
        if look == 1:
            if fastest == 0.0:
                return 0
            for i in range(m):
                if is_joint[i] != 0.0:
                    config[int(moved[i])] += 1e-3 * rates[i] / fastest
        if call_chain(kinematics, chain, config, buffer) != OK:
            return 0
        twist_jacobian = as_matrix(buffer[8 + 8 * m : 8 + 14 * m], 6, m)
        translation(buffer[0:8], hand)
        hand_jacobian((hand[0], hand[1], hand[2]), twist_jacobian, jacobian)
        value = smallest_singular_value(jacobian, 2.0 * slow, gram, vectors, column)
        if look == 0:
            here = value
            if here > 0.5 * (slow + hold):
                state[HOLDING] = 0.0
            if here >= slow:
                return 0
        else:
            ahead = value
    if ahead >= here:
        return 0
    if here <= hold:
        state[HOLDING] = 1.0
    scale = (here - hold) / (slow - hold) if slow > hold and state[HOLDING] == 0.0 else 0.0
    for i in range(m):
        rates[i] *= scale
    return SLOWED if scale > 0.0 else HELD


@inlined
def stays_inside(
    kinematics, chain, good, rates, share, rate, position, acceleration, moved, is_joint, parameters, work
):
    """Return whether the hand is in the box after these rates and at each period of braking from them."""
    n, m, dt = good.shape[0], rates.shape[0], parameters[DT]
    buffer = work[0 : 8 + 14 * m]
    at = 8 + 14 * m + 6 * m + 78
    hand, config, trial = work[at : at + 3], work[at + 3 : at + 3 + n], work[at + 3 + n : at + 3 + n + m]
    for i in range(n):
        config[i] = good[i]
    for i in range(m):
        safe = braked(rate[i], acceleration[i] * dt)
        trial[i] = safe + share * (rates[i] - safe)
        if is_joint[i] != 0.0:
            config[int(moved[i])] = position[i]
    for _ in range(_BRAKING_STEPS):
        moving = False
        for i in range(m):
            if is_joint[i] != 0.0:
                config[int(moved[i])] += dt * trial[i]
                trial[i] = braked(trial[i], acceleration[i] * dt)
                moving = moving or trial[i] != 0.0
        if call_chain(kinematics, chain, config, buffer) != OK:
            return False
        translation(buffer[0:8], hand)
        box = parameters[BOX : BOX + 6]
        if not (box[0] <= hand[0] <= box[3] and box[1] <= hand[1] <= box[4] and box[2] <= hand[2] <= box[5]):
            return False
        if not moving:
            return True
    return False

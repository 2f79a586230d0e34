"""The step of position servos, which arms and whole bodies share."""

from __future__ import annotations

import math
from collections.abc import Callable

from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import OK, WRONG_SIZE, Kernel, inline, kernel
from dqcontrol.compiled.intrinsics import as_matrix, caller
from dqcontrol.plants.plant import PLANT
from dqcontrol.robots.kinematics.gravity import GRAVITY_FORCES, WORK


@inline
def free_response(h, bandwidth, damping):
    """Return φ₁ and φ₂ of y(h) = φ₁ y + φ₂ y' for y'' + 2ζω y' + ω² y = 0; y'(h) = −ω² φ₂ y + (φ₁ − 2ζω φ₂) y'."""
    if damping < 1.0:
        rate = bandwidth * math.sqrt(1.0 - damping * damping)
        decay = math.exp(-damping * bandwidth * h)
        along = math.sin(rate * h) / rate if rate * h > 1e-9 else h
        second = decay * along
        first = decay * math.cos(rate * h) + damping * bandwidth * second
        return first, second
    rate = bandwidth * math.sqrt(damping * damping - 1.0)
    if rate * h < 1e-6:
        second = math.exp(-damping * bandwidth * h) * h
        return math.exp(-damping * bandwidth * h) + damping * bandwidth * second, second
    slow = math.exp(-(damping * bandwidth - rate) * h)
    fast = math.exp(-(damping * bandwidth + rate) * h)
    second = (slow - fast) / (2.0 * rate)
    return 0.5 * (slow + fast) + damping * bandwidth * second, second


# parameters: head, then a row of columns for each joint, bodies, and the table of the joints that carry them
# SAGS_BY: address of `gravity_forces`, 0 without sag
MEASURED_MODE, OLDEST_TARGET, SAGS_BY, GRAVITY = 0, 1, 2, 3
BODIES, TABLE_COLUMNS = 6, 7
HEAD = 8
STEP, RATE, LOWER, UPPER, COMPLIANCE, DECAY, DELAY, OLDEST, RESOLUTION, NOISE = range(10)
FRICTION, IS_SECOND, KEPT, BY_SPEED, NEWER, SPEED_LOST, SPEED_KEPT, SPEED_NEWER = range(10, 18)
"""Columns: gain times period; rate limit; least and largest target; α/K; exp(−T/τ); delay in periods begun; weight of
the oldest target, below 1 where the delay ends within a period; step and noise of the encoder; half the play. Then of
second order: 1; what a period leaves of the distance and adds by the speed, and the share of the newer target; what it
takes from the speed for the distance, leaves of it, and the share of the newer target."""
COLUMNS = 18

_call_gravity = caller(GRAVITY_FORCES)


def servo_step(
    command: Array, parameters: Array, noise: Array, state: Array, q: Array, measured: Array
) -> int:
    """Move the target, let the joints follow it, read the encoders."""
    n = q.shape[0]
    if command.shape[0] != n:
        return WRONG_SIZE
    joint = as_matrix(parameters[HEAD : HEAD + COLUMNS * n], n, COLUMNS)
    count, columns, at = int(parameters[BODIES]), int(parameters[TABLE_COLUMNS]), HEAD + COLUMNS * n
    bodies = as_matrix(parameters[at : at + 4 * count], count, 4)
    table = as_matrix(parameters[at + 4 * count :], count + 1, columns)
    oldest = int(parameters[OLDEST_TARGET])
    target = state[0:n]
    sag = state[n : 2 * n]
    queue = state[2 * n : 2 * n + n * (oldest + 1)]  # newest target first

    for k in range(oldest, 0, -1):
        for i in range(n):
            queue[n * k + i] = queue[n * (k - 1) + i]
    for i in range(n):
        move = joint[i, STEP] * min(max(command[i], -joint[i, RATE]), joint[i, RATE])
        wanted = move + (measured[i] if parameters[MEASURED_MODE] != 0.0 else target[i])
        target[i] = min(max(wanted, joint[i, LOWER]), joint[i, UPPER])
        queue[i] = target[i]
    if parameters[SAGS_BY] != 0.0:
        work, gravity = state[2 * n + n * (oldest + 1) :], parameters[GRAVITY : GRAVITY + 3]
        _call_gravity(int(parameters[SAGS_BY]), table, bodies, q, gravity, sag, work)
    at = 2 * n + n * (oldest + 1) + WORK * count
    speed, driven = state[at : at + n], state[at + n : at + 2 * n]
    for i in range(n):
        delay = int(joint[i, DELAY])
        goal = queue[n * delay + i]
        before = driven[i] if joint[i, FRICTION] > 0.0 else q[i]
        if joint[i, IS_SECOND] != 0.0:
            rest = goal - joint[i, COMPLIANCE] * sag[i]
            jump = queue[n * (delay - 1) + i] - goal if joint[i, OLDEST] < 1.0 else 0.0
            away = before - rest
            after = rest + joint[i, KEPT] * away + joint[i, BY_SPEED] * speed[i] + joint[i, NEWER] * jump
            lost = joint[i, SPEED_LOST] * away
            speed[i] = joint[i, SPEED_KEPT] * speed[i] - lost + joint[i, SPEED_NEWER] * jump
        else:
            if joint[i, OLDEST] < 1.0:
                goal = joint[i, OLDEST] * goal + (1.0 - joint[i, OLDEST]) * queue[n * (delay - 1) + i]
            rest = goal - joint[i, COMPLIANCE] * sag[i]
            after = rest + (before - rest) * joint[i, DECAY]
        if joint[i, FRICTION] > 0.0:
            driven[i] = after
            after = min(max(q[i], after - joint[i, FRICTION]), after + joint[i, FRICTION])
        q[i] = after
        value = q[i] + joint[i, NOISE] * noise[i]
        if joint[i, RESOLUTION] > 0.0:
            value = joint[i, RESOLUTION] * math.floor(value / joint[i, RESOLUTION] + 0.5)
        measured[i] = value
    return OK


# One source, compiled twice: a kernel that calls another one's function is slower by a sixth.
servo: Kernel = kernel(PLANT)(servo_step)
servo_kernel_inline: Callable[..., int] = inline(servo_step)

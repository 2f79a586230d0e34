"""The step of position servos, which arms and whole bodies share."""

from __future__ import annotations

import math
from collections.abc import Callable

from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import OK, WRONG_SIZE, Kernel, inline, kernel
from dqcontrol.compiled.intrinsics import as_matrix
from dqcontrol.plants.plant import PLANT
from dqcontrol.robots.gravity import gravity_torque

# parameters: head, then rate limit (n), least and largest target (n each), compliance α/K (n), bodies (4n),
# chain (8 (n + 1))
DT, DECAY, MEASURED_MODE, DELAY, RESOLUTION, NOISE, SAG, GRAVITY = 0, 1, 2, 3, 4, 5, 6, 7
OLDEST = 10  # weight of the oldest target in the queue: below 1 where the delay ends within a period
HEAD = 11


def servo_step(
    command: Array, parameters: Array, noise: Array, state: Array, q: Array, measured: Array
) -> int:
    """Move the target, let the joints follow it, read the encoders."""
    n = q.shape[0]
    if command.shape[0] != n:
        return WRONG_SIZE
    rate = parameters[HEAD : HEAD + n]
    least, most = parameters[HEAD + n : HEAD + 2 * n], parameters[HEAD + 2 * n : HEAD + 3 * n]
    compliance = parameters[HEAD + 3 * n : HEAD + 4 * n]
    bodies = as_matrix(parameters[HEAD + 4 * n : HEAD + 8 * n], n, 4)
    chain = as_matrix(parameters[HEAD + 8 * n : HEAD + 8 * n + 8 * (n + 1)], n + 1, 8)
    delay = int(parameters[DELAY])
    target = state[0:n]
    sag = state[n : 2 * n]
    queue = state[2 * n : 2 * n + n * (delay + 1)]  # newest target first

    for k in range(delay, 0, -1):
        for i in range(n):
            queue[n * k + i] = queue[n * (k - 1) + i]
    for i in range(n):
        move = parameters[DT] * min(max(command[i], -rate[i]), rate[i])
        wanted = move + (measured[i] if parameters[MEASURED_MODE] != 0.0 else target[i])
        target[i] = min(max(wanted, least[i]), most[i])
        queue[i] = target[i]
    if parameters[SAG] != 0.0:
        work = state[2 * n + n * (delay + 1) :]
        gravity_torque(chain, bodies, q, parameters[GRAVITY : GRAVITY + 3], sag, work)
    for i in range(n):
        goal = queue[n * delay + i]
        if parameters[OLDEST] < 1.0:
            goal = parameters[OLDEST] * goal + (1.0 - parameters[OLDEST]) * queue[n * (delay - 1) + i]
        rest = goal - compliance[i] * sag[i]
        q[i] = rest + (q[i] - rest) * parameters[DECAY]
        value = q[i] + parameters[NOISE] * noise[i]
        if parameters[RESOLUTION] > 0.0:
            value = parameters[RESOLUTION] * math.floor(value / parameters[RESOLUTION] + 0.5)
        measured[i] = value
    return OK


# One source, compiled twice: a kernel that calls another one's function is slower by a sixth.
servo: Kernel = kernel(PLANT)(servo_step)
servo_kernel_inline: Callable[..., int] = inline(servo_step)

"""From a commanded angle to the reference that a joint controller follows: ramp, range, slew rate, minimum jerk."""

from __future__ import annotations

from dqcontrol.compiled.compile import inline
from dqcontrol.plants.compliant import joint_columns as column
from dqcontrol.plants.compliant.elastic_model import TICK

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
        state[column.REFERENCE_VELOCITY] = c[1] + t * (
            2 * c[2] + t * (3 * c[3] + t * (4 * c[4] + t * 5 * c[5]))
        )
        state[column.REFERENCE_ACCELERATION] = 2 * c[2] + t * (6 * c[3] + t * (12 * c[4] + t * 20 * c[5]))
    state[column.REFERENCE] = min(
        max(state[column.REFERENCE], constants[column.LOWER]), constants[column.UPPER]
    )


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

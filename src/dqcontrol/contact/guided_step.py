"""Plans that touch, compiled: guarded moves end where they touch or drop, three touches put a plan onto a plane.

The plan stays as it was sampled; from each touch on it is displaced, x ← E x. A guarded move ends at x_t, not at its
planned end x_e; what comes after goes on from there: E ← x_t x_e*. Where three touches tell a plane, D takes the
planned plane onto it, and E becomes D during the move that follows: E ← (D E*)^s E, s from 0 to 1, from rest to rest.
"""

from __future__ import annotations

import math

from dqcontrol.algebra.dual_quaternion_kernels import (
    adjoint_twist,
    conjugate,
    cross_twist,
    exp_screw,
    log_screw,
    multiply,
    renormalise,
    rotated,
    set_pose,
)
from dqcontrol.compiled.compile import OK, READ, READ2, WRITE, WRITE2, inline, kernel, types
from dqcontrol.compiled.intrinsics import stack_array
from dqcontrol.contact.contact_layout import MOST_GUARDS, UNTOUCHED, contact_parameters, contact_state

_numbers = stack_array(64)
_FLAT = 1e-6  # m²: three touches on one line tell no plane


@inline
def _fit(given, own, scratch):
    """Write the screw that takes the present displacement to the one onto the plane of the last three touches."""
    last = int(given.guarded) - 1
    for i in range(last - 2, last + 1):
        if own.touched[i] == 0.0:
            return UNTOUCHED
    a, b, c = own.points[last - 2], own.points[last - 1], own.points[last]
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    mx, my, mz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    size = math.sqrt(mx * mx + my * my + mz * mz)
    if size < _FLAT:
        return UNTOUCHED
    n, o = given.normal, given.origin
    size = size if n[0] * mx + n[1] * my + n[2] * mz > 0.0 else -size
    mx, my, mz = mx / size, my / size, mz / size
    upright = n[0] * mx + n[1] * my + n[2] * mz
    high = ((a[0] - o[0]) * mx + (a[1] - o[1]) * my + (a[2] - o[2]) * mz) / upright
    turn, place, onto, back, step = scratch[0:4], scratch[4:7], scratch[8:16], scratch[16:24], scratch[24:32]
    turn[0] = 1.0 + upright  # half way between n and the plane's normal
    turn[1] = n[1] * mz - n[2] * my
    turn[2] = n[2] * mx - n[0] * mz
    turn[3] = n[0] * my - n[1] * mx
    size = math.sqrt(turn[0] * turn[0] + turn[1] * turn[1] + turn[2] * turn[2] + turn[3] * turn[3])
    for i in range(4):
        turn[i] /= size
    tx, ty, tz = rotated(turn, o)
    place[0], place[1], place[2] = o[0] + high * n[0] - tx, o[1] + high * n[1] - ty, o[2] + high * n[2] - tz
    set_pose(turn, place, onto)
    conjugate(own.moved, back)
    multiply(onto, back, step)
    log_screw(step, own.screw)
    own.fitted[0] = 1.0
    return OK


@inline
def is_at_end(k, given, own, force, gone):
    """Say whether a force, or how far the hand has gone where the wanted one pushes, ends the guarded move of a row."""
    for i in range(int(given.guarded)):
        if given.guards[i, 0] <= k < given.guards[i, 1]:
            if k == given.guards[i, 0]:
                own.gone[0] = gone
            return force > given.guards[i, 2] or gone - own.gone[0] > given.guards[i, 3]
    return False


@inline
def guide(k, sample, given, own, hit, place, out):
    """Write the sample k of the plan where touches have displaced it to; ``hit``: the hand touches now, at p."""
    px, py, pz = place
    for i in range(21):
        out[i] = sample[i]
    guarded = int(given.guarded)
    if guarded == 0:
        return OK
    scratch = _numbers()
    now, back = scratch[0:8], scratch[8:16]
    if own.moved[0] == 0.0 and own.moved[1] == 0.0 and own.moved[2] == 0.0 and own.moved[3] == 0.0:
        own.moved[0] = 1.0
    g = -1
    for i in range(guarded):
        if k >= given.guards[i, 0]:
            g = i
    if g >= 0 and k < given.guards[g, 1]:
        if own.touched[g] == 0.0 and hit:
            own.touched[g] = k + 1.0
            own.points[g, 0], own.points[g, 1], own.points[g, 2] = px, py, pz
            multiply(own.moved, sample[0:8], own.held)
            conjugate(given.guards[g, 4:12], back)
            multiply(own.held, back, now)
            renormalise(now, own.moved)
        if own.touched[g] != 0.0:
            for i in range(8):
                out[i] = own.held[i]
            for i in range(8, 20):
                out[i] = 0.0
            return OK
    by, screw, faster = scratch[16:24], scratch[24:30], scratch[30:36]
    rate, more = 0.0, 0.0
    if given.fit[1] > 0.0 and k >= given.fit[0]:
        if own.fitted[0] == 0.0:
            status = _fit(given, own, scratch)
            if status != OK:
                return status
        lasts = (given.fit[1] - given.fit[0]) * given.period
        t = min((k - given.fit[0]) * given.period / lasts, 1.0)
        share = t * t * t * (10.0 - t * (15.0 - 6.0 * t))
        t = min(t + given.lead[0] / lasts, 1.0)
        more = 60.0 * t * (1.0 - t) * (1.0 - 2.0 * t) / (lasts * lasts)
        rate = 30.0 * t * t * (1.0 - t) * (1.0 - t) / lasts + given.lead[1] * more
        for i in range(6):
            screw[i] = share * own.screw[i]
        exp_screw(screw, now)
        multiply(now, own.moved, by)
    else:
        for i in range(8):
            by[i] = own.moved[i]
    multiply(by, sample[0:8], out[0:8])
    adjoint_twist(by, sample[8:14], out[8:14])
    adjoint_twist(by, sample[14:20], out[14:20])
    if rate != 0.0 or more != 0.0:
        for i in range(6):
            screw[i] = 2.0 * own.screw[i]
        cross_twist(screw, out[8:14], faster)
        for i in range(6):
            out[8 + i] += rate * screw[i]
            out[14 + i] += more * screw[i] + rate * faster[i]
    return OK


@kernel(types.void(READ2, READ, WRITE, WRITE2), strict=True)
def guide_again(samples, parameters, state, out):
    """Write the samples of a plan where the touches of a finished run displaced them to; the state is overwritten."""
    given, own = contact_parameters(parameters), contact_state(state)
    for i in range(8):
        own.moved[i] = 0.0
    own.fitted[0] = 0.0
    scratch = _numbers()
    rows, points = scratch[0:8], scratch[8:32]
    for i in range(MOST_GUARDS):
        rows[i] = own.touched[i]
        own.touched[i] = 0.0
        for j in range(3):
            points[3 * i + j] = own.points[i, j]
    for k in range(samples.shape[0]):
        hit, px, py, pz = False, 0.0, 0.0, 0.0
        for i in range(MOST_GUARDS):
            if rows[i] == k + 1.0:
                hit, px, py, pz = True, points[3 * i], points[3 * i + 1], points[3 * i + 2]
        guide(k, samples[k], given, own, hit, (px, py, pz), out[k])

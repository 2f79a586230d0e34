"""One period of the contact stage, compiled: desired sample and wrench in, sample of the compliant frame out.

With y = (φ, p) the deflection of the compliant frame from the desired one in task axes, along each axis

    M ÿ + D ẏ + K y = w − w_d,    w = (Jₗ(φ)ᵀ m, f),

m and f what the environment exerts on the hand, about it. Its orientation is exp(½φ), turned from the desired one, and
its angular velocity Jₗ(φ) φ̇; so Jₗᵀm is the force that belongs to φ, and the spring's moment on the hand is
Jₗ(φ)⁻ᵀ K φ: the gradient of ½ φᵀKφ, which turns without a gain of energy also where the stiffnesses differ. Along
each axis the equation is linear, and a period is its matrix exponential with w held: exact, whatever M, D, K and T.

The logarithm is the decoupled one, 2 log r and p apart: that of the screw mixes axes as soon as the frame is turned.
"""

from __future__ import annotations

import math

from dqcontrol.algebra.dual_quaternion_kernels import position, quaternion_product
from dqcontrol.compiled.compile import NOT_FINITE, OK, READ, STATUS, WRITE, inline, kernel, shared
from dqcontrol.compiled.intrinsics import stack_array
from dqcontrol.contact.contact_layout import (
    BASE,
    CONTACT,
    HAND,
    contact_parameters,
    contact_state,
    contact_work,
)
from dqcontrol.contact.guided_step import guide, is_at_end

_SMALL = 1e-2  # rad²: below, series are exact to rounding with the terms that they have
_MADE = 3.0  # samples above the limit that make contact
_HIT = 2.0  # samples that end a guarded move: one may be noise
_LED = 0.1  # of the speed of who goes on: a hand that is slower does not tell where to
_HELD = 3.0  # samples that the last wrench stands for missing ones
_numbers = stack_array(18)


@inline
def turned(w, x, y, z, a, b, c):
    """Return a vector turned by a quaternion."""
    tx, ty, tz = 2.0 * (y * c - z * b), 2.0 * (z * a - x * c), 2.0 * (x * b - y * a)
    return a + w * tx + y * tz - z * ty, b + w * ty + z * tx - x * tz, c + w * tz + x * ty - y * tx


@inline
def cross(a, b, c, x, y, z):
    """Return the cross product of two vectors."""
    return b * z - c * y, c * x - a * z, a * y - b * x


@inline
def _factors(square):
    """Return a = (1 − cos θ)/θ² and b = (θ − sin θ)/θ³, and their derivatives by θ²."""
    if square < _SMALL:
        a = 0.5 - square * (1.0 / 24 - square * (1.0 / 720 - square / 40320))
        b = 1.0 / 6 - square * (1.0 / 120 - square * (1.0 / 5040 - square / 362880))
        da = -1.0 / 24 + square * (1.0 / 360 - square / 13440)
        db = -1.0 / 120 + square * (1.0 / 2520 - square / 120960)
        return a, b, da, db
    angle = math.sqrt(square)
    sine, cosine = math.sin(angle), math.cos(angle)
    a, b = (1.0 - cosine) / square, (angle - sine) / (square * angle)
    return a, b, (0.5 * sine / angle - a) / square, 0.5 * ((1.0 - cosine) / square - 3.0 * b) / square


@inline
def turning(phi, rate, more):
    """Return ω = Jₗ(φ) φ̇ and its derivative, Jₗ φ̈ + J̇ₗ φ̇."""
    square = phi[0] * phi[0] + phi[1] * phi[1] + phi[2] * phi[2]
    a, b, da, db = _factors(square)
    change = 2.0 * (phi[0] * rate[0] + phi[1] * rate[1] + phi[2] * rate[2])
    cx, cy, cz = cross(phi[0], phi[1], phi[2], rate[0], rate[1], rate[2])
    dx, dy, dz = cross(phi[0], phi[1], phi[2], cx, cy, cz)
    ex, ey, ez = cross(rate[0], rate[1], rate[2], cx, cy, cz)
    gx, gy, gz = cross(phi[0], phi[1], phi[2], more[0], more[1], more[2])
    hx, hy, hz = cross(phi[0], phi[1], phi[2], gx, gy, gz)
    da, db = da * change, db * change
    return (
        rate[0] + a * cx + b * dx,
        rate[1] + a * cy + b * dy,
        rate[2] + a * cz + b * dz,
        more[0] + a * gx + b * hx + da * cx + db * dx + b * ex,
        more[1] + a * gy + b * hy + da * cy + db * dy + b * ey,
        more[2] + a * gz + b * hz + da * cz + db * dz + b * ez,
    )


@inline
def unloaded(pose, given, wrench, out):
    """Write force and torque at the sensor, its axes, without weight and bias of the tool."""
    rw, rx, ry, rz = pose[0], pose[1], pose[2], pose[3]
    sensor, bias, center = given.sensor, given.bias, given.tool_center
    sw, sx, sy, sz = sensor[0], sensor[1], sensor[2], sensor[3]
    gx, gy, gz = given.gravity[0], given.gravity[1], given.gravity[2]
    gx, gy, gz = turned(rw, -rx, -ry, -rz, gx, gy, gz)
    gx, gy, gz = turned(sw, -sx, -sy, -sz, gx, gy, gz)
    gx, gy, gz = given.tool_mass * gx, given.tool_mass * gy, given.tool_mass * gz
    tx, ty, tz = cross(center[0], center[1], center[2], gx, gy, gz)
    out[0], out[1], out[2] = wrench[0] - bias[0] - gx, wrench[1] - bias[1] - gy, wrench[2] - bias[2] - gz
    out[3], out[4], out[5] = wrench[3] - bias[3] - tx, wrench[4] - bias[4] - ty, wrench[5] - bias[5] - tz


@inline
def contact_wrench(pose, sample, given, tare, out):
    """Replace force and torque at the sensor by moment and force on the hand in task axes, less what was tared."""
    rw, rx, ry, rz = pose[0], pose[1], pose[2], pose[3]
    sensor = given.sensor
    sw, sx, sy, sz = sensor[0], sensor[1], sensor[2], sensor[3]
    fx, fy, fz = turned(sw, sx, sy, sz, out[0] - tare[0], out[1] - tare[1], out[2] - tare[2])
    mx, my, mz = turned(sw, sx, sy, sz, out[3] - tare[3], out[4] - tare[4], out[5] - tare[5])
    lx, ly, lz = cross(sensor[4], sensor[5], sensor[6], fx, fy, fz)
    mx, my, mz = mx + lx, my + ly, mz + lz
    if given.axes != HAND:
        fx, fy, fz = turned(rw, rx, ry, rz, fx, fy, fz)
        mx, my, mz = turned(rw, rx, ry, rz, mx, my, mz)
        if given.axes != BASE:
            fx, fy, fz = turned(sample[0], -sample[1], -sample[2], -sample[3], fx, fy, fz)
            mx, my, mz = turned(sample[0], -sample[1], -sample[2], -sample[3], mx, my, mz)
    out[0], out[1], out[2], out[3], out[4], out[5] = mx, my, mz, fx, fy, fz


@kernel(STATUS(READ, READ, READ, READ, WRITE))
def contact_wrench_at(pose, parameters, wrench, tare, out):
    """Write moment and force on the hand, axes of the base or its own, of force and torque at the sensor."""
    given = contact_parameters(parameters)
    unloaded(pose, given, wrench, out)
    contact_wrench(pose, pose, given, tare, out)
    return OK


@inline
def _note_contact(given, own, wrench):
    """Count the samples in which the hand touches and does not."""
    total = 0.0
    for i in range(3, 6):
        if given.forced[i] != 0.0 or given.forced[3] + given.forced[4] + given.forced[5] == 0.0:
            total += wrench[i] * wrench[i]
    size = math.sqrt(total)
    own.above[0] = own.above[0] + 1.0 if size > given.touching else 0.0
    own.below[0] = own.below[0] + 1.0 if size < given.lost else 0.0
    if own.above[0] >= _MADE:
        own.touches[0] = 1.0
    elif own.touches[0] != 0.0 and own.below[0] >= given.lost_after:
        own.touches[0] = 0.0
        own.losses[0] += 1.0


@inline
def _turned_to_axes(pose, sample, given, a, b, c):
    """Return a vector of the base frame along the task axes."""
    if given.axes == BASE:
        return a, b, c
    r = pose if given.axes == HAND else sample
    return turned(r[0], -r[1], -r[2], -r[3], a, b, c)


@inline
def _go_on(place, given, own):
    """Return the velocity with which the frame goes on, base axes: where the hand is led, at first as said."""
    px, py, pz = place
    way, seen = own.way, own.seen
    if own.begin[0] == 0.0:
        for i in range(3):
            way[i] = given.speed * given.direction[i]
    else:
        x = way[0] + given.fresh * ((px - seen[0]) / given.period - way[0])
        y = way[1] + given.fresh * ((py - seen[1]) / given.period - way[1])
        z = way[2] + given.fresh * ((pz - seen[2]) / given.period - way[2])
        if math.sqrt(x * x + y * y + z * z) > _LED * given.speed:
            way[0], way[1], way[2] = x, y, z
    seen[0], seen[1], seen[2] = px, py, pz
    share = given.speed / math.sqrt(way[0] * way[0] + way[1] * way[1] + way[2] * way[2])
    return share * way[0], share * way[1], share * way[2]


@inline
def _place(sample, given, y, v, rate, out):
    """Write the compliant frame's pose, twist and twist rate, of deflection, its rate and what that changes by."""
    rw, rx, ry, rz = sample[0], sample[1], sample[2], sample[3]
    px = 2.0 * (rw * sample[5] - sample[4] * rx - (sample[6] * rz - sample[7] * ry))
    py = 2.0 * (rw * sample[6] - sample[4] * ry - (sample[7] * rx - sample[5] * rz))
    pz = 2.0 * (rw * sample[7] - sample[4] * rz - (sample[5] * ry - sample[6] * rx))
    ox, oy, oz = sample[8], sample[9], sample[10]
    ax, ay, az = sample[14], sample[15], sample[16]
    cx, cy, cz = cross(px, py, pz, ox, oy, oz)
    vx, vy, vz = sample[11] - cx, sample[12] - cy, sample[13] - cz
    cx, cy, cz = cross(vx, vy, vz, ox, oy, oz)
    ex, ey, ez = cross(px, py, pz, ax, ay, az)
    bx, by, bz = sample[17] - cx - ex, sample[18] - cy - ey, sample[19] - cz - ez
    wx, wy, wz, dx, dy, dz = turning(y, v, rate)
    half = 0.5 * math.sqrt(y[0] * y[0] + y[1] * y[1] + y[2] * y[2])
    share = 0.5 * (math.sin(half) / half if half > 1e-8 else 1.0 - half * half / 6.0)
    ew, ei, ej, ek = math.cos(half), share * y[0], share * y[1], share * y[2]
    ux, uy, uz, sx, sy, sz, hx, hy, hz = y[3], y[4], y[5], v[3], v[4], v[5], rate[3], rate[4], rate[5]
    if given.axes == BASE:
        quaternion_product((ew, ei, ej, ek), (rw, rx, ry, rz), out)
        fx, fy, fz = turned(ew, ei, ej, ek, ox, oy, oz)
        ax, ay, az = turned(ew, ei, ej, ek, ax, ay, az)
        cx, cy, cz = cross(wx, wy, wz, fx, fy, fz)
        ax, ay, az = ax + dx + cx, ay + dy + cy, az + dz + cz
        ox, oy, oz = fx + wx, fy + wy, fz + wz
        vx, vy, vz, bx, by, bz = vx + sx, vy + sy, vz + sz, bx + hx, by + hy, bz + hz
    else:
        quaternion_product((rw, rx, ry, rz), (ew, ei, ej, ek), out)
        ux, uy, uz = turned(rw, rx, ry, rz, ux, uy, uz)
        sx, sy, sz = turned(rw, rx, ry, rz, sx, sy, sz)
        hx, hy, hz = turned(rw, rx, ry, rz, hx, hy, hz)
        wx, wy, wz = turned(rw, rx, ry, rz, wx, wy, wz)
        dx, dy, dz = turned(rw, rx, ry, rz, dx, dy, dz)
        cx, cy, cz = cross(ox, oy, oz, ux, uy, uz)
        vx, vy, vz = vx + cx + sx, vy + cy + sy, vz + cz + sz
        ex, ey, ez = cross(ox, oy, oz, cx + 2.0 * sx, cy + 2.0 * sy, cz + 2.0 * sz)
        cx, cy, cz = cross(ax, ay, az, ux, uy, uz)
        bx, by, bz = bx + cx + ex + hx, by + cy + ey + hy, bz + cz + ez + hz
        cx, cy, cz = cross(ox, oy, oz, wx, wy, wz)
        ax, ay, az = ax + cx + dx, ay + cy + dy, az + cz + dz
        ox, oy, oz = ox + wx, oy + wy, oz + wz
    px, py, pz = px + ux, py + uy, pz + uz
    w, x, y3, z = out[0], out[1], out[2], out[3]
    out[4] = -0.5 * (px * x + py * y3 + pz * z)
    out[5] = 0.5 * (px * w + py * z - pz * y3)
    out[6] = 0.5 * (py * w + pz * x - px * z)
    out[7] = 0.5 * (pz * w + px * y3 - py * x)
    cx, cy, cz = cross(px, py, pz, ox, oy, oz)
    out[8], out[9], out[10], out[11], out[12], out[13] = ox, oy, oz, vx + cx, vy + cy, vz + cz
    cx, cy, cz = cross(vx, vy, vz, ox, oy, oz)
    ex, ey, ez = cross(px, py, pz, ax, ay, az)
    out[14], out[15], out[16] = ax, ay, az
    out[17], out[18], out[19], out[20] = bx + cx + ex, by + cy + ey, bz + cz + ez, sample[20]


@kernel(CONTACT)
def admittance(pose, desired, k, parameters, state, work):
    """Write the sample that the law follows: pose now, and the mean twist of the coming period, w of now included.

    So no sample is lost between wrench and motion; a pose and a rate of the same instant cost up to half the stiffness
    that the loop bears.
    """
    given, own, room = contact_parameters(parameters), contact_state(state), contact_work(work)
    scratch = _numbers()
    rate, more, known = scratch[0:6], scratch[6:12], scratch[12:18]
    sample = room.planned
    room.noted[0] = 0.0
    y, v, wrench = own.y, own.v, own.wrench
    row = given.wanted[min(k, given.wanted.shape[0] - 1)]
    check = 0.0
    for i in range(6):
        check += 0.0 * room.wrench[i]
        known[i] = y[i]
    hears = check == 0.0
    own.silent[0] = 0.0 if hears else own.silent[0] + 1.0
    tares = own.tared[0] < given.tare
    pushing = math.sqrt(row[3] * row[3] + row[4] * row[4] + row[5] * row[5])
    gone = -(y[3] * row[3] + y[4] * row[4] + y[5] * row[5]) / pushing if pushing > 0.0 else 0.0
    if hears:
        unloaded(pose, given, room.wrench, wrench)
        hit = math.sqrt(
            (wrench[0] - own.tare[0]) ** 2 + (wrench[1] - own.tare[1]) ** 2 + (wrench[2] - own.tare[2]) ** 2
        )
        own.hits[0] = own.hits[0] + 1.0 if is_at_end(k, given, own, hit, gone) else 0.0
    status = guide(k, desired, given, own, own.hits[0] >= _HIT, position(pose), sample)
    if status != OK:
        return status
    if hears:
        if tares:
            own.tared[0] += 1.0
            for i in range(6):
                own.tare[i] += (wrench[i] - own.tare[i]) / own.tared[0]
                wrench[i] = 0.0
        else:
            contact_wrench(pose, sample, given, own.tare, wrench)
            if own.begin[0] == 0.0:
                for i in range(6):
                    own.begun[i] = wrench[i]
    waits = tares or k < given.begins
    gx, gy, gz = 0.0, 0.0, 0.0
    if given.speed > 0.0 and not waits:
        gx, gy, gz = _go_on(position(pose), given, own)
        gx, gy, gz = _turned_to_axes(pose, sample, given, gx, gy, gz)
    if hears and not waits:
        _note_contact(given, own, wrench)
    share = min(own.begin[0] / given.ramp, 1.0) if given.ramp > 0.0 else 1.0
    own.begin[0] += 0.0 if waits else 1.0
    is_lost = own.losses[0] > 0.0 and own.touches[0] == 0.0
    free = math.sqrt(
        (1.0 - given.forced[3]) * wrench[3] * wrench[3]
        + (1.0 - given.forced[4]) * wrench[4] * wrench[4]
        + (1.0 - given.forced[5]) * wrench[5] * wrench[5]
    )
    kept = max(0.0, 1.0 - given.dead_band / free) if given.dead_band > 0.0 and free > 0.0 else 1.0
    square = y[0] * y[0] + y[1] * y[1] + y[2] * y[2]
    a, b, _, _ = _factors(square)
    # Jᵀ m = m − a φ × m + b φ × (φ × m)
    cx, cy, cz = cross(y[0], y[1], y[2], wrench[0], wrench[1], wrench[2])
    dx, dy, dz = cross(y[0], y[1], y[2], cx, cy, cz)
    known[0], known[1], known[2] = (
        wrench[0] - a * cx + b * dx,
        wrench[1] - a * cy + b * dy,
        wrench[2] - a * cz + b * dz,
    )
    for i in range(3, 6):
        known[i] = wrench[i] if given.forced[i] != 0.0 else kept * wrench[i]
    known[3] += given.damping[3] * gx  # ẏ = v + (w − w_d)/D
    known[4] += given.damping[4] * gy
    known[5] += given.damping[5] * gz
    retreats = own.silent[0] > given.silent_after
    if retreats:
        step = (
            min(given.retreat_speed * given.period, given.retreat - own.retreated[0])
            if pushing > 0.0
            else 0.0
        )
        own.retreated[0] += step
    else:
        step = 0.0
        own.retreated[0] = 0.0
    for i in range(6):
        rate[i], more[i] = 0.0, 0.0
        if given.mass[i] == 0.0 and given.damping[i] == 0.0:
            continue
        before = v[i]
        if retreats and given.forced[i] != 0.0:
            after, ahead = 0.0, y[i] + (step * row[i] / pushing if i >= 3 else 0.0)
        else:
            wanted = own.begun[i] + share * (row[i] - own.begun[i]) if given.forced[i] != 0.0 else 0.0
            force = known[i] - wanted
            if waits or own.silent[0] > _HELD:
                force = 0.0  # never w := 0, which is free air: a force axis rests, a spring goes home
            f = given.transition[i]
            ahead = f[0] * y[i] + f[1] * before + f[2] * force
            after = f[3] * y[i] + f[4] * before + f[5] * force
        most = given.approach[i] if is_lost else given.fastest[i]
        mean = (ahead - y[i]) / given.period
        if abs(mean) > most:
            mean = most if mean > 0.0 else -most
            ahead = y[i] + given.period * mean
        after = min(max(after, -most), most)
        if abs(ahead) > given.deepest[i]:
            ahead = given.deepest[i] if ahead > 0.0 else -given.deepest[i]
            mean = (ahead - y[i]) / given.period
            if after * ahead > 0.0:
                after = 0.0
        rate[i] = mean
        if given.mass[i] > 0.0:
            more[i] = (after - before) / given.period
        known[i] = ahead
        v[i] = after
    _place(sample, given, y, rate, more, room.shaped)
    for i in range(6):
        own.energy[0] += given.period * wrench[i] * rate[i]
        if not (given.mass[i] == 0.0 and given.damping[i] == 0.0):
            y[i] = known[i]
    for i in range(14):
        check = 0.0 * room.shaped[i] if i == 0 else check + 0.0 * room.shaped[i]
    return OK if check == 0.0 else NOT_FINITE


@shared
def give_back(parameters, state, work):
    """Take from the deflection along force axes what the law asked for and limits, constraints or a supervisor held.

    y ← y − T (asked − delivered): else the compliant frame runs away from a hand that may not follow, and comes back
    only after the force has been too large for as long. It may be called again as more is held, at the same sample.
    """
    given, own, room = contact_parameters(parameters), contact_state(state), contact_work(work)
    if room.noted[0] == 0.0:
        return
    asked, delivered, back, frame = room.asked, room.delivered, room.back, room.planned
    w, x, y, z = frame[0], -frame[1], -frame[2], -frame[3]
    if given.axes == BASE:
        w, x, y, z = 1.0, 0.0, 0.0, 0.0
    for part in range(2):
        i = 3 * part
        lacking = turned(
            w,
            x,
            y,
            z,
            asked[i] - delivered[i],
            asked[i + 1] - delivered[i + 1],
            asked[i + 2] - delivered[i + 2],
        )
        for axis in range(3):
            if given.forced[i + axis] != 0.0:
                change = given.period * lacking[axis]
                own.y[i + axis] -= change - back[i + axis]
                back[i + axis] = change

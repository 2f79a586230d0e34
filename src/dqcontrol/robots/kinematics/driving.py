"""Motion of a robot under its inputs, compiled: unicycles exactly, joints at constant speed.

A table of drives has one row ``[i, d, r, b, ρ, l]`` for each base that cannot move sideways: the index of its x in the
configuration (y and φ follow), the distance d (m) of the displaced point ahead of the axle, the wheel radius r (m),
half the track b (m), the least turning radius ρ (m; 0 turns on the spot) and the lever l (m) by which turning adds to
the speed of its fastest driven rim, |v| + l |ω|. Without drives it has no rows, and the inputs are the rates of the
configuration.

A table of rollers has one row ``[j, i, a_x, a_y, a_ω]`` for each wheel with rollers that has a rim speed: the index of
ẋ among the inputs, that of φ in the configuration, and the shares of that speed that v_x, v_y (s/m) and ω (s/rad) in
the base's own axes take.

What is asked of ω beyond |v| / ρ the wheels cannot steer: the base turns as far as they do.

A robot with drives has m inputs, of which each drive has two, v and ω; or n of them, of which each drive has three
rates ẋ, ẏ, φ̇ that it cannot all follow: the displaced point takes their velocity, and the base turns as it must.
"""

from __future__ import annotations

import math

from dqcontrol.compiled.compile import NOT_FINITE, OK, READ2, STATUS, WRITE2, inline, kernel, types

DRIVE_COLUMNS = 6
HALF_TRACK, TURNING_RADIUS, RIM_LEVER = 3, 4, 5  # columns of the table of drives
ROLLER_COLUMNS = 5


@inline
def feasible(xdot, ydot, phidot, phi, displacement):
    """Return v and ω with which the displaced point moves as the rates say: C⁻¹B of [S17 4.24], in closed form."""
    c, s = math.cos(phi), math.sin(phi)
    return xdot * c + ydot * s, phidot + (ydot * c - xdot * s) / displacement


@inline
def steered(v, omega, turning_radius):
    """Return the ω that a base can have at v."""
    if turning_radius * abs(omega) > abs(v):
        return math.copysign(abs(v) / turning_radius, omega)
    return omega


@inline
def steer(drives, u):
    """Bring inputs v and ω of each drive within what its wheels can steer."""
    for k in range(drives.shape[0]):
        j = int(drives[k, 0]) - k
        u[j + 1] = steered(u[j], u[j + 1], drives[k, TURNING_RADIUS])


@inline
def drive_speeds(drives, k, u, q):
    """Return v and ω that inputs give drive k."""
    i = int(drives[k, 0])
    if u.shape[0] == q.shape[0]:
        return feasible(u[i], u[i + 1], u[i + 2], q[i + 2], drives[k, 1])
    return u[i - k], u[i - k + 1]


@inline
def rim_load(rollers, k, q, u):
    """Return the share of its rim speed, with its sign, that inputs give wheel k of those with rollers."""
    j, phi = int(rollers[k, 0]), q[int(rollers[k, 1])]
    c, s = math.cos(phi), math.sin(phi)
    ahead = c * u[j] + s * u[j + 1]
    left = c * u[j + 1] - s * u[j]
    return rollers[k, 2] * ahead + rollers[k, 3] * left + rollers[k, 4] * u[j + 2]


@inline
def roll(v, omega, period, q, i):
    """Move x, y and φ at q[i], q[i + 1], q[i + 2] along the arc of constant v and ω."""
    half = 0.5 * omega * period
    chord = v * period * (math.sin(half) / half if abs(half) > 1e-4 else 1.0 - half * half / 6.0)
    q[i] += chord * math.cos(q[i + 2] + half)
    q[i + 1] += chord * math.sin(q[i + 2] + half)
    q[i + 2] += omega * period


@inline
def advance(drives, u, period, q):
    """Move q by inputs that are constant for a period; exact, and for drives the same whether u has m or n numbers."""
    projecting = u.shape[0] == q.shape[0]
    i, j = 0, 0
    for k in range(drives.shape[0]):
        while i < int(drives[k, 0]):
            q[i] += period * u[j]
            i, j = i + 1, j + 1
        v, omega = u[j], u[j + 1]
        if projecting:
            v, omega = feasible(u[j], u[j + 1], u[j + 2], q[i + 2], drives[k, 1])
        roll(v, steered(v, omega, drives[k, TURNING_RADIUS]), period, q, i)
        i, j = i + 3, j + (3 if projecting else 2)
    while i < q.shape[0]:
        q[i] += period * u[j]
        i, j = i + 1, j + 1


@inline
def to_inputs(drives, q, rates, out):
    """Write the m inputs that follow the n rates as far as the drives can."""
    i, j = 0, 0
    for k in range(drives.shape[0]):
        while i < int(drives[k, 0]):
            out[j] = rates[i]
            i, j = i + 1, j + 1
        out[j], out[j + 1] = feasible(rates[i], rates[i + 1], rates[i + 2], q[i + 2], drives[k, 1])
        i, j = i + 3, j + 2
    while i < q.shape[0]:
        out[j] = rates[i]
        i, j = i + 1, j + 1


# drives, configurations (N × n), inputs (N × m or N × n), period, out
@kernel(STATUS(READ2, READ2, READ2, types.float64, WRITE2))
def integrate(drives, q, u, period, out):
    """Write where each configuration is after its inputs have acted for a period."""
    for row in range(q.shape[0]):
        check = 0.0
        for i in range(q.shape[1]):
            out[row, i] = q[row, i]
        advance(drives, u[row], period, out[row])
        for i in range(q.shape[1]):
            check += 0.0 * out[row, i]
        if check != 0.0:
            return NOT_FINITE
    return OK


# drives, configurations (N × n), rates (N × n), out (N × m)
@kernel(STATUS(READ2, READ2, READ2, WRITE2))
def feasible_inputs(drives, q, rates, out):
    """Write `to_inputs` for each configuration."""
    for row in range(q.shape[0]):
        to_inputs(drives, q[row], rates[row], out[row])
    return OK

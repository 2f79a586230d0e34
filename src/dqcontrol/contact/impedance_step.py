"""The torque by which a torque-driven arm behaves as springs and dampers about a target, compiled.

z = (φ, y) is what the end effector is off, along the axes of the target or of the base: the logarithm of its turn, and
the way. T = ∂z/∂q̇, δ = q̇ − q̇*, and

    τ = g + C(q, q̇) q̇* − Tᵀ(K z + D T δ) + (M − TᵀΛT) a,   a = −ω²(q − q*) − 2ω δ,   Λ = (T M⁻¹ Tᵀ)⁻¹.

K z is the gradient of ½ zᵀKz also where stiffnesses differ (as in `admittance_step`), C is that of Christoffel's
symbols, so that ½ δᵀMδ + ½ zᵀKz of a target at rest grows by nothing but what the environment does. Damping by double
diagonalisation (A. Albu-Schäffer et al., *Cartesian impedance control of redundant robots*, ICRA 2003): with
√K T M⁻¹ Tᵀ √K = U Ω² Uᵀ and X = Uᵀ√K T each mode has a frequency Ω and D T = √K U (2ζ/Ω) X, whatever the inertia
is; nothing is inverted but what a singular configuration leaves.

With masses M_d of its own, and a measured wrench w, z̈ = M_d⁻¹(w − 2ζ√(K M_d) ż − K z) along each axis.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

from dqcontrol.algebra.elementary import position, quaternion_product, set_pose
from dqcontrol.algebra.screws import half_angle, inverse_left_jacobian, left_jacobian
from dqcontrol.algebra.symmetric import cholesky, cholesky_solve, diagonalise
from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import NOT_FINITE, OK, READ, READ2, SINGULAR, STATUS, WRITE, inline, kernel
from dqcontrol.compiled.intrinsics import as_matrix, as_row
from dqcontrol.compiled.memory_layout import MemoryLayout
from dqcontrol.contact.admittance_step import cross, felt, turned, turning, unloaded
from dqcontrol.contact.contact_layout import BASE
from dqcontrol.robots.dynamics.rigid_bodies import (
    MOVED,
    RATES,
    fill_joint_forces,
    fill_mass_matrix,
    place_bodies,
)
from dqcontrol.robots.kinematics.kinematics_kernels import compose_fixed

_STUCK = 1e-9  # of the largest Ω²: a direction so heavy is one in which the arm cannot move

# bodies, parameters, rows q, q̇, q*, q̇*, wrench, torque, work
IMPEDANCE = STATUS(READ2, READ, READ2, READ, WRITE, WRITE)


class ImpedanceParameters(NamedTuple):
    """What the torque is prepared with; axes in the order φx φy φz x y z.

    Attributes
    ----------
    axes
        `REFERENCE` or `BASE`.
    carrier, end
        Row of the body that carries the end effector, and how: r (4), p (3).
    stiffness, mass
        K and M_d of each axis; no masses of its own where the first is 0.
    damping_ratio
        ζ.
    posture
        ω, rad/s.
    sensor, bias, tool_mass, tool_center, gravity
        As of `ContactParameters`.
    compensated
        Share of gravity that is in the torque.
    armature
        Inertia of the rotors, of each joint, kg m² or kg.
    """

    axes: float
    carrier: float
    end: Annotated[Array, 7]
    stiffness: Annotated[Array, 6]
    mass: Annotated[Array, 6]
    damping_ratio: float
    posture: float
    sensor: Annotated[Array, 7]
    bias: Annotated[Array, 6]
    tool_mass: float
    tool_center: Annotated[Array, 3]
    gravity: Annotated[Array, 3]
    compensated: float
    armature: Annotated[Array, ...]


class ImpedanceWork(NamedTuple):
    """What it finds, and scratch.

    Attributes
    ----------
    squares
        Ω² of each mode, (rad/s)².
    deflection
        z.
    hand, desired
        Poses of the end effector, as it is and as it is to be.
    """

    squares: Annotated[Array, 6]
    deflection: Annotated[Array, 6]
    hand: Annotated[Array, 8]
    desired: Annotated[Array, 8]
    wrench: Annotated[Array, 6]
    nothing: Annotated[Array, 6]
    speed: Annotated[Array, 6]
    asked: Annotated[Array, 6]
    along: Annotated[Array, 6]
    fall: Annotated[Array, 3]
    mass: Annotated[Array, "n", "n"]
    factor: Annotated[Array, "n", "n"]
    rows: Annotated[Array, 6, "n"]
    modes: Annotated[Array, 6, "n"]
    gram: Annotated[Array, 6, 6]
    vectors: Annotated[Array, 6, 6]
    rates: Annotated[Array, "n"]
    forces: Annotated[Array, "n"]
    column: Annotated[Array, "n"]
    bodies: Annotated[Array, ...]


impedance_parameters: MemoryLayout[ImpedanceParameters] = MemoryLayout(ImpedanceParameters)
impedance_work: MemoryLayout[ImpedanceWork] = MemoryLayout(ImpedanceWork, "n")


@inline
def _write_end(moved, given, out):
    """Write the pose of the end effector."""
    at = moved[int(given.carrier)]
    w, x, y, z, px, py, pz = compose_fixed(at[0], at[1], at[2], at[3], at[4], at[5], at[6], given.end)
    set_pose((w, x, y, z), (px, py, pz), out)


@inline
def _to_axes(given, desired, a, b, c):
    """Return a vector of the base frame along the axes of the springs."""
    if given.axes == BASE:
        return a, b, c
    return turned(desired[0], -desired[1], -desired[2], -desired[3], a, b, c)


@inline
def _write_deflection(given, room):
    """Write z of the poses."""
    r, d, z = room.hand, room.desired, room.deflection
    px, py, pz = position(r)
    x, y, w = position(d)
    if given.axes == BASE:
        quaternion_product((r[0], r[1], r[2], r[3]), (d[0], -d[1], -d[2], -d[3]), room.along)
    else:
        quaternion_product((d[0], -d[1], -d[2], -d[3]), (r[0], r[1], r[2], r[3]), room.along)
    if room.along[0] < 0.0:
        for i in range(4):
            room.along[i] = -room.along[i]
    half_angle(room.along, z)
    for i in range(3):
        z[i] *= 2.0
    z[3], z[4], z[5] = _to_axes(given, d, px - x, py - y, pz - w)


@inline
def _write_rows(bodies, moved, given, room):
    """Write T, whose columns are what joints move z by."""
    rows, place, z = room.rows, position(room.hand), room.deflection
    for i in range(6):
        for j in range(rows.shape[1]):
            rows[i, j] = 0.0
    turn = room.along[0:3]
    i = int(given.carrier)
    while i >= 0:
        at, j, scale = moved[i], int(bodies[i, 8]), bodies[i, 9]
        cx, cy, cz = cross(at[7], at[8], at[9], place[0], place[1], place[2])
        a, b, c = _to_axes(given, room.desired, at[7], at[8], at[9])
        inverse_left_jacobian(z, (a, b, c), turn)
        a, b, c = _to_axes(given, room.desired, at[10] + cx, at[11] + cy, at[12] + cz)
        for k in range(3):
            rows[k, j] += scale * turn[k]
        rows[3, j] += scale * a
        rows[4, j] += scale * b
        rows[5, j] += scale * c
        i = int(bodies[i, 11])


@inline
def _find_modes(given, room):
    """Write Ω², U, and X in place of √K T; return whether the mass matrix allows it."""
    rows, modes, gram, n = room.rows, room.modes, room.gram, room.mass.shape[0]
    for i in range(n):
        for j in range(n):
            room.factor[i, j] = room.mass[i, j]
    if not cholesky(room.factor, n):
        return False
    for i in range(6):
        for j in range(n):
            room.column[j] = rows[i, j]
        cholesky_solve(room.factor, n, room.column)
        for k in range(i, 6):
            total = 0.0
            for j in range(n):
                total += rows[k, j] * room.column[j]
            gram[k, i] = total * math.sqrt(given.stiffness[i] * given.stiffness[k])
    diagonalise(gram, 6, room.vectors)
    for i in range(6):
        room.squares[i] = gram[i, i]
        for j in range(n):
            total = 0.0
            for k in range(6):
                total += room.vectors[k, i] * math.sqrt(given.stiffness[k]) * rows[k, j]
            modes[i, j] = total
    return True


@inline
def _write_shaped(own, given, room):
    """Write z̈ as the masses of its own take it, less what bodies that move on at their rates would do."""
    place, z, speed, asked = position(room.hand), room.deflection, room.speed, room.asked
    for i in range(6):
        stiffness, mass = given.stiffness[i], given.mass[i]
        damping = 2.0 * given.damping_ratio * math.sqrt(stiffness * mass)
        asked[i] = (room.wrench[i] - damping * speed[i] - stiffness * z[i]) / mass
    _, _, _, dx, dy, dz = turning(z, speed, asked)
    wx, wy, wz = own[0], own[1], own[2]
    cx, cy, cz = cross(wx, wy, wz, place[0], place[1], place[2])
    ex, ey, ez = cross(wx, wy, wz, own[3] + cx, own[4] + cy, own[5] + cz)
    cx, cy, cz = cross(own[6], own[7], own[8], place[0], place[1], place[2])
    fall = room.fall
    hx, hy, hz = own[9] + fall[0] + cx + ex, own[10] + fall[1] + cy + ey, own[11] + fall[2] + cz + ez
    hx, hy, hz = _to_axes(given, room.desired, hx, hy, hz)
    ax, ay, az = _to_axes(given, room.desired, own[6], own[7], own[8])
    inverse_left_jacobian(z, (dx - ax, dy - ay, dz - az), asked)
    asked[3], asked[4], asked[5] = asked[3] - hx, asked[4] - hy, asked[5] - hz


@kernel(IMPEDANCE)
def impedance_torque(bodies, parameters, motion, wrench, torque, work):
    """Write the torque of all joints, N·m or N."""
    n, count = torque.shape[0], bodies.shape[0]
    given, room = impedance_parameters(parameters), impedance_work(work, n)
    q, rates, target, leads = motion[0], motion[1], motion[2], motion[3]
    at = (count + 3) // 4 * 12  # where functions of bodies keep poses, and twists with their rates
    moved = as_matrix(as_row(room.bodies, at, MOVED * count), count, MOVED)
    moving = as_row(room.bodies, at + MOVED * count + RATES * int(given.carrier), RATES)
    place_bodies(bodies, target, moved, room.bodies)
    _write_end(moved, given, room.desired)
    status = fill_mass_matrix(bodies, q, room.mass, room.bodies)
    if status != OK:
        return status
    for i in range(n):
        room.mass[i, i] += given.armature[i]
    _write_end(moved, given, room.hand)
    _write_deflection(given, room)
    _write_rows(bodies, moved, given, room)
    if not _find_modes(given, room):
        return SINGULAR
    for i in range(3):
        room.fall[i] = given.compensated * given.gravity[i]
    shaped = given.mass[0] > 0.0
    for i in range(n):
        torque[i] = 0.0
    for part in range(1 if shaped else 3):
        # C(q, q̇) q̇* = ¼ [C(q, q̇ + q̇*)(q̇ + q̇*) − C(q, q̇ − q̇*)(q̇ − q̇*)]; the third are those at rest
        own, lead, weight = 1.0, 0.0, 1.0
        if not shaped and part < 2:
            lead = 1.0 - 2.0 * part
            weight = 0.25 * lead
        elif not shaped:
            own = 0.0
        for i in range(n):
            room.rates[i] = own * rates[i] + lead * leads[i]
        fill_joint_forces(bodies, q, room.rates, room.fall[0:0], room.fall, room.forces, room.bodies)
        for i in range(n):
            torque[i] += weight * room.forces[i]
    z, speed, asked, along, posture = room.deflection, room.speed, room.asked, room.along, given.posture
    for i in range(6):
        speed[i] = 0.0
        for j in range(n):
            speed[i] += room.rows[i, j] * (rates[j] - leads[j])
    for j in range(n):
        room.column[j] = posture * (posture * (target[j] - q[j]) + 2.0 * (leads[j] - rates[j]))
    if shaped:
        unloaded(room.hand, given, wrench, room.wrench)
        felt(room.hand, room.desired, given, room.nothing, room.wrench)
        back, moment = (-z[0], -z[1], -z[2]), (room.wrench[0], room.wrench[1], room.wrench[2])
        left_jacobian(back, moment, room.wrench)
        _write_shaped(moving, given, room)
    largest = 0.0
    for i in range(6):
        largest = max(largest, room.squares[i])
    for i in range(6):
        square, total = room.squares[i], 0.0
        moves = square > _STUCK * largest
        for k in range(6):
            total += room.vectors[k, i] * math.sqrt(given.stiffness[k]) * (asked[k] if shaped else z[k])
        if shaped:
            total = -total / square if moves else 0.0
        for j in range(n):
            if not moves:
                break
            if not shaped:
                more = 2.0 * given.damping_ratio / math.sqrt(square) * (rates[j] - leads[j])
                total += room.modes[i, j] * more
            total += room.modes[i, j] * room.column[j] / square
        along[i] = total
    check = 0.0
    for j in range(n):
        for k in range(n):
            torque[j] += room.mass[j, k] * room.column[k]
        for i in range(6):
            torque[j] -= room.modes[i, j] * along[i]
            if shaped:
                torque[j] -= room.rows[i, j] * room.wrench[i]
        check += 0.0 * torque[j]
    return OK if check == 0.0 else NOT_FINITE

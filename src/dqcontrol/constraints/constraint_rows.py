"""Rows of constraints, compiled: places of shapes, their distances, and how these change with the inputs."""

from __future__ import annotations

import math

from dqcontrol.compiled.compile import inline, shared
from dqcontrol.constraints.constraint_layout import (
    APART,
    AT_LEAST,
    AT_MOST,
    BALL,
    BY_TABLE,
    FROM,
    INSIDE,
    MOTION,
    PLACE,
    SIGHT,
    STRAIGHT,
    UNTIL,
    VELOCITY,
    screw_of,
)
from dqcontrol.geometry.distance_kernels import (
    ALONG,
    BOX,
    CENTER,
    CORE,
    CORNERS,
    FIRST_CORNER,
    HULL,
    KIND,
    NORMAL,
    OFFSET,
    PLANE,
    RADIUS,
    ROTATION,
    ROUND,
    SHAPE,
    find_distance,
)
from dqcontrol.robots.kinematics.kinematics_kernels import HEADING, REVOLUTE, call_chain, joint_frames, split
from dqcontrol.robots.kinematics.pose_task_kernels import place_tree

_AWAY = 1e6  # m: where shapes are while they are not there
_PARALLEL = 1e-9  # sine of an angle below which the plane in which it opens is unknown


@shared
def place_frames(chain, config, scene, placed):
    """Write rotation matrix and position of the base and of all joint frames at a configuration."""
    if scene.tree.shape[0] > 0:
        status = place_tree(scene.tree, config, placed.frames)
    else:
        status = joint_frames(chain, config, placed.frames)
    place = placed.places[0]
    for k in range(12):
        place[k] = 1.0 if k == 0 or k == 4 or k == 8 else 0.0
    for i in range(scene.carriers.shape[0] - 1):
        w, x, y, z = (
            placed.frames[8 * i],
            placed.frames[8 * i + 1],
            placed.frames[8 * i + 2],
            placed.frames[8 * i + 3],
        )
        a, b, c, d = (
            placed.frames[8 * i + 4],
            placed.frames[8 * i + 5],
            placed.frames[8 * i + 6],
            placed.frames[8 * i + 7],
        )
        place = placed.places[i + 1]
        place[0] = 1.0 - 2.0 * (y * y + z * z)
        place[1] = 2.0 * (x * y - w * z)
        place[2] = 2.0 * (x * z + w * y)
        place[3] = 2.0 * (x * y + w * z)
        place[4] = 1.0 - 2.0 * (x * x + z * z)
        place[5] = 2.0 * (y * z - w * x)
        place[6] = 2.0 * (x * z - w * y)
        place[7] = 2.0 * (y * z + w * x)
        place[8] = 1.0 - 2.0 * (x * x + y * y)
        place[9] = 2.0 * (-a * x + b * w - c * z + d * y)
        place[10] = 2.0 * (-a * y + b * z + c * w - d * x)
        place[11] = 2.0 * (-a * z - b * y + c * x + d * w)
    return status


@shared
def write_screws(kinematics, chain, config, scene, placed):
    """Write the screws that move the frames that `place_frames` placed."""
    if scene.tree.shape[0] > 0:
        write_tree_screws(config, scene, placed)
        return
    call_chain(kinematics, chain, config, placed.buffer)
    _, _, twists = split(placed.buffer)
    for i in range(6):
        for j in range(placed.screws.shape[1]):
            placed.screws[i, j] = twists[i, j]


@inline
def write_tree_screws(config, scene, placed):
    """Write the screws of a tree's joints, whose axes are the z axes of their frames."""
    screws = placed.screws
    for i in range(screws.shape[1]):
        place, kind = placed.places[i + 1], scene.tree[1 + i, 7]
        zx, zy, zz = place[2], place[5], place[8]
        px, py, pz = place[9], place[10], place[11]
        if kind == REVOLUTE:
            screws[0, i], screws[1, i], screws[2, i] = zx, zy, zz
            screws[3, i], screws[4, i], screws[5, i] = py * zz - pz * zy, pz * zx - px * zz, px * zy - py * zx
            continue
        if kind == HEADING:
            angle = config[int(screw_of(scene.screws[i]).heading)]
            c, s = math.cos(angle), math.sin(angle)
            zx, zy, zz = c * zx + s * place[0], c * zy + s * place[3], c * zz + s * place[6]
        screws[0, i], screws[1, i], screws[2, i] = 0.0, 0.0, 0.0
        screws[3, i], screws[4, i], screws[5, i] = zx, zy, zz


@inline
def turned(place, x, y, z):
    """Return a vector of a frame in the axes of the world."""
    return (
        place[0] * x + place[1] * y + place[2] * z,
        place[3] * x + place[4] * y + place[5] * z,
        place[6] * x + place[7] * y + place[8] * z,
    )


@inline
def _put(place, body, at, out, to):
    """Write a point of a frame in the world."""
    x, y, z = turned(place, body[at], body[at + 1], body[at + 2])
    out[to], out[to + 1], out[to + 2] = x + place[9], y + place[10], z + place[11]


@inline
def _away(body, time):
    """Return how far out of the way a shape is at a time."""
    return 0.0 if body[FROM] <= time and time < body[UNTIL] else _AWAY


@shared
def place_bodies(scene, placed, time):
    """Write the shapes of the robot where its frames are, and out of the way what no hand holds at a time."""
    for s in range(scene.bodies.shape[0]):
        body, out = scene.bodies[s, 1:], placed.world[s]
        place = placed.places[int(scene.bodies[s, 0])]
        if body[KIND] == ROUND:
            out[KIND], out[RADIUS], out[8], out[9] = ROUND, body[RADIUS], body[8], body[9]
            _put(place, body, CORE, out, CORE)
            out[5], out[6], out[7] = turned(place, body[5], body[6], body[7])
        else:  # a box
            out[0], out[1], out[2], out[3] = body[0], body[1], body[2], body[3]
            _put(place, body, CENTER, out, CENTER)
            for k in range(3):
                x, y, z = turned(place, body[ROTATION + k], body[ROTATION + 3 + k], body[ROTATION + 6 + k])
                out[ROTATION + k], out[ROTATION + 3 + k], out[ROTATION + 6 + k] = x, y, z
        _put(place, body, BALL, out, BALL)
        out[BALL + 3] = body[BALL + 3]
        away = _away(body, time)
        if away > 0.0:
            at = CORE if body[KIND] == ROUND else CENTER
            out[at + 2], out[BALL + 2] = out[at + 2] + away, out[BALL + 2] + away


@inline
def _shift(scene, at, sample, ahead, period):
    """Return how far what follows the table has moved, some time after a sample."""
    whole = int(ahead / period)
    row, rest = scene.table[min(max(sample + whole, 0), scene.table.shape[0] - 1)], ahead - whole * period
    return row[at] + rest * row[at + 3], row[at + 1] + rest * row[at + 4], row[at + 2] + rest * row[at + 5]


@shared
def place_obstacles(scene, placed, time, sample, ahead, span, period):
    """Write the obstacles where they are some time after a sample, and how they move in a span after that."""
    robot = scene.bodies.shape[0]
    for o in range(scene.obstacles.shape[0]):
        body, out, drift = scene.obstacles[o], placed.world[robot + o], placed.drift[o]
        for k in range(SHAPE + 4):
            out[k] = body[k]
        if body[KIND] == HULL:
            first = int(body[FIRST_CORNER])
            for k in range(first, first + 3 * int(body[CORNERS])):
                out[k] = body[k]
        for k in range(3):
            drift[k] = 0.0
        motion, x, y, z = body[MOTION], 0.0, 0.0, _away(body, time + ahead)
        if motion == 0.0 and z == 0.0:
            continue
        if motion == STRAIGHT:
            for k in range(3):
                drift[k] = body[VELOCITY + k]
            x, y, z = (time + ahead) * drift[0], (time + ahead) * drift[1], (time + ahead) * drift[2]
        elif motion == BY_TABLE:
            at = 6 * int(body[PLACE])
            x, y, z = _shift(scene, at, sample, ahead, period)
            a, b, c = _shift(scene, at, sample, ahead + span, period)
            drift[0], drift[1], drift[2] = (a - x) / span, (b - y) / span, (c - z) / span
        if body[KIND] == PLANE:
            out[OFFSET] += x * body[NORMAL] + y * body[NORMAL + 1] + z * body[NORMAL + 2]
        else:
            at = CENTER if body[KIND] == BOX or body[KIND] == HULL else CORE
            out[at], out[at + 1], out[at + 2] = out[at] + x, out[at + 1] + y, out[at + 2] + z
        out[BALL], out[BALL + 1], out[BALL + 2] = out[BALL] + x, out[BALL + 1] + y, out[BALL + 2] + z


@inline
def farther_than(placed, row):
    """Return a distance that two shapes are apart at least, by the balls around them."""
    a, b = placed.world[int(row.a)], placed.world[int(row.b)]
    if b[KIND] == PLANE:
        height = a[BALL] * b[NORMAL] + a[BALL + 1] * b[NORMAL + 1] + a[BALL + 2] * b[NORMAL + 2]
        return height - b[OFFSET] - a[BALL + 3]
    x, y, z = a[BALL] - b[BALL], a[BALL + 1] - b[BALL + 1], a[BALL + 2] - b[BALL + 2]
    return math.sqrt(x * x + y * y + z * z) - a[BALL + 3] - b[BALL + 3]


@inline
def _angle(ax, ay, az, bx, by, bz):
    """Return the angle between two unit vectors, and the unit vector about which it opens from b to a."""
    x, y, z = by * az - bz * ay, bz * ax - bx * az, bx * ay - by * ax
    sine = math.sqrt(x * x + y * y + z * z)
    cosine = ax * bx + ay * by + az * bz
    if sine > _PARALLEL:
        x, y, z = x / sine, y / sine, z / sine
    else:  # any that is across
        x, y, z = (0.0, bz, -by) if abs(bx) < 0.5 else (-bz, 0.0, bx)
        size = math.sqrt(x * x + y * y + z * z)
        x, y, z = x / size, y / size, z / size
    return math.atan2(sine, cosine), x, y, z


@inline
def _target(scene, placed, row):
    """Return camera axis, place, and the unit vector and distance to the target of a line of sight."""
    place = placed.places[int(row.a)]
    lx, ly, lz = turned(place, row.axis[0], row.axis[1], row.axis[2])
    px, py, pz = turned(place, row.other[0], row.other[1], row.other[2])
    px, py, pz = px + place[9], py + place[10], pz + place[11]
    target = placed.world[scene.bodies.shape[0] + int(row.b)]
    bx, by, bz = target[BALL] - px, target[BALL + 1] - py, target[BALL + 2] - pz
    far = max(math.sqrt(bx * bx + by * by + bz * bz), 1e-6)
    return lx, ly, lz, px, py, pz, bx / far, by / far, bz / far, far


@shared
def value_of(scene, placed, row):
    """Return a distance, or how much room an angle has, and write what was found about the pair."""
    if row.kind <= INSIDE:
        a, b = placed.world[int(row.a)], placed.world[int(row.b)]
        find_distance(a, b, placed.found)
        return placed.found[0] if row.kind == APART else -placed.found[0] - 2.0 * a[RADIUS]
    if row.kind <= AT_LEAST:
        lx, ly, lz = turned(placed.places[int(row.a)], row.axis[0], row.axis[1], row.axis[2])
        angle, _, _, _ = _angle(lx, ly, lz, row.other[0], row.other[1], row.other[2])
        return row.limit - angle if row.kind == AT_MOST else angle - row.limit
    lx, ly, lz, _, _, _, bx, by, bz, _ = _target(scene, placed, row)
    angle, _, _, _ = _angle(lx, ly, lz, bx, by, bz)
    return row.limit - angle


@inline
def _add_distance(joints, found, sign, screws, a, b, line):
    """Add ±(c × n, n)·J, + for what carries a alone, − for what carries b alone: screws on the way between both.

    The rate of a distance is the reciprocal product of the contact normal, as a line n + ε c × n, with the screws.
    """
    nx, ny, nz = found[1], found[2], found[3]
    mx = found[5] * nz - found[6] * ny
    my = found[6] * nx - found[4] * nz
    mz = found[4] * ny - found[5] * nx
    while a != b:
        side = sign if a > b else -sign
        k = max(a, b)
        screw = screw_of(joints[k])
        if a > b:
            a = int(screw.above)
        else:
            b = int(screw.above)
        if screw.input >= 0.0:
            line[int(screw.input)] += (
                screw.scale
                * side
                * (
                    mx * screws[0, k]
                    + my * screws[1, k]
                    + mz * screws[2, k]
                    + nx * screws[3, k]
                    + ny * screws[4, k]
                    + nz * screws[5, k]
                )
            )


@inline
def _twist_of(joints, screws, k, u):
    """Return the twist [ω ; ṗ + p × ω] that inputs give what joint k carries."""
    a, b, c, x, y, z = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    while k >= 0:
        screw = screw_of(joints[k])
        if screw.input >= 0.0:
            rate = screw.scale * u[int(screw.input)]
            a, b, c = a + screws[0, k] * rate, b + screws[1, k] * rate, c + screws[2, k] * rate
            x, y, z = x + screws[3, k] * rate, y + screws[4, k] * rate, z + screws[5, k] * rate
        k = int(screw.above)
    return a, b, c, x, y, z


@inline
def _cut_of_angle(joints, screws, k, nx, ny, nz, px, py, pz, tx, ty, tz, line):
    """Add −n·ω − t·(v − v_target) of what the inputs do to what joint k carries, with something at p."""
    mx, my, mz = py * tz - pz * ty, pz * tx - px * tz, px * ty - py * tx
    while k >= 0:
        screw = screw_of(joints[k])
        if screw.input >= 0.0:
            turn = -(nx + mx) * screws[0, k] - (ny + my) * screws[1, k] - (nz + mz) * screws[2, k]
            move = tx * screws[3, k] + ty * screws[4, k] + tz * screws[5, k]
            line[int(screw.input)] += screw.scale * (turn - move)
        k = int(screw.above)


@shared
def write_line(scene, placed, row, screws, line):
    """Write how the inputs change the value, as last found by `value_of`; return how it changes by itself."""
    for j in range(line.shape[0]):
        line[j] = 0.0
    first = scene.bodies.shape[0]
    if row.kind <= INSIDE:
        sign = 1.0 if row.kind == APART else -1.0
        a, b = int(row.a), int(row.b)
        mine, other = int(scene.carriers[int(scene.bodies[a, 0])]), -1
        drift = 0.0
        if b < first:
            other = int(scene.carriers[int(scene.bodies[b, 0])])
        _add_distance(scene.screws, placed.found, sign, screws, mine, other, line)
        if b >= first:
            moves = placed.drift[b - first]
            for k in range(3):
                drift -= sign * placed.found[1 + k] * moves[k]
        return drift
    k = int(scene.carriers[int(row.a)])
    if row.kind <= AT_LEAST:
        lx, ly, lz = turned(placed.places[int(row.a)], row.axis[0], row.axis[1], row.axis[2])
        _, nx, ny, nz = _angle(lx, ly, lz, row.other[0], row.other[1], row.other[2])
        sign = -1.0 if row.kind == AT_MOST else 1.0
        while k >= 0:
            screw = screw_of(scene.screws[k])
            if screw.input >= 0.0:
                turn = nx * screws[0, k] + ny * screws[1, k] + nz * screws[2, k]
                line[int(screw.input)] += screw.scale * (sign * turn)
            k = int(screw.above)
        return 0.0
    lx, ly, lz, px, py, pz, bx, by, bz, far = _target(scene, placed, row)
    _, nx, ny, nz = _angle(lx, ly, lz, bx, by, bz)
    # t: direction in which b turns towards l; φ̇ = n·ω − t·(v_target − v_camera)
    tx, ty, tz = (ny * bz - nz * by) / far, (nz * bx - nx * bz) / far, (nx * by - ny * bx) / far
    _cut_of_angle(scene.screws, screws, k, nx, ny, nz, px, py, pz, tx, ty, tz, line)
    moves = placed.drift[int(row.b)]
    return tx * moves[0] + ty * moves[1] + tz * moves[2]


@shared
def look_ahead(scene, placed, row, value, u, span, line):
    """Return what the room inside of something becomes if the motion goes on for a span, and write how u changes it.

    The wall that a motion is heading for is another one than the nearest, which changes where the middle is crossed:
    too late to brake before it. Its room is that of a straight motion, of angles in the plane that touches the sphere.
    `value` is what `value_of` has just found.
    """
    for j in range(line.shape[0]):
        line[j] = 0.0
    screws = placed.first_screws
    if row.kind == INSIDE:
        a, b = placed.world[int(row.a)], placed.world[int(row.b)]
        k = int(scene.carriers[int(scene.bodies[int(row.a), 0])])
        wx, wy, wz, vx, vy, vz = _twist_of(scene.screws, screws, k, u)
        cx, cy, cz = a[CORE], a[CORE + 1], a[CORE + 2]
        vx, vy, vz = vx + wy * cz - wz * cy, vy + wz * cx - wx * cz, vz + wx * cy - wy * cx
        along = vx * b[ALONG] + vy * b[ALONG + 1] + vz * b[ALONG + 2]
        vx, vy, vz = vx - along * b[ALONG], vy - along * b[ALONG + 1], vz - along * b[ALONG + 2]
        out = placed.found[0] + a[RADIUS] + b[RADIUS]  # from the middle
        x, y, z = (
            out * placed.found[1] + span * vx,
            out * placed.found[2] + span * vy,
            out * placed.found[3] + span * vz,
        )
        far = math.sqrt(x * x + y * y + z * z)
        if far > 0.0:
            for i, number in enumerate((x / far, y / far, z / far, cx, cy, cz)):
                placed.found[1 + i] = number
        _add_distance(scene.screws, placed.found, -1.0, screws, k, -1, line)
        return value + out - far
    k = int(scene.carriers[int(row.a)])
    wx, wy, wz, vx, vy, vz = _twist_of(scene.screws, screws, k, u)
    if row.kind == SIGHT:
        lx, ly, lz, px, py, pz, bx, by, bz, far = _target(scene, placed, row)
        moves = placed.drift[int(row.b)]
        vx, vy, vz = vx + wy * pz - wz * py, vy + wz * px - wx * pz, vz + wx * py - wy * px
        vx, vy, vz = (vx - moves[0]) / far, (vy - moves[1]) / far, (vz - moves[2]) / far
        # the way to the target turns with −b × (v_camera − v_target)/far
        wx, wy, wz = wx + by * vz - bz * vy, wy + bz * vx - bx * vz, wz + bx * vy - by * vx
    else:
        lx, ly, lz = turned(placed.places[int(row.a)], row.axis[0], row.axis[1], row.axis[2])
        px, py, pz, far = 0.0, 0.0, 0.0, math.inf
        bx, by, bz = row.other[0], row.other[1], row.other[2]
    angle, nx, ny, nz = _angle(lx, ly, lz, bx, by, bz)
    spin = wx * lx + wy * ly + wz * lz
    x = angle * nx + span * (wx - spin * lx)
    y = angle * ny + span * (wy - spin * ly)
    z = angle * nz + span * (wz - spin * lz)
    size = math.sqrt(x * x + y * y + z * z)
    if size > 0.0:
        nx, ny, nz = x / size, y / size, z / size
    tx, ty, tz = (ny * bz - nz * by) / far, (nz * bx - nx * bz) / far, (nx * by - ny * bx) / far
    _cut_of_angle(scene.screws, screws, k, nx, ny, nz, px, py, pz, tx, ty, tz, line)
    return row.limit - size


@inline
def curvature(levers, u):
    """Return how large the second derivative of a row can be while the inputs are constant.

    Of a point of a link p̈ = Σ uᵢ uⱼ z_min × J_max, at most Σ lever_max |uᵢ||uⱼ|; a distance to what is convex curves
    no less, and so does the least over a link's points.
    """
    total, before = 0.0, 0.0
    for j in range(u.shape[0]):
        size = abs(u[j])
        total += levers[j] * size * (size + 2.0 * before)
        before += size
    return total


@inline
def _speed_of_core(scene, placed, row, screws, step):
    """Return how fast points of the core of shape a move at most, as seen from what carries shape b."""
    a, b = int(row.a), int(row.b)
    wx, wy, wz, vx, vy, vz = _twist_of(
        scene.screws, screws, int(scene.carriers[int(scene.bodies[a, 0])]), step
    )
    if b < scene.bodies.shape[0]:
        carrier = int(scene.carriers[int(scene.bodies[b, 0])])
        ox, oy, oz, px, py, pz = _twist_of(scene.screws, screws, carrier, step)
        wx, wy, wz, vx, vy, vz = wx - ox, wy - oy, wz - oz, vx - px, vy - py, vz - pz
    shape = placed.world[a]
    x, y, z = shape[BALL], shape[BALL + 1], shape[BALL + 2]
    vx, vy, vz = vx + wy * z - wz * y, vy + wz * x - wx * z, vz + wx * y - wy * x
    half = shape[BALL + 3] - (shape[RADIUS] if shape[KIND] == ROUND else 0.0)
    return math.sqrt(vx * vx + vy * vy + vz * vz) + half * math.sqrt(wx * wx + wy * wy + wz * wz)


@shared
def dip_between(scene, placed, path, row, levers, screws, span):
    """Return how much less a value may be on the way from one point to the next than on the line between both values.

    A distance d between cores that are ρ apart curves upwards by d̈ ≤ κ + v²/ρ at most, and is above the line less an
    eighth of that; joints off the straight line to the next point take their levers' share.
    """
    bow = curvature(levers, path.reach)
    speed, off = 0.0, 0.0
    for j in range(levers.shape[0]):
        speed += levers[j] * path.reach[j]
        off += levers[j] * path.off[j]
    if row.bend > 0.0 and row.kind == APART:
        known = 0.0
        for j in range(levers.shape[0]):
            known += levers[j] * abs(path.step[j])
        moving = 0.0
        if row.b >= scene.bodies.shape[0]:
            drift = placed.drift[int(row.b) - scene.bodies.shape[0]]
            moving = span * math.sqrt(drift[0] ** 2 + drift[1] ** 2 + drift[2] ** 2)
        speed += min(_speed_of_core(scene, placed, row, screws, path.step) + bow - known, 0.0) + moving
    return 0.125 * (bow + row.bend * speed * speed) + off

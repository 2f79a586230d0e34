"""Signed distances between shapes, compiled.

A shape is a row of 16 numbers; the first is its kind. Spheres, capsules, cylinders, points and lines are *round*: all
points within a radius of a core p + s d with s from `FIRST` to `LAST` (point: 0 to 0; segment: 0 to 1; line: −∞ to ∞).
Planes, boxes, finite cylinders and hulls of points are the other kinds; a hull's corners stand behind its 16.

What is found about a pair is a row of 10: the signed distance of the surfaces, the unit normal n from b to a, and the
point on a and on b. Both points, and those of the cores, lie on one line along n, so that for any motion of the two
ḋ = n·(v_a − v_b), with the velocities of the points of either body that are at any point of this line: the derivative
of a least value is that of what is minimised, where it is (Danskin).

Distances of a finite cylinder, or a hull, and another convex shape are found by their support points. Apart: Gilbert,
Johnson and Keerthi (1988), on the difference A − B of the two. In each other: the expanding polytope of van den Bergen
(2001), which starts from any tetrahedron of support points and grows around the origin. Both end where no support point
lies farther than `_EXACT` beyond what is known. Coal, from which such distances could come, is called from Python,
allocates, and of shapes in each other its search fails in one of 60 pairs.
"""

from __future__ import annotations

import math

from dqcontrol.compiled.compile import READ, READ2, STATUS, WRITE, WRITE2, inline, kernel, shared
from dqcontrol.compiled.intrinsics import stack_array

KIND = 0
ROUND, PLANE, BOX, CYLINDER, HULL = 0.0, 1.0, 2.0, 3.0, 4.0
# of round shapes, and of cylinders, whose core is the axis from end to end
RADIUS, CORE, ALONG, FIRST, LAST = 1, 2, 5, 8, 9
# of planes
OFFSET, NORMAL = 1, 2
# of boxes: half sizes, centre, and the rotation matrix, row by row
HALF, CENTER, ROTATION = 1, 4, 7
# of hulls, with centre and rotation as of boxes: where in the row their corners begin, in their own axes, how many
# these are, and how far the farthest is from the centre
FIRST_CORNER, CORNERS, EXTENT = 1, 2, 3
SHAPE = 16  # without the corners of hulls

DISTANCE, DIRECTION, ON_A, ON_B = 0, 1, 4, 7
FOUND = 10


_EXACT = 1e-10  # m
_FLAT = 1e-13  # of a triangle's sides squared: below it three points are on one line
_ALONG_AXIS = 1e-24  # square of the sine below which a direction is along the axis
_SEEN = 1e-12  # m above a face from which it is seen: not by rounding
_STEPS = 128  # of either search; the polytope of two discs takes about 80
_POINT = 6  # numbers: a point of A − B, and that of A
_CORNERS = _STEPS + 4
_FACE = 7  # numbers: three corners, outward normal, distance from the origin
_FACES = 2 * _CORNERS
_SIMPLEX = 5 * _POINT
_points = stack_array(_CORNERS * _POINT)
_polytope = stack_array(_FACES * _FACE)
_rim = stack_array(2 * _FACES)
_simplex = stack_array(_SIMPLEX + 4)

_TOUCHING = 1e-12  # m; nearer than this cores count as crossing, as their difference has no direction
_PARALLEL = 1e-14  # square of the sine below which no pair inside two segments is looked for
_ILL = 1e-3  # square of the sine below which that pair is computed a second time, from its residual


@inline
def _gap(rx, ry, rz, dx, dy, dz, ex, ey, ez, s, t):
    """Return |r + s d − t e|²."""
    x, y, z = rx + s * dx - t * ex, ry + s * dy - t * ey, rz + s * dz - t * ez
    return x * x + y * y + z * z


@inline
def _clamp(value, low, high):
    return min(max(value, low), high)


@inline
def nearest_parameters(rx, ry, rz, dx, dy, dz, low, high, ex, ey, ez, first, last):
    """Return s in [low, high] and t in [first, last] that minimise |r + s d − t e|, r the difference of the origins.

    The pair inside both, if it is inside; else the least of the four from an end of one to the other. No tolerance
    decides between parallel and not: where the inner pair is too uncertain, the ends are as near as it.
    """
    dd, ee = dx * dx + dy * dy + dz * dz, ex * ex + ey * ey + ez * ez
    de = dx * ex + dy * ey + dz * ez
    dr, er = dx * rx + dy * ry + dz * rz, ex * rx + ey * ry + ez * rz
    determinant = dd * ee - de * de
    best, best_s, best_t = math.inf, 0.0, 0.0
    if determinant > _PARALLEL * dd * ee:
        scale = 1.0 / determinant
        s, t = (de * er - dr * ee) * scale, (dd * er - de * dr) * scale
        if determinant > _ILL * dd * ee:
            if low <= s <= high and first <= t <= last:
                return s, t
        else:
            x, y, z = rx + s * dx - t * ex, ry + s * dy - t * ey, rz + s * dz - t * ez
            u, v = dx * x + dy * y + dz * z, ex * x + ey * y + ez * z
            s, t = s + (de * v - u * ee) * scale, t + (dd * v - de * u) * scale
            if low <= s <= high and first <= t <= last:
                best, best_s, best_t = _gap(rx, ry, rz, dx, dy, dz, ex, ey, ez, s, t), s, t
    per_d, per_e = 1.0 / dd if dd > 0.0 else 0.0, 1.0 / ee if ee > 0.0 else 0.0
    if low == -math.inf:
        if first == -math.inf and best == math.inf:  # parallel lines: any pair across
            return 0.0, er * per_e
    else:
        s = low
        t = _clamp((er + s * de) * per_e, first, last)
        gap = _gap(rx, ry, rz, dx, dy, dz, ex, ey, ez, s, t)
        if gap < best:
            best, best_s, best_t = gap, s, t
        s = high
        t = _clamp((er + s * de) * per_e, first, last)
        gap = _gap(rx, ry, rz, dx, dy, dz, ex, ey, ez, s, t)
        if gap < best:
            best, best_s, best_t = gap, s, t
    if first != -math.inf:
        t = first
        s = _clamp((t * de - dr) * per_d, low, high)
        gap = _gap(rx, ry, rz, dx, dy, dz, ex, ey, ez, s, t)
        if gap < best:
            best, best_s, best_t = gap, s, t
        t = last
        s = _clamp((t * de - dr) * per_d, low, high)
        gap = _gap(rx, ry, rz, dx, dy, dz, ex, ey, ez, s, t)
        if gap < best:
            best, best_s, best_t = gap, s, t
    return best_s, best_t


@inline
def _unit(x, y, z):
    scale = 1.0 / math.sqrt(x * x + y * y + z * z)
    return x * scale, y * scale, z * scale


@inline
def _perpendicular(x, y, z):
    """Return a unit vector across another, chosen by its least component."""
    if abs(x) <= abs(y) and abs(x) <= abs(z):
        return _unit(0.0, z, -y)
    if abs(y) <= abs(z):
        return _unit(-z, 0.0, x)
    return _unit(y, -x, 0.0)


@inline
def _middle(low, high):
    """Return the parameter of a core's middle; of a line that of its given point."""
    return 0.5 * (low + high) if high - low < math.inf else 0.0


@shared
def _crossing_normal(a, b):
    """Return the normal where cores cross: across both, or across the one that is not a point, away from b's middle."""
    dx, dy, dz, ex, ey, ez = a[5], a[6], a[7], b[5], b[6], b[7]
    dd, ee = dx * dx + dy * dy + dz * dz, ex * ex + ey * ey + ez * ez
    cx, cy, cz = dy * ez - dz * ey, dz * ex - dx * ez, dx * ey - dy * ex
    if cx * cx + cy * cy + cz * cz > 1e-20 * dd * ee and dd * ee > 0.0:
        nx, ny, nz = _unit(cx, cy, cz)
    elif dd > 0.0 and dd >= ee:
        nx, ny, nz = _perpendicular(dx, dy, dz)
    elif ee > 0.0:
        nx, ny, nz = _perpendicular(ex, ey, ez)
    else:
        nx, ny, nz = 0.0, 0.0, 1.0
    s, t = _middle(a[FIRST], a[LAST]), _middle(b[FIRST], b[LAST])
    along = nx * (a[2] + s * dx - b[2] - t * ex)
    along += ny * (a[3] + s * dy - b[3] - t * ey)
    along += nz * (a[4] + s * dz - b[4] - t * ez)
    return (-nx, -ny, -nz) if along < 0.0 else (nx, ny, nz)


@inline
def _store(out, distance, normal, on_a, on_b):
    out[0] = distance
    for k in range(3):
        out[1 + k], out[4 + k], out[7 + k] = normal[k], on_a[k], on_b[k]


@inline
def round_round(a, b, out):
    """Find the distance of two round shapes; exact in penetration too, as the difference of two cores has no inside."""
    dx, dy, dz, ex, ey, ez = a[5], a[6], a[7], b[5], b[6], b[7]
    rx, ry, rz = a[2] - b[2], a[3] - b[3], a[4] - b[4]
    s, t = nearest_parameters(rx, ry, rz, dx, dy, dz, a[FIRST], a[LAST], ex, ey, ez, b[FIRST], b[LAST])
    x, y, z = rx + s * dx - t * ex, ry + s * dy - t * ey, rz + s * dz - t * ez
    gap = math.sqrt(x * x + y * y + z * z)
    if gap > _TOUCHING:
        scale = 1.0 / gap
        nx, ny, nz = x * scale, y * scale, z * scale
    else:
        nx, ny, nz = _crossing_normal(a, b)
    ra, rb = a[RADIUS], b[RADIUS]
    on_a = (a[2] + s * dx - ra * nx, a[3] + s * dy - ra * ny, a[4] + s * dz - ra * nz)
    on_b = (b[2] + t * ex + rb * nx, b[3] + t * ey + rb * ny, b[4] + t * ez + rb * nz)
    _store(out, gap - ra - rb, (nx, ny, nz), on_a, on_b)


@shared
def _round_plane(a, b, out):
    """Find the distance of a round shape and a plane: that of its lowest end. A line that crosses it: −∞."""
    nx, ny, nz = b[NORMAL], b[NORMAL + 1], b[NORMAL + 2]
    slope = nx * a[5] + ny * a[6] + nz * a[7]
    height = nx * a[2] + ny * a[3] + nz * a[4] - b[OFFSET]
    s = a[LAST] if slope < 0.0 else a[FIRST]
    if abs(s) == math.inf:
        s = 0.0 if abs(slope) <= _TOUCHING else -height / slope
        height = height if abs(slope) <= _TOUCHING else -math.inf
    else:
        height += s * slope
    x, y, z = a[2] + s * a[5], a[3] + s * a[6], a[4] + s * a[7]
    depth = height if height > -math.inf else 0.0
    _write(out, height - a[RADIUS], nx, ny, nz, x, y, z, a[RADIUS], 0.0, depth)


@inline
def _excess(x, half):
    """Return how far a coordinate is outside a box, with its sign; 0 inside."""
    return x - half if x > half else (x + half if x < -half else 0.0)


@inline
def _slope(s, p, d, h):
    """Return half the derivative by s of the square of the distance of p + s d from a box with half sizes h."""
    total = 0.0
    for k in range(3):
        total += d[k] * _excess(p[k] + s * d[k], h[k])
    return total


@shared
def _nearest_to_box(p, d, low, high, h):
    """Return the s in [low, high] where p + s d is nearest to a box about the origin, and the distance there.

    The square of the distance is convex, with a derivative that is linear between the crossings of the six planes of
    the faces. Where many are nearest, that is their middle.
    """
    first, last = math.inf, -math.inf  # crossings that are nearest themselves
    for sign in (-1.0, 1.0):
        for k in range(3):
            if d[k] != 0.0:
                s = (sign * h[k] - p[k]) / d[k]
                if low < s < high:
                    slope = _slope(s, p, d, h)
                    if slope > 0.0:
                        high = s
                    elif slope < 0.0:
                        low = s
                    else:
                        first, last = min(first, s), max(last, s)
    left, right = _slope(low, p, d, h), _slope(high, p, d, h)
    if first <= last:
        s = 0.5 * (first + last)
    elif left >= 0.0 and right > 0.0:
        s = low
    elif left < 0.0 and right <= 0.0:
        s = high
    elif right > left:
        s = low + (high - low) * (-left / (right - left))
    else:
        s = 0.5 * (low + high)
    square = 0.0
    for k in range(3):
        square += _excess(p[k] + s * d[k], h[k]) ** 2
    return s, math.sqrt(square)


@inline
def _to_box(box, x, y, z):
    """Return a vector in the axes of a box or hull."""
    return (
        box[7] * x + box[10] * y + box[13] * z,
        box[8] * x + box[11] * y + box[14] * z,
        box[9] * x + box[12] * y + box[15] * z,
    )


@inline
def _from_box(box, x, y, z):
    """Return a vector of the axes of a box in those of the world."""
    return (
        box[7] * x + box[8] * y + box[9] * z,
        box[10] * x + box[11] * y + box[12] * z,
        box[13] * x + box[14] * y + box[15] * z,
    )


@inline
def _cross_axis(d, k):
    """Return d × e_k."""
    if k == 0:
        return 0.0, d[2], -d[1]
    if k == 1:
        return -d[2], 0.0, d[0]
    return d[1], -d[0], 0.0


@shared
def _leaving_box(p, d, low, high, h):
    """Return depth, normal, s and the point of the box along which a segment that meets a box leaves it soonest.

    Of box minus segment, a solid with up to twelve faces, the nearest face: three pairs of the box's, and three that a
    box edge and the segment span. On the latter the witnesses are the closest pair of the two edges, not an end.
    """
    depth, best, s_best = math.inf, (0.0, 0.0, 1.0), low
    edge = -1
    for k in range(3):
        first, last = p[k] + low * d[k], p[k] + high * d[k]
        for sign in (1.0, -1.0):
            s = low if sign * first <= sign * last else high
            found = h[k] - min(sign * first, sign * last)
            if found < depth:
                depth, s_best = found, s
                best = (sign if k == 0 else 0.0, sign if k == 1 else 0.0, sign if k == 2 else 0.0)
    length = math.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
    for k in range(3):
        x, y, z = _cross_axis(d, k)
        size = math.sqrt(x * x + y * y + z * z)
        if size <= 1e-9 * length or length == 0.0:
            continue
        x, y, z = x / size, y / size, z / size
        at = x * p[0] + y * p[1] + z * p[2]  # the same for the whole segment
        if at < 0.0:
            x, y, z, at = -x, -y, -z, -at
        found = h[0] * abs(x) + h[1] * abs(y) + h[2] * abs(z) - at
        if found < depth:
            depth, best, edge = found, (x, y, z), k
    x, y, z = best
    if edge >= 0:
        qx = math.copysign(h[0], x) if edge != 0 else -h[0]
        qy = math.copysign(h[1], y) if edge != 1 else -h[1]
        qz = math.copysign(h[2], z) if edge != 2 else -h[2]
        ex = 2.0 * h[0] if edge == 0 else 0.0
        ey = 2.0 * h[1] if edge == 1 else 0.0
        ez = 2.0 * h[2] if edge == 2 else 0.0
        s_best, _ = nearest_parameters(
            p[0] - qx, p[1] - qy, p[2] - qz, d[0], d[1], d[2], low, high, ex, ey, ez, 0.0, 1.0
        )
    cx, cy, cz = p[0] + s_best * d[0], p[1] + s_best * d[1], p[2] + s_best * d[2]
    return depth, best, (cx, cy, cz), (cx + depth * x, cy + depth * y, cz + depth * z)


@shared
def _round_box(a, b, out):
    """Find the distance of a round shape and a box."""
    h = (b[1], b[2], b[3])
    p = _to_box(b, a[2] - b[4], a[3] - b[5], a[4] - b[6])
    d = _to_box(b, a[5], a[6], a[7])
    low, high = a[FIRST], a[LAST]
    if high == math.inf:  # of a line only what is beside the box can be nearest
        foot = -(p[0] * d[0] + p[1] * d[1] + p[2] * d[2])
        far = math.sqrt(h[0] * h[0] + h[1] * h[1] + h[2] * h[2])
        low, high = foot - far, foot + far
    s, gap = _nearest_to_box(p, d, low, high, h)
    if gap > _TOUCHING:
        c = (p[0] + s * d[0], p[1] + s * d[1], p[2] + s * d[2])
        q = (_clamp(c[0], -h[0], h[0]), _clamp(c[1], -h[1], h[1]), _clamp(c[2], -h[2], h[2]))
        n = ((c[0] - q[0]) / gap, (c[1] - q[1]) / gap, (c[2] - q[2]) / gap)
    else:
        gap, n, c, q = _leaving_box(p, d, low, high, h)
        gap = -gap
    nx, ny, nz = _from_box(b, n[0], n[1], n[2])
    x, y, z = _from_box(b, c[0], c[1], c[2])
    u, v, w = _from_box(b, q[0], q[1], q[2])
    r = a[RADIUS]
    on_a = (b[4] + x - r * nx, b[5] + y - r * ny, b[6] + z - r * nz)
    _store(out, gap - r, (nx, ny, nz), on_a, (b[4] + u, b[5] + v, b[6] + w))


@shared
def _box_plane(a, b, out):
    """Find the distance of a box and a plane: that of the lowest corner, edge's or face's middle."""
    n = (b[NORMAL], b[NORMAL + 1], b[NORMAL + 2])
    m = _to_box(a, n[0], n[1], n[2])
    low = (
        0.0 if abs(m[0]) <= _TOUCHING else -math.copysign(a[1], m[0]),
        0.0 if abs(m[1]) <= _TOUCHING else -math.copysign(a[2], m[1]),
        0.0 if abs(m[2]) <= _TOUCHING else -math.copysign(a[3], m[2]),
    )
    x, y, z = _from_box(a, low[0], low[1], low[2])
    x, y, z = x + a[4], y + a[5], z + a[6]
    height = n[0] * x + n[1] * y + n[2] * z - b[OFFSET]
    _write(out, height, n[0], n[1], n[2], x, y, z, 0.0, 0.0, height)


@inline
def _edge_of_box(box, number):
    """Return the middle of one of the twelve edges of a box, and half of it, both from the world's origin."""
    axis, first, second = number // 4, 1.0 - 2.0 * (number & 1), 1.0 - (number & 2)
    x = first * box[1] if axis != 0 else 0.0
    y = (first if axis == 0 else second) * box[2] if axis != 1 else 0.0
    z = second * box[3] if axis != 2 else 0.0
    middle = _from_box(box, x, y, z)
    x, y, z = box[1] if axis == 0 else 0.0, box[2] if axis == 1 else 0.0, box[3] if axis == 2 else 0.0
    half = _from_box(box, x, y, z)
    return (box[4] + middle[0], box[5] + middle[1], box[6] + middle[2]), half


@inline
def _extent(box, x, y, z):
    """Return how far a box reaches from its centre along a unit vector."""
    m = _to_box(box, x, y, z)
    return box[1] * abs(m[0]) + box[2] * abs(m[1]) + box[3] * abs(m[2])


@inline
def _axis_of_boxes(a, b, number):
    """Return the direction of one of the fifteen pairs of faces of box minus box; zero where two edges are parallel."""
    if number < 3:
        return a[7 + number], a[10 + number], a[13 + number]
    if number < 6:
        return b[4 + number], b[7 + number], b[10 + number]
    i, j = (number - 6) // 3, (number - 6) % 3
    ax, ay, az, bx, by, bz = a[7 + i], a[10 + i], a[13 + i], b[7 + j], b[10 + j], b[13 + j]
    x, y, z = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    size = math.sqrt(x * x + y * y + z * z)
    if size <= 1e-9:
        return 0.0, 0.0, 0.0
    return x / size, y / size, z / size


@inline
def _corner(box, x, y, z, axis):
    """Return the corner of a box that lies farthest along a vector; the middle of an edge along an axis ≥ 0."""
    m = _to_box(box, x, y, z)
    u, v, w = _from_box(
        box,
        0.0 if axis == 0 or abs(m[0]) <= _TOUCHING else math.copysign(box[1], m[0]),
        0.0 if axis == 1 or abs(m[1]) <= _TOUCHING else math.copysign(box[2], m[1]),
        0.0 if axis == 2 or abs(m[2]) <= _TOUCHING else math.copysign(box[3], m[2]),
    )
    return box[4] + u, box[5] + v, box[6] + w


@shared
def _box_box(a, b, out):
    """Find the distance of two boxes: of the edges of each from the other, or of the nearest face of their difference.

    Where they are apart, the closest pair holds a point of an edge. Where not, the depth is least over the directions
    of six faces and of nine pairs of edges.
    """
    x, y, z = a[4] - b[4], a[5] - b[5], a[6] - b[6]
    depth, number = math.inf, 0
    for k in range(15):
        u, v, w = _axis_of_boxes(a, b, k)
        if u != 0.0 or v != 0.0 or w != 0.0:
            found = _extent(a, u, v, w) + _extent(b, u, v, w) - abs(u * x + v * y + w * z)
            if found < depth - (1e-12 if k >= 6 else 0.0):
                depth, number = found, k
    if depth < 0.0:
        _boxes_apart(a, b, out)
        return
    u, v, w = _axis_of_boxes(a, b, number)
    if u * x + v * y + w * z < 0.0:
        u, v, w = -u, -v, -w
    if number >= 6:  # closest points of the two edges that lie deepest
        i, j = (number - 6) // 3, (number - 6) % 3
        px, py, pz = _corner(a, -u, -v, -w, i)
        qx, qy, qz = _corner(b, u, v, w, j)
        dx, dy, dz = a[7 + i] * a[1 + i], a[10 + i] * a[1 + i], a[13 + i] * a[1 + i]
        ex, ey, ez = b[7 + j] * b[1 + j], b[10 + j] * b[1 + j], b[13 + j] * b[1 + j]
        s, _ = nearest_parameters(px - qx, py - qy, pz - qz, dx, dy, dz, -1.0, 1.0, ex, ey, ez, -1.0, 1.0)
        px, py, pz = px + s * dx, py + s * dy, pz + s * dz
    elif number >= 3:  # a face of b: the deepest corner of a
        px, py, pz = _corner(a, -u, -v, -w, -1)
    else:
        qx, qy, qz = _corner(b, u, v, w, -1)
        px, py, pz = qx - depth * u, qy - depth * v, qz - depth * w
    _write(out, -depth, u, v, w, px, py, pz, 0.0, 0.0, -depth)


@shared
def _boxes_apart(a, b, out):
    best = math.inf
    for side in range(2):
        edged, other = (a, b) if side == 0 else (b, a)
        h = (other[1], other[2], other[3])
        for number in range(12):
            middle, half = _edge_of_box(edged, number)
            p = _to_box(other, middle[0] - other[4], middle[1] - other[5], middle[2] - other[6])
            d = _to_box(other, half[0], half[1], half[2])
            s, gap = _nearest_to_box(p, d, -1.0, 1.0, h)
            if gap < best:
                best = gap
                cx, cy, cz = p[0] + s * d[0], p[1] + s * d[1], p[2] + s * d[2]
                qx, qy, qz = _clamp(cx, -h[0], h[0]), _clamp(cy, -h[1], h[1]), _clamp(cz, -h[2], h[2])
                cx, cy, cz = _from_box(other, cx, cy, cz)
                qx, qy, qz = _from_box(other, qx, qy, qz)
                sign = (1.0 - 2.0 * side) / gap if gap > 0.0 else 0.0
                cx, cy, cz = cx + other[4], cy + other[5], cz + other[6]
                qx, qy, qz = qx + other[4], qy + other[5], qz + other[6]
                normal = sign * (cx - qx), sign * (cy - qy), sign * (cz - qz)
                c, q = (cx, cy, cz), (qx, qy, qz)
                if side == 0:
                    _store(out, gap, normal, c, q)
                else:
                    _store(out, gap, normal, q, c)


@inline
def _sign(value):
    return 1.0 if value > 0.0 else (-1.0 if value < 0.0 else 0.0)


@inline
def _placed(row, x, y, z):
    """Return a point in the axes of a box or hull in the world."""
    return (
        row[4] + row[7] * x + row[8] * y + row[9] * z,
        row[5] + row[10] * x + row[11] * y + row[12] * z,
        row[6] + row[13] * x + row[14] * y + row[15] * z,
    )


@inline
def _corner_of_hull(row, at):
    """Return a corner of a hull in the world, from where it stands in the row."""
    return _placed(row, row[at], row[at + 1], row[at + 2])


@shared
def _support_of_hull(row, x, y, z):
    """Return the corner of a hull that lies farthest along a vector."""
    u, v, w = _to_box(row, x, y, z)
    at = best = int(row[FIRST_CORNER])
    most = -math.inf
    for _ in range(int(row[CORNERS])):
        far = u * row[at] + v * row[at + 1] + w * row[at + 2]
        if far > most:
            most, best = far, at
        at += 3
    return _corner_of_hull(row, best)


@shared
def _support(row, low, high, x, y, z):
    """Return the point of a shape, or of the core of a round one, that lies farthest along a vector."""
    if row[KIND] == BOX:
        x, y, z = _to_box(row, x, y, z)
        return _placed(row, row[1] * _sign(x), row[2] * _sign(y), row[3] * _sign(z))
    if row[KIND] == HULL:
        return _support_of_hull(row, x, y, z)
    dx, dy, dz = row[5], row[6], row[7]
    along = dx * x + dy * y + dz * z
    s = high if along > 0.0 else low
    px, py, pz = row[2] + s * dx, row[3] + s * dy, row[4] + s * dz
    if row[KIND] == CYLINDER:
        scale, whole = 1.0 / (dx * dx + dy * dy + dz * dz), x * x + y * y + z * z
        for _ in range(2):  # once more for what rounding leaves along the axis
            share = (dx * x + dy * y + dz * z) * scale
            x, y, z = x - share * dx, y - share * dy, z - share * dz
        square = x * x + y * y + z * z
        if square > _ALONG_AXIS * whole:
            scale = row[RADIUS] / math.sqrt(square)
            px, py, pz = px + scale * x, py + scale * y, pz + scale * z
    return px, py, pz


@shared
def _put_support(a, b, ends, x, y, z, out, at):
    """Write the point of A − B that lies farthest along a vector; return how far it is."""
    px, py, pz = _support(a, ends[0], ends[1], x, y, z)
    qx, qy, qz = _support(b, ends[2], ends[3], -x, -y, -z)
    out[at], out[at + 1], out[at + 2] = px - qx, py - qy, pz - qz
    out[at + 3], out[at + 4], out[at + 5] = px, py, pz
    return x * (px - qx) + y * (py - qy) + z * (pz - qz)


@inline
def _normal(p, i, j, k):
    """Return the cross product of two sides of a triangle."""
    ax, ay, az = p[j] - p[i], p[j + 1] - p[i + 1], p[j + 2] - p[i + 2]
    bx, by, bz = p[k] - p[i], p[k + 1] - p[i + 1], p[k + 2] - p[i + 2]
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


@inline
def _square_between(p, i, j):
    x, y, z = p[i] - p[j], p[i + 1] - p[j + 1], p[i + 2] - p[j + 2]
    return x * x + y * y + z * z


@inline
def _along(p, i, j):
    """Return where on the line from a point to another the origin is nearest, times its square, and that square."""
    x, y, z = p[j] - p[i], p[j + 1] - p[i + 1], p[j + 2] - p[i + 2]
    return -(x * p[i] + y * p[i + 1] + z * p[i + 2]), x * x + y * y + z * z


@shared
def _nearest_on_side(p, i, j):
    """Return the share of the second of two points in the point between them nearest to the origin, and its square."""
    at, square = _along(p, i, j)
    t = min(max(at / square, 0.0), 1.0) if square > 0.0 else 0.0
    gap = 0.0
    for n in range(3):
        c = p[i + n] + t * (p[j + n] - p[i + n])
        gap += c * c
    return t, gap


@shared
def _nearest_on_triangle(p, i, j, k):
    """Return the shares of three points in the point of their triangle that is nearest to the origin, and its square.

    The foot of the perpendicular if it is inside, else the nearest of the sides.
    """
    x, y, z = _normal(p, i, j, k)
    square = x * x + y * y + z * z
    _, first = _along(p, i, j)
    _, second = _along(p, i, k)
    if square > _FLAT * first * second:
        height = (x * p[i] + y * p[i + 1] + z * p[i + 2]) / square
        fx, fy, fz = height * x - p[i], height * y - p[i + 1], height * z - p[i + 2]
        ax, ay, az = p[j] - p[i], p[j + 1] - p[i + 1], p[j + 2] - p[i + 2]
        bx, by, bz = p[k] - p[i], p[k + 1] - p[i + 1], p[k + 2] - p[i + 2]
        v = (x * (fy * bz - fz * by) + y * (fz * bx - fx * bz) + z * (fx * by - fy * bx)) / square
        w = (x * (ay * fz - az * fy) + y * (az * fx - ax * fz) + z * (ax * fy - ay * fx)) / square
        if v >= 0.0 and w >= 0.0 and v + w <= 1.0:
            return 1.0 - v - w, v, w, height * height * square
    t, best = _nearest_on_side(p, i, j)
    u, v, w = 1.0 - t, t, 0.0
    t, gap = _nearest_on_side(p, i, k)
    if gap < best:
        best, u, v, w = gap, 1.0 - t, 0.0, t
    t, gap = _nearest_on_side(p, j, k)
    if gap < best:
        best, u, v, w = gap, 0.0, 1.0 - t, t
    return u, v, w, best


@shared
def _reduce(p, count, shares):
    """Keep of a simplex what holds its point nearest to the origin, with the shares; 0 where it is inside of four."""
    if count == 1:
        shares[0] = 1.0
        return 1
    if count == 2:
        t, _ = _nearest_on_side(p, 0, _POINT)
        shares[0], shares[1] = 1.0 - t, t
        return _packed(p, 2, shares)
    if count == 3:
        shares[0], shares[1], shares[2], _ = _nearest_on_triangle(p, 0, _POINT, 2 * _POINT)
        return _packed(p, 3, shares)
    best, first, second, third, left, inside = math.inf, 0.0, 0.0, 0.0, 0, True
    for out in range(4):
        i = _POINT if out == 0 else 0
        j = 2 * _POINT if out <= 1 else _POINT
        k = 3 * _POINT if out <= 2 else 2 * _POINT
        o = out * _POINT
        x, y, z = _normal(p, i, j, k)
        origin = -(x * p[i] + y * p[i + 1] + z * p[i + 2])
        other = x * (p[o] - p[i]) + y * (p[o + 1] - p[i + 1]) + z * (p[o + 2] - p[i + 2])
        flat = other * other <= _FLAT * (x * x + y * y + z * z) * _square_between(p, o, i)
        if origin * other > 0.0 and not flat:
            continue
        inside = False
        u, v, w, square = _nearest_on_triangle(p, i, j, k)
        if square < best:
            best, left, first, second, third = square, out, u, v, w
    if inside:
        return 0
    for k in range(left, 3):
        for n in range(_POINT):
            p[_POINT * k + n] = p[_POINT * (k + 1) + n]
    shares[0], shares[1], shares[2] = first, second, third
    return _packed(p, 3, shares)


@inline
def _packed(p, count, shares):
    """Drop points without a share; return how many are left."""
    kept = 0
    for k in range(count):
        if shares[k] > 0.0:
            if kept < k:
                shares[kept] = shares[k]
                for n in range(_POINT):
                    p[_POINT * kept + n] = p[_POINT * k + n]
            kept += 1
    return kept


@inline
def _write(out, distance, x, y, z, px, py, pz, ra, rb, gap):
    """Write what is found: unit normal from b to a, a point of A's core, radii, distance of the cores."""
    out[0], out[1], out[2], out[3] = distance, x, y, z
    out[4], out[5], out[6] = px - ra * x, py - ra * y, pz - ra * z
    out[7], out[8], out[9] = px - (gap - rb) * x, py - (gap - rb) * y, pz - (gap - rb) * z


@inline
def _ends(row, other):
    """Return where the core of a shape begins and ends; of an infinite one what is beside a cylinder or hull."""
    if row[KIND] == BOX or row[KIND] == HULL or row[LAST] < math.inf:
        return row[FIRST], row[LAST]
    if other[KIND] == HULL:
        x, y, z, reach = other[CENTER], other[CENTER + 1], other[CENTER + 2], other[EXTENT]
    else:
        x, y, z = other[2] + 0.5 * other[5], other[3] + 0.5 * other[6], other[4] + 0.5 * other[7]
        reach = 0.5 * math.sqrt(other[5] ** 2 + other[6] ** 2 + other[7] ** 2) + other[RADIUS]
    dx, dy, dz = row[5], row[6], row[7]
    foot = dx * (x - row[2]) + dy * (y - row[3]) + dz * (z - row[4])
    return foot - reach, foot + reach


@shared
def convex_distance(a, b, out):
    """Find the distance of two shapes of which one is a cylinder or hull, and the other not a plane."""
    low, high = _ends(a, b)
    first, last = _ends(b, a)
    ends = (low, high, first, last)
    ra = a[RADIUS] if a[KIND] == ROUND else 0.0
    rb = b[RADIUS] if b[KIND] == ROUND else 0.0
    work = _simplex()
    shares = work[_SIMPLEX:]
    _put_support(a, b, ends, 1.0, 0.0, 0.0, work, 0)
    shares[0], count = 1.0, 1
    x, y, z, px, py, pz = work[0], work[1], work[2], work[3], work[4], work[5]
    square = x * x + y * y + z * z
    for _ in range(_STEPS):
        if square <= _EXACT * _EXACT:
            break
        far = -_put_support(a, b, ends, -x, -y, -z, work, count * _POINT)
        if square - far <= _EXACT * math.sqrt(square):  # no point of A − B is nearer than this less `_EXACT`
            break
        count = _reduce(work, count + 1, shares)
        if count == 0:
            square = 0.0
            break
        nx, ny, nz = _sum(work, count, shares, 0)
        nearer = nx * nx + ny * ny + nz * nz
        if nearer >= square:  # by rounding
            break
        x, y, z, square = nx, ny, nz, nearer
        px, py, pz = _sum(work, count, shares, 3)
    if square <= _EXACT * _EXACT:
        _expand(a, b, ends, ra, rb, out)
        return
    gap = math.sqrt(square)
    _write(out, gap - ra - rb, x / gap, y / gap, z / gap, px, py, pz, ra, rb, gap)


@inline
def _sum(p, count, shares, at):
    """Return a point of a simplex, or of A at it."""
    x, y, z = 0.0, 0.0, 0.0
    for k in range(count):
        x += shares[k] * p[_POINT * k + at]
        y += shares[k] * p[_POINT * k + at + 1]
        z += shares[k] * p[_POINT * k + at + 2]
    return x, y, z


@shared
def _add_face(p, faces, f, i, j, k):
    """Write a face whose corners turn left as seen from outside; one without area lies infinitely far."""
    x, y, z = _normal(p, i, j, k)
    size = math.sqrt(x * x + y * y + z * z)
    at = _FACE * f
    faces[at], faces[at + 1], faces[at + 2] = float(i), float(j), float(k)
    longest = max(_square_between(p, i, j), _square_between(p, j, k), _square_between(p, k, i))
    if size <= _FLAT * longest:
        faces[at + 3], faces[at + 4], faces[at + 5], faces[at + 6] = 0.0, 0.0, 0.0, math.inf
        return
    x, y, z = x / size, y / size, z / size
    faces[at + 3], faces[at + 4], faces[at + 5] = x, y, z
    faces[at + 6] = x * p[i] + y * p[i + 1] + z * p[i + 2]


@shared
def _farther(a, b, ends, x, y, z, p, at, of):
    """Write the support point along a vector or against it that is farther from a point in this direction."""
    here = x * p[of] + y * p[of + 1] + z * p[of + 2]
    ahead = _put_support(a, b, ends, x, y, z, p, at) - here
    back = _put_support(a, b, ends, -x, -y, -z, p, at) + here
    if ahead >= back:
        _put_support(a, b, ends, x, y, z, p, at)


@shared
def _expand(a, b, ends, ra, rb, out):
    """Find how deep two cores are in each other."""
    p, faces, rim = _points(), _polytope(), _rim()
    _put_support(a, b, ends, 1.0, 0.0, 0.0, p, 0)
    _put_support(a, b, ends, -1.0, 0.0, 0.0, p, _POINT)
    x, y, z = p[_POINT] - p[0], p[_POINT + 1] - p[1], p[_POINT + 2] - p[2]
    ux, uy, uz = (
        (0.0, z, -y)
        if abs(x) <= min(abs(y), abs(z))
        else ((-z, 0.0, x) if abs(y) <= abs(z) else (y, -x, 0.0))
    )
    _farther(a, b, ends, ux, uy, uz, p, 2 * _POINT, 0)
    x, y, z = _normal(p, 0, _POINT, 2 * _POINT)
    _farther(a, b, ends, x, y, z, p, 3 * _POINT, 0)
    above = x * (p[18] - p[0]) + y * (p[19] - p[1]) + z * (p[20] - p[2])
    second, third = (2 * _POINT, _POINT) if above > 0.0 else (_POINT, 2 * _POINT)
    _add_face(p, faces, 0, 0, second, third)
    _add_face(p, faces, 1, 0, third, 3 * _POINT)
    _add_face(p, faces, 2, third, second, 3 * _POINT)
    _add_face(p, faces, 3, second, 0, 3 * _POINT)
    count, corners = 4, 4
    depth, nx, ny, nz, px, py, pz = math.inf, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0
    for _ in range(_STEPS):
        best = 0
        for f in range(count):
            if faces[_FACE * f + 6] < faces[_FACE * best + 6]:
                best = f
        at = _FACE * best
        x, y, z, deep = faces[at + 3], faces[at + 4], faces[at + 5], faces[at + 6]
        new = corners * _POINT
        far = _put_support(a, b, ends, x, y, z, p, new)
        # whatever rounding does to the polytope, a shift by that along the normal separates them
        if far < depth:
            depth, nx, ny, nz = far, x, y, z
            px, py, pz = p[new + 3], p[new + 4], p[new + 5]
        if far - deep <= _EXACT or depth - deep <= _EXACT or count > _FACES - 8:
            break
        corners += 1
        edges, f = 0, 0
        while f < count:
            at = _FACE * f
            i = int(faces[at])
            seen = faces[at + 3] * (p[new] - p[i])
            seen += faces[at + 4] * (p[new + 1] - p[i + 1])
            seen += faces[at + 5] * (p[new + 2] - p[i + 2])
            if seen <= _SEEN and f != best:
                f += 1
                continue
            for side in range(3):
                edges = _toggle(rim, edges, faces[at + side], faces[at + (side + 1) % 3])
            count -= 1
            best = -1 if best == f else (f if best == count else best)
            for n in range(_FACE):
                faces[at + n] = faces[_FACE * count + n]
        for e in range(edges):
            if count >= _FACES:
                break
            _add_face(p, faces, count, int(rim[2 * e]), int(rim[2 * e + 1]), new)
            count += 1
    if a[KIND] != CYLINDER and b[KIND] != CYLINDER:
        px, py, pz = _point_on_face(p, faces, count, depth, px, py, pz)
    _write(out, -depth - ra - rb, -nx, -ny, -nz, px, py, pz, ra, rb, -depth)


@shared
def _point_on_face(p, faces, count, depth, px, py, pz):
    """Return the point of A at the foot of the origin on the nearest face, which several triangles may make up.

    Where corners meet edges or edges each other, the corner of A that lies farthest is not that point.
    """
    nearest = math.inf
    for f in range(count):
        at = _FACE * f
        if faces[at + 6] <= depth + _EXACT:
            i, j, k = int(faces[at]), int(faces[at + 1]), int(faces[at + 2])
            u, v, w, square = _nearest_on_triangle(p, i, j, k)
            if square < nearest:
                nearest = square
                px = u * p[i + 3] + v * p[j + 3] + w * p[k + 3]
                py = u * p[i + 4] + v * p[j + 4] + w * p[k + 4]
                pz = u * p[i + 5] + v * p[j + 5] + w * p[k + 5]
    return px, py, pz


@inline
def _toggle(rim, edges, i, j):
    """Add an edge, or take away the one that runs against it; return how many there are."""
    for e in range(edges):
        if rim[2 * e] == j and rim[2 * e + 1] == i:
            edges -= 1
            rim[2 * e], rim[2 * e + 1] = rim[2 * edges], rim[2 * edges + 1]
            return edges
    rim[2 * edges], rim[2 * edges + 1] = i, j
    return edges + 1


@inline
def convex_plane(a, b, out):
    """Find the distance of a cylinder or a hull and a plane."""
    if a[KIND] == HULL:
        _hull_plane(a, b, out)
    else:
        _cylinder_plane(a, b, out)


@shared
def _hull_plane(a, b, out):
    """Find the distance of a hull and a plane: of its lowest corner, or the middle of those that are as low."""
    nx, ny, nz = b[NORMAL], b[NORMAL + 1], b[NORMAL + 2]
    px, py, pz = _support_of_hull(a, -nx, -ny, -nz)
    height = nx * px + ny * py + nz * pz - b[OFFSET]
    at, count, sx, sy, sz = int(a[FIRST_CORNER]), 0, 0.0, 0.0, 0.0
    for _ in range(int(a[CORNERS])):
        x, y, z = _corner_of_hull(a, at)
        if nx * x + ny * y + nz * z - b[OFFSET] <= height + _SEEN:
            count, sx, sy, sz = count + 1, sx + x, sy + y, sz + z
        at += 3
    _write(out, height, nx, ny, nz, sx / count, sy / count, sz / count, 0.0, 0.0, height)


@shared
def _cylinder_plane(a, b, out):
    """Find the distance of a cylinder and a plane: of its lowest rim point, or an end's middle."""
    nx, ny, nz = b[2], b[3], b[4]
    dx, dy, dz = a[5], a[6], a[7]
    slope = nx * dx + ny * dy + nz * dz
    s = 1.0 if slope < -1e-12 else (0.0 if slope > 1e-12 else 0.5)
    share = slope / (dx * dx + dy * dy + dz * dz)
    x, y, z = nx - share * dx, ny - share * dy, nz - share * dz
    size = math.sqrt(x * x + y * y + z * z)
    scale = a[RADIUS] / size if size > 1e-12 else 0.0
    px, py, pz = a[2] + s * dx - scale * x, a[3] + s * dy - scale * y, a[4] + s * dz - scale * z
    height = nx * px + ny * py + nz * pz - b[1]
    _write(out, height, nx, ny, nz, px, py, pz, 0.0, 0.0, height)


@shared
def _swap(out):
    """Let a and b change places in what was found."""
    out[1], out[2], out[3] = -out[1], -out[2], -out[3]
    for k in range(3):
        out[4 + k], out[7 + k] = out[7 + k], out[4 + k]


@inline
def find_distance(a, b, out):
    """Write what is found about two shapes, `FOUND` numbers; return False for two planes, which meet somewhere."""
    first, second = a[KIND], b[KIND]
    if first == ROUND and second == ROUND:
        round_round(a, b, out)
        return True
    if first >= CYLINDER or second >= CYLINDER:
        if second == PLANE:
            convex_plane(a, b, out)
        elif first == PLANE:
            convex_plane(b, a, out)
            _swap(out)
        else:
            convex_distance(a, b, out)
    elif first == ROUND:
        if second == PLANE:
            _round_plane(a, b, out)
        else:
            _round_box(a, b, out)
    elif second == ROUND:
        if first == PLANE:
            _round_plane(b, a, out)
        else:
            _round_box(b, a, out)
        _swap(out)
    elif first == BOX:
        if second == PLANE:
            _box_plane(a, b, out)
        else:
            _box_box(a, b, out)
    elif second == BOX:
        _box_plane(b, a, out)
        _swap(out)
    else:
        return False
    return True


@inline
def add_distance_row(found, sign, jacobian, begin, end, row):
    """Add ±(c × n, n)·J, columns `begin` to `end` of a twist Jacobian, to the row of ḋ: + for a's link, − for b's.

    The rate of a distance is the reciprocal product of the contact normal, as a line n + ε c × n, with the twists.
    """
    nx, ny, nz = found[1], found[2], found[3]
    mx = found[5] * nz - found[6] * ny
    my = found[6] * nx - found[4] * nz
    mz = found[4] * ny - found[5] * nx
    for j in range(begin, end):
        row[j] += sign * (
            mx * jacobian[0, j]
            + my * jacobian[1, j]
            + mz * jacobian[2, j]
            + nx * jacobian[3, j]
            + ny * jacobian[4, j]
            + nz * jacobian[5, j]
        )


@kernel(STATUS(READ2, READ2, WRITE2))
def distances(a, b, out):
    """Write what is found about the shapes of each pair of rows; return how many could be compared, from the first."""
    for i in range(out.shape[0]):
        if not find_distance(a[i], b[i], out[i]):
            return i
    return out.shape[0]


@kernel(STATUS(READ, STATUS, READ2, WRITE))
def distance_row(found, sign, jacobian, row):
    """Add ±(c × n, n)·J to a row."""
    add_distance_row(found, float(sign), jacobian, 0, jacobian.shape[1], row)
    return 0

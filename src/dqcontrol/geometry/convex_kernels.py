"""Distances of a finite cylinder, or a hull of points, and another convex shape, compiled, by their support points.

Apart: Gilbert, Johnson and Keerthi (1988), on the difference A − B of the two. In each other: the expanding polytope
of van den Bergen (2001), which starts from any tetrahedron of support points and grows around the origin. Both end
where no support point lies farther than `_EXACT` beyond what is known. Coal, from which such distances could come, is
called from Python, allocates, and of shapes in each other its search fails in one of 60 pairs.
"""

from __future__ import annotations

import math

from dqcontrol.compiled.compile import inline, shared
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
_PARALLEL = 1e-24  # square of the sine below which a direction is along the axis
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


@inline
def _sign(value):
    return 1.0 if value > 0.0 else (-1.0 if value < 0.0 else 0.0)


@inline
def _corner(row, at):
    """Return a corner of a hull in the world, from where it stands in the row."""
    u, v, w = row[at], row[at + 1], row[at + 2]
    return (
        row[4] + row[7] * u + row[8] * v + row[9] * w,
        row[5] + row[10] * u + row[11] * v + row[12] * w,
        row[6] + row[13] * u + row[14] * v + row[15] * w,
    )


@shared
def _support_of_hull(row, x, y, z):
    """Return the corner of a hull that lies farthest along a vector."""
    u = row[7] * x + row[10] * y + row[13] * z
    v = row[8] * x + row[11] * y + row[14] * z
    w = row[9] * x + row[12] * y + row[15] * z
    at = best = int(row[FIRST_CORNER])
    most = -math.inf
    for _ in range(int(row[CORNERS])):
        far = u * row[at] + v * row[at + 1] + w * row[at + 2]
        if far > most:
            most, best = far, at
        at += 3
    return _corner(row, best)


@shared
def _support(row, low, high, x, y, z):
    """Return the point of a shape, or of the core of a round one, that lies farthest along a vector."""
    if row[KIND] == BOX:
        u = row[1] * _sign(row[7] * x + row[10] * y + row[13] * z)
        v = row[2] * _sign(row[8] * x + row[11] * y + row[14] * z)
        w = row[3] * _sign(row[9] * x + row[12] * y + row[15] * z)
        return (
            row[4] + row[7] * u + row[8] * v + row[9] * w,
            row[5] + row[10] * u + row[11] * v + row[12] * w,
            row[6] + row[13] * u + row[14] * v + row[15] * w,
        )
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
        if square > _PARALLEL * whole:
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
def write_found(out, distance, x, y, z, px, py, pz, ra, rb, gap):
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
    write_found(out, gap - ra - rb, x / gap, y / gap, z / gap, px, py, pz, ra, rb, gap)


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
    write_found(out, -depth - ra - rb, -nx, -ny, -nz, px, py, pz, ra, rb, -depth)


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
        x, y, z = _corner(a, at)
        if nx * x + ny * y + nz * z - b[OFFSET] <= height + _SEEN:
            count, sx, sy, sz = count + 1, sx + x, sy + y, sz + z
        at += 3
    write_found(out, height, nx, ny, nz, sx / count, sy / count, sz / count, 0.0, 0.0, height)


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
    write_found(out, height, nx, ny, nz, px, py, pz, 0.0, 0.0, height)

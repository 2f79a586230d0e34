"""Poses and Jacobians of tasks of a tree, compiled: of a frame, of one seen from another, of what two have in common.

A task is a table of rows of thirteen numbers. The first says which task it is: its kind, the sign given to x_r (0: the
short way round), and how many rows the paths to its one or two frames have. Then come the rows of each path, from the
base to the frame: ``[r (4), p (3), kind, coordinate, input, multiplier, offset, parent]``, a fixed pose and a screw
about its z axis as in `kinematics_kernels`, by multiplier · q[coordinate] + offset; the last row of a path is the frame
itself.
Joints that share a coordinate add to one column.

The centre of mass has any number of paths, one to the centre of each body, whose last row has that body's share of the
mass as its multiplier. Its pose has no orientation.

A tree is a table of such rows, too, after a first that says how many coordinates there are: of all joints, parents
first, then of its frames, whose kind is `FIXED`.

With ξ₁ and ξ₂ the columns of both frames, and x_r = x₂*x₁: [Adorno 2011; the Jacobians are ours]

* relative: ξ_r = Ad(x₂*)(ξ₁ − ξ₂);
* absolute: x_a = x₂ x_r^½. From s s = x_r follows ξ_r = ξ_s + Ad(s) ξ_s, and by Cayley's form of Ad(s)
  ξ_a = ½(ξ₁ + ξ₂) − ½ K × (ξ₁ − ξ₂), K = Ad(x₂)(Im x_r/(1 + Re x_r)): as dual vectors with the screw root; with
  the root that halves rotation and translation apart, for ω alone, and ṗ = ½(ṗ₁ + ṗ₂).
"""

from __future__ import annotations

import math

from dqcontrol.algebra.dual_quaternion_kernels import position, product, rotated, set_pose
from dqcontrol.compiled.compile import (
    INPUT,
    NOT_FINITE,
    OK,
    READ2,
    SINGULAR,
    STATUS,
    WRITE,
    WRITE2,
    WRONG_SIZE,
    inline,
    kernel,
    shared,
)
from dqcontrol.compiled.intrinsics import as_matrix
from dqcontrol.robots.kinematics import kinematics_kernels as chains
from dqcontrol.robots.kinematics.sin_cos import FARTHEST, sines_cosines

FRAME, RELATIVE, MIDPOINT, SCREW, CENTER_OF_MASS = range(5)
KIND, SIGN, FIRST_ROWS, SECOND_ROWS, COORDINATES = range(5)  # of the first row
COORDINATE, INPUT_COLUMN, MULTIPLIER, OFFSET = range(8, 12)  # of the others
PARENT = 12  # of rows of a tree; −1: the base
COLUMNS = 13

FIXED = -1.0  # in place of a joint's kind: a frame that is fixed to its parent

_LEAST = 1e-12  # 1 + Re x_r, below which both frames are a full turn apart


@inline
def _angle(row, q):
    return row[MULTIPLIER] * q[int(row[COORDINATE])] + row[OFFSET]


@inline
def _halves(rows, q, workspace):
    """Write sines, then cosines, of all half angles; return where the cosines begin, −1 where there is no room."""
    n = rows.shape[0] - 1
    padded = (n + 3) // 4 * 4
    if 3 * padded > workspace.shape[0]:
        return -1
    half, farthest = workspace[2 * padded : 3 * padded], 0.0
    for i in range(n):
        half[i] = 0.5 * _angle(rows[i], q)
        farthest = max(farthest, abs(half[i]))
    if not farthest <= FARTHEST:
        return -1
    for i in range(n, padded):
        half[i] = 0.0
    sines_cosines(half, padded, workspace)
    return padded


@inline
def _path(rows, q, jacobian, workspace):
    """Write the screws of a path's joints into the columns of their inputs; return its end and 0, or NaN."""
    for k in range(6):
        for j in range(jacobian.shape[1]):
            jacobian[k, j] = 0.0
    w, x, y, z, px, py, pz = 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    check = 0.0
    cosines = _halves(rows, q, workspace)
    last = rows.shape[0] - 1
    for i in range(last):
        row = rows[i]
        w, x, y, z, px, py, pz = chains.compose_fixed(w, x, y, z, px, py, pz, row)
        zx, zy, zz = chains.z_axis(w, x, y, z)
        kind, j, scale, angle = row[7], int(row[INPUT_COLUMN]), row[MULTIPLIER], _angle(row, q)
        check += 0.0 * angle
        if kind == chains.REVOLUTE:
            a, b, c = scale * zx, scale * zy, scale * zz
            jacobian[0, j] += a
            jacobian[1, j] += b
            jacobian[2, j] += c
            jacobian[3, j] += py * c - pz * b
            jacobian[4, j] += pz * a - px * c
            jacobian[5, j] += px * b - py * a
        elif j >= 0:
            a, b, c = zx, zy, zz
            if kind == chains.HEADING:
                a, b, c = chains.heading_axis(w, x, y, z, zx, zy, zz, q[int(row[COORDINATE]) + 2])
            jacobian[3, j] += scale * a
            jacobian[4, j] += scale * b
            jacobian[5, j] += scale * c
        if cosines < 0:
            sine, cosine = chains.half_sine_cosine(angle)
        else:
            sine, cosine = workspace[i], workspace[cosines + i]
        w, x, y, z, px, py, pz = chains.move_joint(
            w, x, y, z, px, py, pz, zx, zy, zz, kind, angle, sine, cosine
        )
    w, x, y, z, px, py, pz = chains.compose_fixed(w, x, y, z, px, py, pz, rows[last])
    return (w, x, y, z), (px, py, pz), check


@inline
def _path_end(rows, q):
    """Return the end of a path, and 0, or NaN where q is not finite."""
    w, x, y, z, px, py, pz = 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    check = 0.0
    last = rows.shape[0] - 1
    for i in range(last):
        row, angle = rows[i], _angle(rows[i], q)
        check += 0.0 * angle
        w, x, y, z, px, py, pz = chains.compose_fixed(w, x, y, z, px, py, pz, row)
        w, x, y, z, px, py, pz = chains.moved(w, x, y, z, px, py, pz, row[7], angle)
    w, x, y, z, px, py, pz = chains.compose_fixed(w, x, y, z, px, py, pz, rows[last])
    return (w, x, y, z), (px, py, pz), check


@inline
def _turned_back(r, v):
    """Return Im(r* v r)."""
    return rotated((r[0], -r[1], -r[2], -r[3]), v)


@inline
def _crossed(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inline
def _relative(r1, p1, r2, p2):
    """Return r and p of x₂*x₁."""
    r = product((r2[0], -r2[1], -r2[2], -r2[3]), r1)
    return r, _turned_back(r2, (p1[0] - p2[0], p1[1] - p2[1], p1[2] - p2[2]))


@inline
def _common_pose(kind, sign, r1, p1, r2, p2, pose):
    """Write the relative or absolute pose; return 1 + Re of the signed relative rotation and K's parts."""
    r, p = _relative(r1, p1, r2, p2)
    if kind == RELATIVE:
        set_pose(r, p, pose)
        return 1.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    if sign == 0.0:
        sign = 1.0 if r[0] >= 0.0 else -1.0
    r = sign * r[0], sign * r[1], sign * r[2], sign * r[3]
    half = 1.0 + r[0]
    scale = 1.0 / half
    norm = 1.0 / math.sqrt(2.0 * half)
    root = half * norm, r[1] * norm, r[2] * norm, r[3] * norm
    k = rotated(r2, (r[1] * scale, r[2] * scale, r[3] * scale))
    ra = product(r2, root)
    if kind == MIDPOINT:
        set_pose(ra, (0.5 * (p1[0] + p2[0]), 0.5 * (p1[1] + p2[1]), 0.5 * (p1[2] + p2[2])), pose)
        return half, k, (0.0, 0.0, 0.0)
    # x_r = r + ε d, d = ½ p r; its half s = (1 + x_r)/|1 + x_r|, |1 + x_r| = √(2(1 + w)) + ε w'/√(2(1 + w))
    d = product((0.0, 0.5 * p[0], 0.5 * p[1], 0.5 * p[2]), r)
    less = d[0] * norm * norm * norm
    dual = (
        d[0] * norm - half * less,
        d[1] * norm - r[1] * less,
        d[2] * norm - r[2] * less,
        d[3] * norm - r[3] * less,
    )
    step = product(dual, (root[0], -root[1], -root[2], -root[3]))  # half the translation of s
    a, b, c = rotated(r2, (2.0 * step[1], 2.0 * step[2], 2.0 * step[3]))
    set_pose(ra, (p2[0] + a, p2[1] + b, p2[2] + c), pose)
    less = d[0] * scale * scale
    a, b, c = rotated(
        r2, (d[1] * scale - r[1] * less, d[2] * scale - r[2] * less, d[3] * scale - r[3] * less)
    )
    x, y, z = _crossed(p2, k)
    return half, k, (a + x, b + y, c + z)


@inline
def _relative_columns(r2, p2, first, second):
    """Replace ξ₁ by Ad(x₂*)(ξ₁ − ξ₂)."""
    for j in range(first.shape[1]):
        w = first[0, j] - second[0, j], first[1, j] - second[1, j], first[2, j] - second[2, j]
        v = first[3, j] - second[3, j], first[4, j] - second[4, j], first[5, j] - second[5, j]
        x, y, z = _crossed(p2, w)
        first[0, j], first[1, j], first[2, j] = _turned_back(r2, w)
        first[3, j], first[4, j], first[5, j] = _turned_back(r2, (v[0] - x, v[1] - y, v[2] - z))


@inline
def _screw_columns(k, dual, first, second):
    """Replace ξ₁ by ½(ξ₁ + ξ₂) − ½ K × (ξ₁ − ξ₂), dual vectors."""
    for j in range(first.shape[1]):
        a, b, c = first[0, j], first[1, j], first[2, j]
        d, e, f = first[3, j], first[4, j], first[5, j]
        u, v, w = second[0, j], second[1, j], second[2, j]
        x, y, z = second[3, j], second[4, j], second[5, j]
        turn = a - u, b - v, c - w
        ka, kb, kc = _crossed(k, turn)
        kd, ke, kf = _crossed(k, (d - x, e - y, f - z))
        la, lb, lc = _crossed(dual, turn)
        first[0, j], first[1, j], first[2, j] = 0.5 * (a + u - ka), 0.5 * (b + v - kb), 0.5 * (c + w - kc)
        first[3, j] = 0.5 * (d + x - kd - la)
        first[4, j] = 0.5 * (e + y - ke - lb)
        first[5, j] = 0.5 * (f + z - kf - lc)


@inline
def _midpoint_columns(k, p1, p2, first, second):
    """Replace ξ₁ by ω = ½(ω₁ + ω₂) − ½ K × (ω₁ − ω₂) and ṗ = ½(ṗ₁ + ṗ₂), as a twist."""
    px, py, pz = 0.5 * (p1[0] + p2[0]), 0.5 * (p1[1] + p2[1]), 0.5 * (p1[2] + p2[2])
    for j in range(first.shape[1]):
        one = first[0, j], first[1, j], first[2, j]
        two = second[0, j], second[1, j], second[2, j]
        x, y, z = _crossed(p1, one)
        u, v, w = _crossed(p2, two)
        a, b, c = _crossed(k, (one[0] - two[0], one[1] - two[1], one[2] - two[2]))
        a, b, c = 0.5 * (one[0] + two[0] - a), 0.5 * (one[1] + two[1] - b), 0.5 * (one[2] + two[2] - c)
        first[0, j], first[1, j], first[2, j] = a, b, c
        first[3, j] = 0.5 * (first[3, j] - x + second[3, j] - u) + py * c - pz * b
        first[4, j] = 0.5 * (first[4, j] - y + second[4, j] - v) + pz * a - px * c
        first[5, j] = 0.5 * (first[5, j] - z + second[5, j] - w) + px * b - py * a


@inline
def _path_rows(task, begin):
    """Return where the path that begins in a row ends."""
    end = begin
    while task[end, 7] != FIXED:
        end += 1
    return end + 1


@inline
def _center_of_mass(task, q, pose):
    """Write the centre of mass as a pose; return NaN where q is not finite."""
    x, y, z, check, begin = 0.0, 0.0, 0.0, 0.0, 1
    while begin < task.shape[0]:
        end = _path_rows(task, begin)
        share = task[end - 1, MULTIPLIER]
        _, p, bad = _path_end(task[begin:end], q)
        x, y, z, check = x + share * p[0], y + share * p[1], z + share * p[2], check + bad
        begin = end
    set_pose((1.0, 0.0, 0.0, 0.0), (x, y, z), pose)
    return check


@inline
def _center_of_mass_columns(task, q, pose, twist_jacobian, workspace):
    """Write the centre of mass, and the Jacobian of ṗ, which is its twist; return NaN where q is not finite."""
    m = twist_jacobian.shape[1]
    own = as_matrix(workspace[0 : 6 * m], 6, m)
    for k in range(6):
        for j in range(m):
            twist_jacobian[k, j] = 0.0
    x, y, z, check, begin = 0.0, 0.0, 0.0, 0.0, 1
    while begin < task.shape[0]:
        end = _path_rows(task, begin)
        share = task[end - 1, MULTIPLIER]
        _, p, bad = _path(task[begin:end], q, own, workspace[6 * m :])
        x, y, z, check = x + share * p[0], y + share * p[1], z + share * p[2], check + bad
        for j in range(m):
            a, b, c = own[0, j], own[1, j], own[2, j]
            twist_jacobian[3, j] += share * (own[3, j] + b * p[2] - c * p[1])
            twist_jacobian[4, j] += share * (own[4, j] + c * p[0] - a * p[2])
            twist_jacobian[5, j] += share * (own[5, j] + a * p[1] - b * p[0])
        begin = end
    set_pose((1.0, 0.0, 0.0, 0.0), (x, y, z), pose)
    return check


@inline
def task_pose(task, q, pose):
    """Write the pose of a task."""
    head = task[0]
    if q.shape[0] != int(head[COORDINATES]):
        return WRONG_SIZE
    kind, middle = int(head[KIND]), 1 + int(head[FIRST_ROWS])
    if kind == CENTER_OF_MASS:
        return OK if _center_of_mass(task, q, pose) == 0.0 else NOT_FINITE
    r1, p1, check = _path_end(task[1:middle], q)
    if kind == FRAME:
        set_pose(r1, p1, pose)
        return OK if check == 0.0 else NOT_FINITE
    r2, p2, other = _path_end(task[middle:], q)
    half, _, _ = _common_pose(kind, head[SIGN], r1, p1, r2, p2, pose)
    if check + other != 0.0:
        return NOT_FINITE
    return OK if half > _LEAST else SINGULAR


@inline
def task_twist_kinematics(task, q, pose, twist_jacobian, workspace):
    """Write pose and twist Jacobian of a task; the workspace has the size of a pose Jacobian."""
    head, m = task[0], twist_jacobian.shape[1]
    if q.shape[0] != int(head[COORDINATES]) or workspace.shape[0] < 8 * m:
        return WRONG_SIZE
    kind, middle = int(head[KIND]), 1 + int(head[FIRST_ROWS])
    if kind == CENTER_OF_MASS:
        return OK if _center_of_mass_columns(task, q, pose, twist_jacobian, workspace) == 0.0 else NOT_FINITE
    r1, p1, check = _path(task[1:middle], q, twist_jacobian, workspace)
    if kind == FRAME:
        set_pose(r1, p1, pose)
        return OK if check == 0.0 else NOT_FINITE
    second = as_matrix(workspace[0 : 6 * m], 6, m)
    r2, p2, other = _path(task[middle:], q, second, workspace[6 * m :])
    half, k, dual = _common_pose(kind, head[SIGN], r1, p1, r2, p2, pose)
    if kind == RELATIVE:
        _relative_columns(r2, p2, twist_jacobian, second)
    elif kind == MIDPOINT:
        _midpoint_columns(k, p1, p2, twist_jacobian, second)
    else:
        _screw_columns(k, dual, twist_jacobian, second)
    if check + other != 0.0:
        return NOT_FINITE
    return OK if half > _LEAST else SINGULAR


@inline
def _task_kinematics(task, q, pose, pose_jacobian, twist_jacobian):
    """Write pose and both Jacobians."""
    m = twist_jacobian.shape[1]
    if pose_jacobian.shape[1] != m:
        return WRONG_SIZE
    workspace = as_matrix(pose_jacobian, 1, 8 * m)[0]
    status = task_twist_kinematics(task, q, pose, twist_jacobian, workspace)
    chains.fill_pose_jacobian(pose, twist_jacobian, pose_jacobian)
    return status


@kernel(chains.CHAIN)
def forward(task, q, out):
    """Write the pose (8)."""
    return task_pose(task, q, out)


@kernel(chains.CHAIN)
def kinematics(task, q, out):
    """Write the pose (8), the pose Jacobian (8 × m) and the twist Jacobian (6 × m), one after the other."""
    pose, pose_jacobian, twist_jacobian = chains.split(out)
    return _task_kinematics(task, q, pose, pose_jacobian, twist_jacobian)


@kernel(chains.CHAIN)
def twist_kinematics(task, q, out):
    """Write what `kinematics` does; the block of the pose Jacobian is scratch and undefined afterwards."""
    pose, pose_jacobian, twist_jacobian = chains.split(out)
    workspace = as_matrix(pose_jacobian, 1, 8 * pose_jacobian.shape[1])[0]
    return task_twist_kinematics(task, q, pose, twist_jacobian, workspace)


@kernel(STATUS(READ2, INPUT, WRITE, WRITE2, WRITE2))
def kinematics_apart(task, q, pose, pose_jacobian, twist_jacobian):
    """Write `kinematics` into three arrays."""
    return _task_kinematics(task, q, pose, pose_jacobian, twist_jacobian)


@kernel(chains.CHAIN)
def hand_kinematics(task, q, out):
    """Write the pose (8), the pose Jacobian (8 × m) and the Jacobian (6 × m) of the frame's [ω ; ṗ]."""
    pose, pose_jacobian, jacobian = chains.split(out)
    status = _task_kinematics(task, q, pose, pose_jacobian, jacobian)
    chains.hand_jacobian(position(pose), jacobian, jacobian)
    return status


@shared
def place_tree(tree, q, out):
    """Write the pose of each row of a tree, after its screw: 8 numbers a row."""
    if q.shape[0] != int(tree[0, COORDINATES]):
        return WRONG_SIZE
    check = 0.0
    for i in range(tree.shape[0] - 1):
        row = tree[1 + i]
        w, x, y, z, px, py, pz = 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        parent = int(row[PARENT])
        if parent >= 0:
            carrier = out[8 * parent : 8 * parent + 8]
            w, x, y, z = carrier[0], carrier[1], carrier[2], carrier[3]
            px, py, pz = position(carrier)
        w, x, y, z, px, py, pz = chains.compose_fixed(w, x, y, z, px, py, pz, row)
        if row[7] != FIXED:
            angle = _angle(row, q)
            check += 0.0 * angle
            w, x, y, z, px, py, pz = chains.moved(w, x, y, z, px, py, pz, row[7], angle)
        set_pose((w, x, y, z), (px, py, pz), out[8 * i : 8 * i + 8])
    return OK if check == 0.0 else NOT_FINITE


@kernel(chains.CHAIN)
def tree_frames(tree, q, out):
    """Write what `place_tree` does."""
    return place_tree(tree, q, out)

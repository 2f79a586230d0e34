"""Every inlined operation on single dual quaternions, for kernels to call.

A quaternion is ``[w, x, y, z]``; a dual quaternion P + εD is ``[P, D]`` (8 numbers); the imaginary parts of a
pure one are ``[Im P, Im D]`` (6 numbers). Outputs are written in place and may not alias inputs.
"""

from __future__ import annotations

import math

from dqcontrol.compiled.compile import inline

_SERIES_BELOW = 0.3  # rad; beyond it the closed forms of V and V⁻¹ lose fewer than three digits


@inline
def product(a, b):
    """Return the quaternion product ab."""
    aw, ax, ay, az = a[0], a[1], a[2], a[3]
    bw, bx, by, bz = b[0], b[1], b[2], b[3]
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )


@inline
def quaternion_product(a, b, out):
    """Write the quaternion product ab."""
    out[0], out[1], out[2], out[3] = product(a, b)


@inline
def multiply(a, b, out):
    """Write ab = P₁P₂ + ε(P₁D₂ + D₁P₂)."""
    quaternion_product(a[0:4], b[0:4], out[0:4])
    aw, ax, ay, az = a[4], a[5], a[6], a[7]
    bw, bx, by, bz = b[0], b[1], b[2], b[3]
    quaternion_product(a[0:4], b[4:8], out[4:8])
    out[4] += aw * bw - ax * bx - ay * by - az * bz
    out[5] += aw * bx + ax * bw + ay * bz - az * by
    out[6] += aw * by - ax * bz + ay * bw + az * bx
    out[7] += aw * bz + ax * by - ay * bx + az * bw


@inline
def conjugate_multiply(a, b, out):
    """Write a*b."""
    for k in range(0, 8, 4):
        aw, ax, ay, az = a[0], -a[1], -a[2], -a[3]
        bw, bx, by, bz = b[k], b[k + 1], b[k + 2], b[k + 3]
        out[k] = aw * bw - ax * bx - ay * by - az * bz
        out[k + 1] = aw * bx + ax * bw + ay * bz - az * by
        out[k + 2] = aw * by - ax * bz + ay * bw + az * bx
        out[k + 3] = aw * bz + ax * by - ay * bx + az * bw
    aw, ax, ay, az = a[4], -a[5], -a[6], -a[7]
    bw, bx, by, bz = b[0], b[1], b[2], b[3]
    out[4] += aw * bw - ax * bx - ay * by - az * bz
    out[5] += aw * bx + ax * bw + ay * bz - az * by
    out[6] += aw * by - ax * bz + ay * bw + az * bx
    out[7] += aw * bz + ax * by - ay * bx + az * bw


@inline
def conjugate(a, out):
    """Write a*."""
    for k in (0, 4):
        out[k] = a[k]
        out[k + 1] = -a[k + 1]
        out[k + 2] = -a[k + 2]
        out[k + 3] = -a[k + 3]


@inline
def norm(a, out):
    """Write the dual number |a| = |P| + ε⟨P, D⟩/|P|."""
    out[0] = math.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2] + a[3] * a[3])
    out[1] = (a[0] * a[4] + a[1] * a[5] + a[2] * a[6] + a[3] * a[7]) / out[0] if out[0] > 0.0 else 0.0


@inline
def inverse(a, out):
    """Write a⁻¹ = a*(1/m − εm'/m²) with aa* = m + εm'."""
    m = a[0] * a[0] + a[1] * a[1] + a[2] * a[2] + a[3] * a[3]
    dual = 2.0 * (a[0] * a[4] + a[1] * a[5] + a[2] * a[6] + a[3] * a[7])
    conjugate(a, out)
    dual /= m
    for i in range(4):
        out[4 + i] = (out[4 + i] - out[i] * dual) / m
        out[i] = out[i] / m


@inline
def renormalise(a, out):
    """Write the unit dual quaternion nearest to a."""
    scale = 1.0 / math.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2] + a[3] * a[3])
    for i in range(8):
        out[i] = a[i] * scale
    along = out[0] * out[4] + out[1] * out[5] + out[2] * out[6] + out[3] * out[7]
    for i in range(4):
        out[4 + i] -= along * out[i]


@inline
def short(a, out):
    """Write a or −a, whichever has a primary real part ≥ 0."""
    sign = -1.0 if a[0] < 0.0 else 1.0
    for i in range(8):
        out[i] = sign * a[i]


@inline
def hamilton_plus(a, out):
    """Write H⁺(a), row-major: vec8(ab) = H⁺(a) vec8(b)."""
    _hamilton(a, 1.0, out)


@inline
def hamilton_minus(b, out):
    """Write H⁻(b), row-major: vec8(ab) = H⁻(b) vec8(a)."""
    _hamilton(b, -1.0, out)


@inline
def _hamilton(a, side, out):
    for half in range(2):
        w, x, y, z = a[4 * half], a[4 * half + 1], a[4 * half + 2], a[4 * half + 3]
        i, j, k = side * x, side * y, side * z
        for block in range(2 - half):
            o = 8 * (4 * (half + block)) + 4 * block
            out[o], out[o + 1], out[o + 2], out[o + 3] = w, -x, -y, -z
            out[o + 8], out[o + 9], out[o + 10], out[o + 11] = x, w, -k, j
            out[o + 16], out[o + 17], out[o + 18], out[o + 19] = y, k, w, -i
            out[o + 24], out[o + 25], out[o + 26], out[o + 27] = z, -j, i, w
    for row in range(4):
        for column in range(4, 8):
            out[8 * row + column] = 0.0


@inline
def rotated(r, v):
    """Return Im(r v r*) for a unit quaternion r and a 3-vector v."""
    w, x, y, z = r[0], r[1], r[2], r[3]
    a, b, c = v[0], v[1], v[2]
    tx, ty, tz = 2.0 * (y * c - z * b), 2.0 * (z * a - x * c), 2.0 * (x * b - y * a)
    return a + w * tx + y * tz - z * ty, b + w * ty + z * tx - x * tz, c + w * tz + x * ty - y * tx


@inline
def rotate(r, v, out):
    """Write Im(r v r*) for a unit quaternion r and a 3-vector v."""
    out[0], out[1], out[2] = rotated(r, v)


@inline
def position(x):
    """Return p = 2 Im(D P*), the position in the inertial frame."""
    w, i, j, k = x[0], -x[1], -x[2], -x[3]
    dw, di, dj, dk = x[4], x[5], x[6], x[7]
    return (
        2.0 * (dw * i + di * w + dj * k - dk * j),
        2.0 * (dw * j - di * k + dj * w + dk * i),
        2.0 * (dw * k + di * j - dj * i + dk * w),
    )


@inline
def translation(x, out):
    """Write what `position` returns."""
    out[0], out[1], out[2] = position(x)


@inline
def body_translation(x, out):
    """Write p_b = 2 Im(P* D), the position in the body frame."""
    w, i, j, k = x[0], -x[1], -x[2], -x[3]
    dw, di, dj, dk = x[4], x[5], x[6], x[7]
    out[0] = 2.0 * (w * di + i * dw + j * dk - k * dj)
    out[1] = 2.0 * (w * dj - i * dk + j * dw + k * di)
    out[2] = 2.0 * (w * dk + i * dj - j * di + k * dw)


@inline
def set_pose(r, p, out):
    """Write x = r + ε½pr from a unit quaternion and a position."""
    w, i, j, k = r[0], r[1], r[2], r[3]
    px, py, pz = 0.5 * p[0], 0.5 * p[1], 0.5 * p[2]
    out[0], out[1], out[2], out[3] = w, i, j, k
    out[4] = -px * i - py * j - pz * k
    out[5] = px * w + py * k - pz * j
    out[6] = py * w + pz * i - px * k
    out[7] = pz * w + px * j - py * i


@inline
def adjoint(x, y, out):
    """Write x y x*."""
    multiply(x, y, out)
    y = (out[0], out[1], out[2], out[3], out[4], out[5], out[6], out[7])
    multiply(y, (x[0], -x[1], -x[2], -x[3], x[4], -x[5], -x[6], -x[7]), out)


@inline
def cross_twist(a, b, out):
    """Write vec6 of (ab − ba)/2: [ω₁×ω₂ ; ω₁×v₂ + v₁×ω₂]."""
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]
    out[3] = a[1] * b[5] - a[2] * b[4] + a[4] * b[2] - a[5] * b[1]
    out[4] = a[2] * b[3] - a[0] * b[5] + a[5] * b[0] - a[3] * b[2]
    out[5] = a[0] * b[4] - a[1] * b[3] + a[3] * b[1] - a[4] * b[0]


@inline
def adjoint_twist(x, twist, out):
    """Write vec6(x ξ x*) for a unit x: [Rω ; Rv + p × Rω]."""
    rotate(x, twist[0:3], out[0:3])
    rotate(x, twist[3:6], out[3:6])
    px, py, pz = position(x)
    out[3] += py * out[2] - pz * out[1]
    out[4] += pz * out[0] - px * out[2]
    out[5] += px * out[1] - py * out[0]


@inline
def adjoint_matrix(x, out):
    """Write Ad6(x) = [R 0 ; p×R R], row-major, for a unit x."""
    w, i, j, k = x[0], x[1], x[2], x[3]
    p = out[33:36]
    translation(x, p)
    px, py, pz = p[0], p[1], p[2]
    for column in range(3):
        if column == 0:
            a, b, c = 2.0 * (w * w + i * i) - 1.0, 2.0 * (i * j + w * k), 2.0 * (i * k - w * j)
        elif column == 1:
            a, b, c = 2.0 * (i * j - w * k), 2.0 * (w * w + j * j) - 1.0, 2.0 * (j * k + w * i)
        else:
            a, b, c = 2.0 * (i * k + w * j), 2.0 * (j * k - w * i), 2.0 * (w * w + k * k) - 1.0
        out[column], out[6 + column], out[12 + column] = a, b, c
        out[3 + column], out[9 + column], out[15 + column] = 0.0, 0.0, 0.0
        out[18 + column], out[24 + column], out[30 + column] = (
            py * c - pz * b,
            pz * a - px * c,
            px * b - py * a,
        )
        out[21 + column], out[27 + column], out[33 + column] = a, b, c


@inline
def half_twist_product(a, b, c, d, e, f, w, x, y, z, dw, dx, dy, dz):
    """Return vec8(½ξx) of a twist [a b c d e f], given ½x."""
    return (
        -a * x - b * y - c * z,
        a * w + b * z - c * y,
        b * w + c * x - a * z,
        c * w + a * y - b * x,
        -a * dx - b * dy - c * dz - d * x - e * y - f * z,
        a * dw + b * dz - c * dy + d * w + e * z - f * y,
        b * dw + c * dx - a * dz + e * w + f * x - d * z,
        c * dw + a * dy - b * dx + f * w + d * y - e * x,
    )


@inline
def half_angle(r, out):
    """Write a(r) with r = cos|a| + sin|a| a/|a|, |a| ≤ π; not by acos, which loses half the digits near 0."""
    s = math.sqrt(r[1] * r[1] + r[2] * r[2] + r[3] * r[3])
    if s > 0.0:
        scale = math.atan2(s, r[0]) / s
    elif r[0] > 0.0:
        scale = 1.0 / r[0]
    else:
        scale = math.nan  # r = −1: every axis would do
    out[0] = scale * r[1]
    out[1] = scale * r[2]
    out[2] = scale * r[3]


@inline
def half_turn(present, goal, turn, out):
    """Write half the rotation vector, base axes, that turns one pose into another; ``turn`` is scratch."""
    quaternion_product(goal, (present[0], -present[1], -present[2], -present[3]), turn)
    if turn[0] < 0.0:  # the short way round
        turn[0], turn[1], turn[2], turn[3] = -turn[0], -turn[1], -turn[2], -turn[3]
    half_angle(turn, out)


@inline
def exp_quaternion(a, out):
    """Write exp of a pure quaternion: cos|a| + sinc|a| a."""
    square = a[0] * a[0] + a[1] * a[1] + a[2] * a[2]
    angle = math.sqrt(square)
    sinc = math.sin(angle) / angle if angle > 1e-4 else 1.0 - square / 6.0
    out[0] = math.cos(angle)
    out[1] = sinc * a[0]
    out[2] = sinc * a[1]
    out[3] = sinc * a[2]


@inline
def _combine(phi, v, first, second, out):
    """Write v + first φ×v + second φ×(φ×v)."""
    cx = phi[1] * v[2] - phi[2] * v[1]
    cy = phi[2] * v[0] - phi[0] * v[2]
    cz = phi[0] * v[1] - phi[1] * v[0]
    out[0] = v[0] + first * cx + second * (phi[1] * cz - phi[2] * cy)
    out[1] = v[1] + first * cy + second * (phi[2] * cx - phi[0] * cz)
    out[2] = v[2] + first * cz + second * (phi[0] * cy - phi[1] * cx)


@inline
def left_jacobian(phi, v, out):
    """Write V(φ) v, the translation reached by the screw (φ, v)."""
    u = phi[0] * phi[0] + phi[1] * phi[1] + phi[2] * phi[2]
    t = math.sqrt(u)
    if t < _SERIES_BELOW:
        first = 0.5 - u / 24.0 * (1.0 - u / 30.0 * (1.0 - u / 56.0 * (1.0 - u / 90.0)))
        second = 1.0 / 6.0 - u / 120.0 * (1.0 - u / 42.0 * (1.0 - u / 72.0 * (1.0 - u / 110.0)))
    else:
        first = (1.0 - math.cos(t)) / u
        second = (t - math.sin(t)) / (u * t)
    _combine(phi, v, first, second, out)


@inline
def inverse_left_jacobian(phi, v, out):
    """Write V(φ)⁻¹ v."""
    u = phi[0] * phi[0] + phi[1] * phi[1] + phi[2] * phi[2]
    t = math.sqrt(u)
    if t < _SERIES_BELOW:
        second = 1.0 / 12.0 + u * (
            1.0 / 720.0
            + u
            * (1.0 / 30240.0 + u * (1.0 / 1209600.0 + u * (1.0 / 47900160.0 + u * 691.0 / 1307674368000.0)))
        )
    else:
        second = (1.0 - 0.5 * t / math.tan(0.5 * t)) / u
    _combine(phi, v, -0.5, second, out)


@inline
def exp_screw(g, out):
    """Write the group exponential: the pose that the constant twist 2g reaches in one second."""
    rotation = out[0:4]
    exp_quaternion(g[0:3], rotation)
    phi = (2.0 * g[0], 2.0 * g[1], 2.0 * g[2])
    v = (2.0 * g[3], 2.0 * g[4], 2.0 * g[5])
    p = out[5:8]
    left_jacobian(phi, v, p)
    set_pose((out[0], out[1], out[2], out[3]), (out[5], out[6], out[7]), out)


@inline
def log_screw(x, out):
    """Write the group logarithm [a ; ½V⁻¹(2a)p]."""
    half_angle(x, out[0:3])
    translation(x, out[3:6])
    phi = (2.0 * out[0], 2.0 * out[1], 2.0 * out[2])
    p = (0.5 * out[3], 0.5 * out[4], 0.5 * out[5])
    inverse_left_jacobian(phi, p, out[3:6])


@inline
def exp_body(g, out):
    """Write P + εP g_D with P = exp(g_P)."""
    exp_quaternion(g[0:3], out[0:4])
    quaternion_product((out[0], out[1], out[2], out[3]), (0.0, g[3], g[4], g[5]), out[4:8])


@inline
def log_body(x, out):
    """Write [a ; ½p_b]."""
    half_angle(x, out[0:3])
    body_translation(x, out[3:6])
    for i in range(3, 6):
        out[i] *= 0.5


@inline
def exp_inertial(g, out):
    """Write P + εg_D P with P = exp(g_P)."""
    exp_quaternion(g[0:3], out[0:4])
    quaternion_product((0.0, g[3], g[4], g[5]), (out[0], out[1], out[2], out[3]), out[4:8])


@inline
def log_inertial(x, out):
    """Write [a ; ½p]."""
    half_angle(x, out[0:3])
    translation(x, out[3:6])
    for i in range(3, 6):
        out[i] *= 0.5


@inline
def power(x, exponent, out):
    """Write x^t = exp_screw(t log_screw x); exponent is an array of one."""
    t = exponent[0]
    g = out[0:6]
    log_screw(x, g)
    exp_screw((t * g[0], t * g[1], t * g[2], t * g[3], t * g[4], t * g[5]), out)


@inline
def sclerp(x, y, t, out):
    """Write x short(x*y)^t, the screw from x (t = 0) to y (t = 1) the short way; t is an array of one."""
    conjugate_multiply(x, y, out)
    sign = -1.0 if out[0] < 0.0 else 1.0
    step = (
        sign * out[0],
        sign * out[1],
        sign * out[2],
        sign * out[3],
        sign * out[4],
        sign * out[5],
        sign * out[6],
        sign * out[7],
    )
    power(step, t, out)
    multiply(x, (out[0], out[1], out[2], out[3], out[4], out[5], out[6], out[7]), out)

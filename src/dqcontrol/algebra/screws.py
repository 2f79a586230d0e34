"""Exponentials, logarithms and powers: inlined operations on single dual quaternions."""

from __future__ import annotations

import math

from dqcontrol.algebra.elementary import (
    body_translation,
    conjugate_multiply,
    multiply,
    quaternion_product,
    set_pose,
    translation,
)
from dqcontrol.compiled.compile import inline

_SERIES_BELOW = 0.3  # rad; beyond it the closed forms of V and V⁻¹ lose fewer than three digits


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

"""One tick of the closed loop in plain Python, for NumPy and for numba.

The straightforward way: every formula as it is written down, functions of the library,
the observer's root by Newton steps. For NumPy each quantity is a row over the members,
for numba it is one number of one member.

Constants have names and are made of the wanted kind, because numba takes a literal for
double precision.
"""

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import numpy as np


@dataclasses.dataclass(frozen=True)
class Dialect:
    """What NumPy and numba do not share.

    Attributes:
        compiled: decorates every function.
        where: `where(condition, a, b)`, elementwise.
        advance: `advance(out, x, step, slope)` sets out = x + step · slope.
    """

    compiled: Callable[[Any], Any]
    where: Callable[..., Any]
    advance: Callable[..., None]


def make_glider(dialect: Dialect, kind: type) -> tuple[Any, Any, Any]:
    """Hydrodynamics, what the command does, and the rates of the twelve states."""
    one, half, sixth = kind(1), kind(1 / 2), kind(1 / 6)
    c24, c120 = kind(1 / 24), kind(1 / 120)

    @dialect.compiled
    def forces(c, u, v, w, p, q, r):
        """C(ν)ν + D(ν)ν."""
        m1, m2, m3, i1, i2, i3 = c[4], c[5], c[6], c[7], c[8], c[9]
        drag, lift0, lift, side = c[10], c[11], c[12], c[13]
        uu, speed = u * u, np.abs(u)
        su, sv, sw = speed * u, speed * v, speed * w
        pitching = c[16] + c[18] * q
        return (
            m2 * v * r - m3 * w * q + lift0 * sw - drag * su,
            m3 * w * p - m1 * u * r + (side - drag) * sv,
            m1 * u * q - m2 * v * p - lift0 * su - (drag + lift) * sw,
            (m2 - m3) * v * w + (i2 - i3) * q * r + c[15] * p * uu + c[14] * sv,
            (m3 - m1) * u * w + (i3 - i1) * p * r + pitching * uu + c[17] * sw,
            (m1 - m2) * u * v + (i1 - i2) * p * q + c[20] * r * uu + c[19] * sv,
        )

    @dialect.compiled
    def pushes(c, sp, cp, st, ct, mb, rp, gamma):
        """B U + E with the paper's own actuation."""
        weight, g, rb = c[0] * c[3], c[3], c[2]
        arm = weight * c[1]
        g2 = gamma * gamma
        sine = gamma * (one - g2 * sixth + g2 * g2 * c120)
        cosine = g2 * (g2 * c24 - half)
        side, down = ct * sp, ct * cp
        moment = g * rb * mb + weight * rp
        return (
            -g * st * mb,
            g * side * mb,
            g * down * mb,
            -arm * (down * sine - side * cosine) - arm * side,
            -moment * down - arm * st * cosine - arm * st,
            moment * side + arm * st * sine,
        )

    @dialect.compiled
    def derivative(c, x, mb, rp, gamma, sea, share, out):
        """ν' and the Euler kinematics, τ_d linear within the tick."""
        sp, cp, st, ct = np.sin(x[3]), np.cos(x[3]), np.sin(x[4]), np.cos(x[4])
        ss, cs = np.sin(x[5]), np.cos(x[5])
        u, v, w, p, q, r = x[6], x[7], x[8], x[9], x[10], x[11]
        across, below = cp * v - sp * w, sp * v + cp * w
        ahead = ct * u + st * below
        turning = (sp * q + cp * r) / ct
        out[0] = cs * ahead - ss * across
        out[1] = ss * ahead + cs * across
        out[2] = ct * below - st * u
        out[3] = p + st * turning
        out[4] = cp * q - sp * r
        out[5] = turning
        f = forces(c, u, v, w, p, q, r)
        b = pushes(c, sp, cp, st, ct, mb, rp, gamma)
        for i in range(6):
            out[6 + i] = (f[i] + b[i] + sea[0, i] + share * sea[1, i]) / c[4 + i]

    return forces, pushes, derivative


def make_channel(dialect: Dialect, kind: type) -> Any:
    """Error transformation and law of one channel: its demand and A."""
    where = dialect.where
    zero, half, one, two, three, four = map(kind, (0, 0.5, 1, 2, 3, 4))

    @dialect.compiled
    def signed_power(x, a, delta):
        return x * (x * x + delta * delta) ** (half * (a - one))

    @dialect.compiled
    def channel(g, delta, funnel, e, e1, integral):
        k1, k2, rho, mu, lower, upper, tail = g
        width, rate, curve = funnel[0], funnel[1], funnel[2]
        x = e / width
        x1 = (e1 - x * rate) / width
        core = np.minimum(np.maximum(x, -tail * lower), tail * upper)
        left, right = lower + core, upper - core
        slope = half * (one / left + one / right)
        bend = half * (one / (right * right) - one / (left * left))
        bend = where(core == x, bend, zero)
        eps, eps1 = half * np.log(left / right) + slope * (x - core), slope * x1
        offset = bend * x1 * x1 - slope * (two * x1 * rate + x * curve) / width
        over = four - three * rho
        near = signed_power(eps, rho / (two - rho), delta) + eps
        near = near + signed_power(eps, rho, delta)
        far = signed_power(eps1, over / (two - rho), delta) + eps1
        far = far + signed_power(eps1, over / (three - two * rho), delta)
        sliding = k1 * near + k2 * far
        s = eps1 + integral
        power = (s * s + delta * delta) ** (half / mu)
        reaching = (k1 + k2) * s * (power + one + one / power)
        return -(offset + sliding + reaching) * width / slope, sliding

    return channel


def make_observer(dialect: Dialect, kind: type) -> Any:
    """The root y of y + a₁ φ₁(y) + a₂ φ₂(y) = b, and a₂ φ₂ of it."""
    half, one, two, three, four = map(kind, (0.5, 1, 2, 3, 4))
    square, start = kind(1.5), kind(0.41)
    steps = 4 if kind is np.float64 else 3

    @dialect.compiled
    def observed(target, a1, a2, stretch, delta):
        size, floor = np.abs(target), delta * delta
        p0, p2 = half * a2, one + two * a2 * stretch
        p3, p4 = a1 * stretch, square * a2 * stretch * stretch
        k = p2 + a1 / np.sqrt(size + delta)
        rest = np.maximum(size - p0, size * (delta / (delta + p0)))
        y = two * rest / (k + np.sqrt(k * k + four * p4 * rest))
        r = np.sqrt(np.maximum(y, delta) + start * np.minimum(y, delta))
        for _ in range(steps):
            q = r * r
            u, v, w, q2 = a1 * r, p3 * r, p4 * q, q * q
            p = p0 + u + q * (p2 + v + w)
            rise = u + q * (two * p2 + three * v + four * w)
            pulled = target * target * q2
            n = (q2 - floor) * p * p - pulled
            slope = two * (n + two * floor * p * p) * p
            slope = slope + (two * pulled + half * n) * rise
            r = r * np.minimum(np.maximum(one - p * n / slope, half), two)
        q = r * r
        y = target * q / (p0 + a1 * r + q * (p2 + p3 * r + p4 * q))
        q = np.sqrt(y * y + floor)
        return y, y * (p0 / q + two * a2 * stretch + p4 * q)

    return observed


def make_allocation(dialect: Dialect, kind: type) -> Any:
    """The command, U = (gᵀg + damping)⁻¹ gᵀ (demand − f − h d̂)."""
    one, half, sixth = kind(1), kind(1 / 2), kind(1 / 6)
    c24, c120 = kind(1 / 24), kind(1 / 120)

    @dialect.compiled
    def pair(sp, cp, ct, pitch, yaw):
        return cp * pitch - sp * yaw, (sp * pitch + cp * yaw) / ct

    @dialect.compiled
    def allocate(c, damping, x, drift, estimate, held, d0, d1, d2, sp, cp, st, ct):
        u, v, w, p, q, r = x[6], x[7], x[8], x[9], x[10], x[11]
        weight, g, rb = c[0] * c[3], c[3], c[2]
        m1, m2, m3, i2, i3 = c[4], c[5], c[6], c[8], c[9]
        arm = weight * c[1]
        side, down = ct * sp, ct * cp
        pitching, turning = pair(sp, cp, ct, q, r)
        rolling = p + st * turning
        across, below = cp * v - sp * w, sp * v + cp * w
        ax = (drift[0] + estimate[0]) / m1
        ay = (drift[1] + estimate[1]) / m2
        az = (drift[2] + estimate[2]) / m3
        aq = (drift[4] - arm * st + estimate[4]) / i2
        f1, f2 = pair(sp, cp, ct, aq, (drift[5] + estimate[5]) / i3)
        r0 = d0 - ct * (rolling * across - pitching * u) + st * pitching * below
        r0 = r0 - ct * (sp * ay + cp * az) + st * ax
        r1 = d1 + rolling * turning * ct - f1
        r2 = d2 - pitching * (rolling + st * turning) / ct - f2
        h2 = held * held
        sine = one - h2 * sixth + h2 * h2 * c120
        cosine = held * (h2 * c24 - half)
        g00 = g * (ct * (sp * side / m2 + cp * down / m3) + st * st / m1)
        g10, g20 = pair(sp, cp, ct, -g * rb * down / i2, g * rb * side / i3)
        g11, g21 = pair(sp, cp, ct, -weight * down / i2, weight * side / i3)
        g12, g22 = pair(sp, cp, ct, -arm * st * cosine / i2, arm * st * sine / i3)
        a00 = g00 * g00 + g10 * g10 + g20 * g20 + damping[0]
        a11 = g11 * g11 + g21 * g21 + damping[1]
        a22 = g12 * g12 + g22 * g22 + damping[2]
        a01, a02 = g10 * g11 + g20 * g21, g10 * g12 + g20 * g22
        a12 = g11 * g12 + g21 * g22
        b0 = g00 * r0 + g10 * r1 + g20 * r2
        b1, b2 = g11 * r1 + g21 * r2, g12 * r1 + g22 * r2
        c00, c01 = a11 * a22 - a12 * a12, a12 * a02 - a01 * a22
        c02, c11 = a01 * a12 - a11 * a02, a00 * a22 - a02 * a02
        c12, c22 = a01 * a02 - a00 * a12, a00 * a11 - a01 * a01
        determinant = a00 * c00 + a01 * c01 + a02 * c02
        return (
            (c00 * b0 + c01 * b1 + c02 * b2) / determinant,
            (c01 * b0 + c11 * b1 + c12 * b2) / determinant,
            (c02 * b0 + c12 * b1 + c22 * b2) / determinant,
        )

    return allocate


def make_error(dialect: Dialect, kind: type) -> Any:
    """Tracking error of the three channels, heading wrapped."""
    half, whole, least, reach = map(kind, (0.5, 2 * math.pi, 0.02, 0.3))

    @dialect.compiled
    def tracking_error(task, x):
        attack = x[8] / np.maximum(x[6], least)
        attack = np.minimum(np.maximum(attack, -reach), reach)
        turn = x[5] - task[3]
        return (
            x[2] - task[0],
            x[4] - task[2] - attack,
            turn - whole * np.floor(turn / whole + half),
        )

    return tracking_error


def make_sums(dialect: Dialect, kind: type) -> Any:
    """Adds one tick to the running sums of one channel, nine rows."""
    where = dialect.where
    zero, one, four, five, most, least = map(kind, (0, 1, 4, 5, 1e3, 1e-12))

    @dialect.compiled
    def add(sums, at, first, e, width, settled, lower, upper, wanted, applied, held):
        size, short = np.abs(e), wanted - applied
        near = np.maximum(e / (upper * width), -e / (lower * width))
        crowd = np.minimum(np.maximum(five * near - four, zero), most)
        crowd4 = crowd * crowd * crowd * crowd
        sums[at] += e * e
        sums[at + 1] += applied * applied
        if not first:
            sums[at + 2] += (applied - held) * (applied - held)
        sums[at + 3] = np.maximum(sums[at + 3], size)
        sums[at + 4] = np.maximum(sums[at + 4], size * settled)
        sums[at + 5] += where(near > one, one, zero)
        sums[at + 6] += where(short != zero, one, zero)
        sums[at + 7] += crowd4 / (one + crowd4)
        sums[at + 8] += short * short / (applied * applied + short * short + least)

    return add

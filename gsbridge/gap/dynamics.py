"""Kernels of a tree of joints: inverse dynamics and joint-space inertia, in base coordinates."""

from __future__ import annotations

import math

import numpy as np

from gsbridge.geometry import Array
from gsbridge.kernels import njit


@njit(nogil=True)
def place(parents: Array, fixed: Array, axes: Array, slides: Array, q: Array, turn: Array, origin: Array, axis: Array) -> None:
    """Rotations, origins and axes of all joint frames in the base. q [N] -> turn [N, 3, 3], origin [N, 3], axis [N, 3]."""
    local = np.empty((3, 3))
    for k in range(len(q)):
        x, y, z = axes[k, 0], axes[k, 1], axes[k, 2]
        angle = 0.0 if slides[k] else q[k]
        s, c = math.sin(angle), math.cos(angle)
        u = 1.0 - c
        local[0, 0], local[0, 1], local[0, 2] = c + x * x * u, x * y * u - z * s, x * z * u + y * s
        local[1, 0], local[1, 1], local[1, 2] = y * x * u + z * s, c + y * y * u, y * z * u - x * s
        local[2, 0], local[2, 1], local[2, 2] = z * x * u - y * s, z * y * u + x * s, c + z * z * u
        p = parents[k]
        for i in range(3):
            origin[k, i] = fixed[k, i, 3]
        if p >= 0:
            for i in range(3):
                origin[k, i] = origin[p, i]
                for j in range(3):
                    origin[k, i] += turn[p, i, j] * fixed[k, j, 3]
        for i in range(3):
            for j in range(3):
                total = 0.0
                for m in range(3):
                    if p < 0:
                        total += fixed[k, i, m] * local[m, j]
                    else:
                        for n in range(3):
                            total += turn[p, i, n] * fixed[k, n, m] * local[m, j]
                turn[k, i, j] = total
        for i in range(3):
            axis[k, i] = turn[k, i, 0] * x + turn[k, i, 1] * y + turn[k, i, 2] * z
            if slides[k]:
                origin[k, i] += axis[k, i] * q[k]


@njit(nogil=True)
def bias(
    parents: Array, slides: Array, bodies: Array, gravity: Array, v: Array, turn: Array, origin: Array, axis: Array, out: Array
) -> None:
    """Torques that hold the weight and the centrifugal forces: inverse dynamics without acceleration. v [N] -> out [N].

    Args:
        bodies: Mass, centre, inertia about it, joint frames. [N, 13].
        gravity: Acceleration, base frame. [3].
        turn, origin, axis: From `place`.

    Source: Featherstone, Rigid Body Dynamics Algorithms, 2008, section 5.3.
    """
    count = len(v)
    spin, twist, pull = np.zeros((count, 3)), np.zeros((count, 3)), np.zeros((count, 3))
    force, moment = np.zeros((count, 3)), np.zeros((count, 3))
    w, a, c, d, f = np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for k in range(count):
        p = parents[k]
        for i in range(3):
            if p < 0:
                spin[k, i], twist[k, i], pull[k, i], d[i] = 0.0, 0.0, -gravity[i], 0.0
            else:
                spin[k, i], twist[k, i], pull[k, i], d[i] = spin[p, i], twist[p, i], pull[p, i], origin[k, i] - origin[p, i]
        if p >= 0:
            w0, w1, w2 = spin[p, 0], spin[p, 1], spin[p, 2]
            t0, t1, t2 = twist[p, 0], twist[p, 1], twist[p, 2]
            e0, e1, e2 = w1 * d[2] - w2 * d[1], w2 * d[0] - w0 * d[2], w0 * d[1] - w1 * d[0]
            pull[k, 0] += t1 * d[2] - t2 * d[1] + w1 * e2 - w2 * e1
            pull[k, 1] += t2 * d[0] - t0 * d[2] + w2 * e0 - w0 * e2
            pull[k, 2] += t0 * d[1] - t1 * d[0] + w0 * e1 - w1 * e0
            g0, g1, g2 = axis[k, 0] * v[k], axis[k, 1] * v[k], axis[k, 2] * v[k]
            h0, h1, h2 = w1 * g2 - w2 * g1, w2 * g0 - w0 * g2, w0 * g1 - w1 * g0
            if slides[k]:
                pull[k, 0] += 2 * h0
                pull[k, 1] += 2 * h1
                pull[k, 2] += 2 * h2
            else:
                twist[k, 0] += h0
                twist[k, 1] += h1
                twist[k, 2] += h2
        if not slides[k]:
            for i in range(3):
                spin[k, i] += axis[k, i] * v[k]
        for i in range(3):
            w[i], a[i] = spin[k, i], twist[k, i]
            c[i] = turn[k, i, 0] * bodies[k, 1] + turn[k, i, 1] * bodies[k, 2] + turn[k, i, 2] * bodies[k, 3]
        mass = bodies[k, 0]
        e0, e1, e2 = w[1] * c[2] - w[2] * c[1], w[2] * c[0] - w[0] * c[2], w[0] * c[1] - w[1] * c[0]
        f[0] = mass * (pull[k, 0] + a[1] * c[2] - a[2] * c[1] + w[1] * e2 - w[2] * e1)
        f[1] = mass * (pull[k, 1] + a[2] * c[0] - a[0] * c[2] + w[2] * e0 - w[0] * e2)
        f[2] = mass * (pull[k, 2] + a[0] * c[1] - a[1] * c[0] + w[0] * e1 - w[1] * e0)
        iw, ia = np.zeros(3), np.zeros(3)
        for i in range(3):
            lw = turn[k, 0, i] * w[0] + turn[k, 1, i] * w[1] + turn[k, 2, i] * w[2]
            la = turn[k, 0, i] * a[0] + turn[k, 1, i] * a[1] + turn[k, 2, i] * a[2]
            for j in range(3):
                iw[j] += bodies[k, 4 + 3 * j + i] * lw
                ia[j] += bodies[k, 4 + 3 * j + i] * la
        bw, ba = np.zeros(3), np.zeros(3)
        for i in range(3):
            for j in range(3):
                bw[i] += turn[k, i, j] * iw[j]
                ba[i] += turn[k, i, j] * ia[j]
        moment[k, 0] += ba[0] + w[1] * bw[2] - w[2] * bw[1] + c[1] * f[2] - c[2] * f[1]
        moment[k, 1] += ba[1] + w[2] * bw[0] - w[0] * bw[2] + c[2] * f[0] - c[0] * f[2]
        moment[k, 2] += ba[2] + w[0] * bw[1] - w[1] * bw[0] + c[0] * f[1] - c[1] * f[0]
        for i in range(3):
            force[k, i] += f[i]
    for k in range(count - 1, -1, -1):
        out[k] = 0.0
        for i in range(3):
            out[k] += axis[k, i] * (force[k, i] if slides[k] else moment[k, i])
        p = parents[k]
        if p >= 0:
            d0, d1, d2 = origin[k, 0] - origin[p, 0], origin[k, 1] - origin[p, 1], origin[k, 2] - origin[p, 2]
            moment[p, 0] += moment[k, 0] + d1 * force[k, 2] - d2 * force[k, 1]
            moment[p, 1] += moment[k, 1] + d2 * force[k, 0] - d0 * force[k, 2]
            moment[p, 2] += moment[k, 2] + d0 * force[k, 1] - d1 * force[k, 0]
            for i in range(3):
                force[p, i] += force[k, i]


@njit(nogil=True)
def inertia(parents: Array, slides: Array, bodies: Array, turn: Array, origin: Array, axis: Array, out: Array) -> None:
    """Joint-space inertia, by composite bodies about the base's origin. -> out [N, N].

    Source: Featherstone, Rigid Body Dynamics Algorithms, 2008, section 6.2.
    """
    count = len(parents)
    mass, first, about = np.zeros(count), np.zeros((count, 3)), np.zeros((count, 3, 3))
    for k in range(count):
        m = bodies[k, 0]
        c0, c1, c2 = origin[k, 0], origin[k, 1], origin[k, 2]
        c0 += turn[k, 0, 0] * bodies[k, 1] + turn[k, 0, 1] * bodies[k, 2] + turn[k, 0, 2] * bodies[k, 3]
        c1 += turn[k, 1, 0] * bodies[k, 1] + turn[k, 1, 1] * bodies[k, 2] + turn[k, 1, 2] * bodies[k, 3]
        c2 += turn[k, 2, 0] * bodies[k, 1] + turn[k, 2, 1] * bodies[k, 2] + turn[k, 2, 2] * bodies[k, 3]
        mass[k] += m
        first[k, 0] += m * c0
        first[k, 1] += m * c1
        first[k, 2] += m * c2
        half = np.zeros((3, 3))
        for i in range(3):
            for j in range(3):
                for n in range(3):
                    half[i, j] += turn[k, i, n] * bodies[k, 4 + 3 * n + j]
        for i in range(3):
            for j in range(3):
                for n in range(3):
                    about[k, i, j] += half[i, n] * turn[k, j, n]
        square = c0 * c0 + c1 * c1 + c2 * c2
        about[k, 0, 0] += m * (square - c0 * c0)
        about[k, 1, 1] += m * (square - c1 * c1)
        about[k, 2, 2] += m * (square - c2 * c2)
        about[k, 0, 1] -= m * c0 * c1
        about[k, 1, 0] -= m * c0 * c1
        about[k, 0, 2] -= m * c0 * c2
        about[k, 2, 0] -= m * c0 * c2
        about[k, 1, 2] -= m * c1 * c2
        about[k, 2, 1] -= m * c1 * c2
    for k in range(count - 1, -1, -1):
        p = parents[k]
        if p >= 0:
            mass[p] += mass[k]
            for i in range(3):
                first[p, i] += first[k, i]
                for j in range(3):
                    about[p, i, j] += about[k, i, j]
    out[:] = 0.0
    move, spin = np.zeros((count, 3)), np.zeros((count, 3))
    for k in range(count):
        if slides[k]:
            for i in range(3):
                move[k, i] = axis[k, i]
        else:
            for i in range(3):
                spin[k, i] = axis[k, i]
            # Velocity of the base's origin, were it fixed to the turning body.
            move[k, 0] = origin[k, 1] * axis[k, 2] - origin[k, 2] * axis[k, 1]
            move[k, 1] = origin[k, 2] * axis[k, 0] - origin[k, 0] * axis[k, 2]
            move[k, 2] = origin[k, 0] * axis[k, 1] - origin[k, 1] * axis[k, 0]
    f, t = np.empty(3), np.empty(3)
    for k in range(count):
        h, s, o = first[k], spin[k], move[k]
        f[0] = mass[k] * o[0] + s[1] * h[2] - s[2] * h[1]
        f[1] = mass[k] * o[1] + s[2] * h[0] - s[0] * h[2]
        f[2] = mass[k] * o[2] + s[0] * h[1] - s[1] * h[0]
        t[0] = h[1] * o[2] - h[2] * o[1]
        t[1] = h[2] * o[0] - h[0] * o[2]
        t[2] = h[0] * o[1] - h[1] * o[0]
        for i in range(3):
            for j in range(3):
                t[i] += about[k, i, j] * s[j]
        j = k
        while j >= 0:
            value = 0.0
            for i in range(3):
                value += spin[j, i] * t[i] + move[j, i] * f[i]
            out[j, k] = value
            out[k, j] = value
            j = parents[j]

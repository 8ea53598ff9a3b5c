"""Kernels of a tree of joints: inverse dynamics and joint-space inertia, in base coordinates.

The kernels allocate no memory: a replay calls them a thousand times per second of a record, and a bank takes a thousand
replays.
"""

from __future__ import annotations

import math

from gsbridge.geometry import Array
from gsbridge.kernels import njit

LOADS = 10
"""Number of figures of a body about the base's origin: mass, first moments (3), inertia (xx, yy, zz, xy, xz, yz). SI units."""


@njit(nogil=True)
def place(parents: Array, fixed: Array, axes: Array, slides: Array, q: Array, turn: Array, origin: Array, axis: Array) -> None:
    """Compute rotations, origins and axes of all joint frames in the base frame.

    Args:
        parents: Index of the joint that carries each, -1 for the base. [N].
        fixed: Transform from each joint's frame to its parent's at zero. [N, 4, 4].
        axes: Unit axis of each joint in its own frame. [N, 3].
        slides: Whether a joint slides. [N] bool.
        q: Positions, rad or m. [N].
        turn: Result: rotation of each frame. [N, 3, 3].
        origin: Result: origin of each frame, m. [N, 3].
        axis: Result: direction of each joint's axis. [N, 3].
    """
    for k in range(len(q)):
        x, y, z = axes[k, 0], axes[k, 1], axes[k, 2]
        angle = 0.0 if slides[k] else q[k]
        s, c = math.sin(angle), math.cos(angle)
        u = 1.0 - c
        l00, l01, l02 = c + x * x * u, x * y * u - z * s, x * z * u + y * s
        l10, l11, l12 = y * x * u + z * s, c + y * y * u, y * z * u - x * s
        l20, l21, l22 = z * x * u - y * s, z * y * u + x * s, c + z * z * u
        p = parents[k]
        for i in range(3):
            if p < 0:
                a, b, d = fixed[k, i, 0], fixed[k, i, 1], fixed[k, i, 2]
                origin[k, i] = fixed[k, i, 3]
            else:
                r0, r1, r2 = turn[p, i, 0], turn[p, i, 1], turn[p, i, 2]
                a = r0 * fixed[k, 0, 0] + r1 * fixed[k, 1, 0] + r2 * fixed[k, 2, 0]
                b = r0 * fixed[k, 0, 1] + r1 * fixed[k, 1, 1] + r2 * fixed[k, 2, 1]
                d = r0 * fixed[k, 0, 2] + r1 * fixed[k, 1, 2] + r2 * fixed[k, 2, 2]
                origin[k, i] = origin[p, i] + r0 * fixed[k, 0, 3] + r1 * fixed[k, 1, 3] + r2 * fixed[k, 2, 3]
            turn[k, i, 0] = a * l00 + b * l10 + d * l20
            turn[k, i, 1] = a * l01 + b * l11 + d * l21
            turn[k, i, 2] = a * l02 + b * l12 + d * l22
            axis[k, i] = turn[k, i, 0] * x + turn[k, i, 1] * y + turn[k, i, 2] * z
            if slides[k]:
                origin[k, i] += axis[k, i] * q[k]


@njit(nogil=True)
def spread(slides: Array, bodies: Array, turn: Array, origin: Array, axis: Array, screws: Array, loads: Array) -> None:
    """Express joints and bodies about the base's origin.

    Args:
        slides: Whether a joint slides. [N] bool.
        bodies: Mass, kg, centre, m, and inertia about it, kg m2, in the joints' frames. [N, 13].
        turn, origin, axis: Rotations, origins (m) and axes of the joint frames, from `place`. [N, 3, 3], [N, 3], [N, 3].
        screws: Result: velocity that a joint of unit speed gives: angular (3), then linear (3) of the body's point at the
            base's origin. [N, 6].
        loads: Result: figures of each body; see `LOADS`. [N, LOADS].
    """
    for k in range(len(bodies)):
        a0, a1, a2 = axis[k, 0], axis[k, 1], axis[k, 2]
        o0, o1, o2 = origin[k, 0], origin[k, 1], origin[k, 2]
        if slides[k]:
            screws[k, 0], screws[k, 1], screws[k, 2] = 0.0, 0.0, 0.0
            screws[k, 3], screws[k, 4], screws[k, 5] = a0, a1, a2
        else:
            screws[k, 0], screws[k, 1], screws[k, 2] = a0, a1, a2
            screws[k, 3], screws[k, 4], screws[k, 5] = o1 * a2 - o2 * a1, o2 * a0 - o0 * a2, o0 * a1 - o1 * a0
        m = bodies[k, 0]
        r00, r01, r02 = turn[k, 0, 0], turn[k, 0, 1], turn[k, 0, 2]
        r10, r11, r12 = turn[k, 1, 0], turn[k, 1, 1], turn[k, 1, 2]
        r20, r21, r22 = turn[k, 2, 0], turn[k, 2, 1], turn[k, 2, 2]
        x, y, z = bodies[k, 1], bodies[k, 2], bodies[k, 3]
        c0, c1, c2 = o0 + r00 * x + r01 * y + r02 * z, o1 + r10 * x + r11 * y + r12 * z, o2 + r20 * x + r21 * y + r22 * z
        ixx, ixy, ixz, iyy, iyz, izz = bodies[k, 4], bodies[k, 5], bodies[k, 6], bodies[k, 8], bodies[k, 9], bodies[k, 12]
        h00, h01, h02 = r00 * ixx + r01 * ixy + r02 * ixz, r00 * ixy + r01 * iyy + r02 * iyz, r00 * ixz + r01 * iyz + r02 * izz
        h10, h11, h12 = r10 * ixx + r11 * ixy + r12 * ixz, r10 * ixy + r11 * iyy + r12 * iyz, r10 * ixz + r11 * iyz + r12 * izz
        h20, h21, h22 = r20 * ixx + r21 * ixy + r22 * ixz, r20 * ixy + r21 * iyy + r22 * iyz, r20 * ixz + r21 * iyz + r22 * izz
        loads[k, 0], loads[k, 1], loads[k, 2], loads[k, 3] = m, m * c0, m * c1, m * c2
        loads[k, 4] = h00 * r00 + h01 * r01 + h02 * r02 + m * (c1 * c1 + c2 * c2)
        loads[k, 5] = h10 * r10 + h11 * r11 + h12 * r12 + m * (c0 * c0 + c2 * c2)
        loads[k, 6] = h20 * r20 + h21 * r21 + h22 * r22 + m * (c0 * c0 + c1 * c1)
        loads[k, 7] = h00 * r10 + h01 * r11 + h02 * r12 - m * c0 * c1
        loads[k, 8] = h00 * r20 + h01 * r21 + h02 * r22 - m * c0 * c2
        loads[k, 9] = h10 * r20 + h11 * r21 + h12 * r22 - m * c1 * c2


@njit(nogil=True)
def bias(parents: Array, screws: Array, loads: Array, gravity: Array, v: Array, work: Array, out: Array) -> None:
    """Compute the torques that balance weight, centrifugal and Coriolis forces: inverse dynamics without acceleration.

    Args:
        v: Speeds, rad/s or m/s. [N].
        out: Result, N m or N. [N].
        parents: Index of the joint that carries each, -1 for the base. [N].
        screws, loads: From `spread`. [N, 6], [N, LOADS].
        gravity: Acceleration, base frame, m/s2. [3].
        work: Overwritten. [N, 18].

    Source: Featherstone, Rigid Body Dynamics Algorithms, 2008, section 5.3.
    """
    count = len(v)
    for k in range(count):
        p = parents[k]
        s0, s1, s2 = screws[k, 0] * v[k], screws[k, 1] * v[k], screws[k, 2] * v[k]
        o0, o1, o2 = screws[k, 3] * v[k], screws[k, 4] * v[k], screws[k, 5] * v[k]
        if p < 0:
            w0, w1, w2, u0, u1, u2 = s0, s1, s2, o0, o1, o2
            a0, a1, a2, b0, b1, b2 = 0.0, 0.0, 0.0, -gravity[0], -gravity[1], -gravity[2]
        else:
            w0, w1, w2 = work[p, 0] + s0, work[p, 1] + s1, work[p, 2] + s2
            u0, u1, u2 = work[p, 3] + o0, work[p, 4] + o1, work[p, 5] + o2
            a0 = work[p, 6] + w1 * s2 - w2 * s1
            a1 = work[p, 7] + w2 * s0 - w0 * s2
            a2 = work[p, 8] + w0 * s1 - w1 * s0
            b0 = work[p, 9] + u1 * s2 - u2 * s1 + w1 * o2 - w2 * o1
            b1 = work[p, 10] + u2 * s0 - u0 * s2 + w2 * o0 - w0 * o2
            b2 = work[p, 11] + u0 * s1 - u1 * s0 + w0 * o1 - w1 * o0
        work[k, 0], work[k, 1], work[k, 2], work[k, 3], work[k, 4], work[k, 5] = w0, w1, w2, u0, u1, u2
        work[k, 6], work[k, 7], work[k, 8], work[k, 9], work[k, 10], work[k, 11] = a0, a1, a2, b0, b1, b2
        m, h0, h1, h2 = loads[k, 0], loads[k, 1], loads[k, 2], loads[k, 3]
        xx, yy, zz, xy, xz, yz = loads[k, 4], loads[k, 5], loads[k, 6], loads[k, 7], loads[k, 8], loads[k, 9]
        # Momentum of the body, angular and linear.
        n0 = xx * w0 + xy * w1 + xz * w2 + h1 * u2 - h2 * u1
        n1 = xy * w0 + yy * w1 + yz * w2 + h2 * u0 - h0 * u2
        n2 = xz * w0 + yz * w1 + zz * w2 + h0 * u1 - h1 * u0
        f0, f1, f2 = m * u0 + w1 * h2 - w2 * h1, m * u1 + w2 * h0 - w0 * h2, m * u2 + w0 * h1 - w1 * h0
        work[k, 12] = xx * a0 + xy * a1 + xz * a2 + h1 * b2 - h2 * b1 + w1 * n2 - w2 * n1 + u1 * f2 - u2 * f1
        work[k, 13] = xy * a0 + yy * a1 + yz * a2 + h2 * b0 - h0 * b2 + w2 * n0 - w0 * n2 + u2 * f0 - u0 * f2
        work[k, 14] = xz * a0 + yz * a1 + zz * a2 + h0 * b1 - h1 * b0 + w0 * n1 - w1 * n0 + u0 * f1 - u1 * f0
        work[k, 15] = m * b0 + a1 * h2 - a2 * h1 + w1 * f2 - w2 * f1
        work[k, 16] = m * b1 + a2 * h0 - a0 * h2 + w2 * f0 - w0 * f2
        work[k, 17] = m * b2 + a0 * h1 - a1 * h0 + w0 * f1 - w1 * f0
    for k in range(count - 1, -1, -1):
        total = 0.0
        for i in range(6):
            total += screws[k, i] * work[k, 12 + i]
        out[k] = total
        p = parents[k]
        if p >= 0:
            for i in range(12, 18):
                work[p, i] += work[k, i]


@njit(nogil=True)
def weights(
    parents: Array,
    slides: Array,
    bodies: Array,
    gravity: Array,
    turn: Array,
    origin: Array,
    axis: Array,
    work: Array,
    out: Array,
) -> None:
    """Compute the torques that balance the weight alone.

    Args:
        out: Result, N m or N. [N].
        parents, slides, bodies: As in `spread` and `bias`. [N], [N] bool, [N, 13].
        gravity: Acceleration, base frame, m/s2. [3].
        turn, origin, axis: From `place`. [N, 3, 3], [N, 3], [N, 3].
        work: Overwritten. [N, 4] or wider.
    """
    count = len(parents)
    for k in range(count):
        m, x, y, z = bodies[k, 0], bodies[k, 1], bodies[k, 2], bodies[k, 3]
        work[k, 0] = m
        for i in range(3):
            work[k, 1 + i] = m * (origin[k, i] + turn[k, i, 0] * x + turn[k, i, 1] * y + turn[k, i, 2] * z)
    g0, g1, g2 = gravity[0], gravity[1], gravity[2]
    for k in range(count - 1, -1, -1):
        a0, a1, a2, m = axis[k, 0], axis[k, 1], axis[k, 2], work[k, 0]
        if slides[k]:
            out[k] = -m * (a0 * g0 + a1 * g1 + a2 * g2)
        else:
            d0, d1, d2 = work[k, 1] - m * origin[k, 0], work[k, 2] - m * origin[k, 1], work[k, 3] - m * origin[k, 2]
            out[k] = -(a0 * (d1 * g2 - d2 * g1) + a1 * (d2 * g0 - d0 * g2) + a2 * (d0 * g1 - d1 * g0))
        p = parents[k]
        if p >= 0:
            for i in range(4):
                work[p, i] += work[k, i]


@njit(nogil=True)
def inertia(parents: Array, screws: Array, loads: Array, out: Array) -> None:
    """Compute the joint-space inertia.

    Args:
        out: Result, kg m2, kg m or kg. [N, N].
        parents: Index of the joint that carries each, -1 for the base. [N].
        screws, loads: From `spread`; `loads` is changed to the sums over all bodies that each joint carries. [N, 6],
            [N, LOADS].

    Source: Featherstone, Rigid Body Dynamics Algorithms, 2008, section 6.2.
    """
    count = len(parents)
    for k in range(count - 1, -1, -1):
        p = parents[k]
        if p >= 0:
            for i in range(LOADS):
                loads[p, i] += loads[k, i]
    for k in range(count):
        for j in range(count):
            out[k, j] = 0.0
    for k in range(count):
        m, h0, h1, h2 = loads[k, 0], loads[k, 1], loads[k, 2], loads[k, 3]
        xx, yy, zz, xy, xz, yz = loads[k, 4], loads[k, 5], loads[k, 6], loads[k, 7], loads[k, 8], loads[k, 9]
        s0, s1, s2, o0, o1, o2 = screws[k, 0], screws[k, 1], screws[k, 2], screws[k, 3], screws[k, 4], screws[k, 5]
        n0 = xx * s0 + xy * s1 + xz * s2 + h1 * o2 - h2 * o1
        n1 = xy * s0 + yy * s1 + yz * s2 + h2 * o0 - h0 * o2
        n2 = xz * s0 + yz * s1 + zz * s2 + h0 * o1 - h1 * o0
        f0, f1, f2 = m * o0 + s1 * h2 - s2 * h1, m * o1 + s2 * h0 - s0 * h2, m * o2 + s0 * h1 - s1 * h0
        j = k
        while j >= 0:
            value = screws[j, 0] * n0 + screws[j, 1] * n1 + screws[j, 2] * n2
            value += screws[j, 3] * f0 + screws[j, 4] * f1 + screws[j, 5] * f2
            out[j, k] = value
            out[k, j] = value
            j = parents[j]


@njit(nogil=True)
def factorise(matrix: Array, factor: Array) -> None:
    """Compute the Cholesky factor of a positive definite matrix, with its diagonal inverted. [N, N] -> [N, N]."""
    for i in range(len(matrix)):
        for j in range(i + 1):
            total = matrix[i, j]
            for k in range(j):
                total -= factor[i, k] * factor[j, k]
            factor[i, j] = 1.0 / math.sqrt(max(total, 1e-300)) if i == j else total * factor[j, j]


@njit(nogil=True)
def solve(factor: Array, values: Array) -> None:
    """Solve a linear system in place, with the factor from `factorise`. [N, N], [N]."""
    count = len(values)
    for i in range(count):
        total = values[i]
        for k in range(i):
            total -= factor[i, k] * values[k]
        values[i] = total * factor[i, i]
    for i in range(count - 1, -1, -1):
        total = values[i]
        for k in range(i + 1, count):
            total -= factor[k, i] * values[k]
        values[i] = total * factor[i, i]

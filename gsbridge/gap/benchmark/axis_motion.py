"""Simulation kernel of the benchmark's single axis: Runge-Kutta with ten steps per control period of 1 ms."""

from __future__ import annotations

import math

from gsbridge.geometry import Array
from gsbridge.kernels import njit


@njit(nogil=True)
def _pull(time: float, q: float, v: float, torque: float, p: Array) -> float:
    """Return the acceleration of the axis, rad/s2."""
    dry = p[2] * (1.0 + p[20] * math.sin(5.0 * q)) + p[3] * math.exp(-((v / 0.05) ** 2))
    rub = dry * min(max(v / 5e-4, -1.0), 1.0)
    weight = p[21] * (1.0 + p[9]) * math.cos(q)
    total = (1.0 + p[6]) * torque + p[7] - weight - p[1] * v - p[4] * v * abs(v) - rub - p[8] * q
    total += p[19] * math.sin(2 * math.pi * 3.3 * time) - p[18] * q * q * q
    away = (q - 0.4) / 0.12
    total -= p[25] * away * math.exp(-0.5 * away * away) + p[26] * max(q - 0.45, 0.0)
    return total / (p[22] * (1.0 + p[9]) + p[5])


@njit(nogil=True)
def march(wanted: Array, p: Array, q: float, out: Array) -> None:
    """Simulate the axis with ten fine steps per period of the controller.

    Args:
        wanted: Commanded angle in each period of 1 ms, rad. [K].
        p: Parameters of the axis and of the hidden effects, in the order in which `axis_truth` fills them. [27].
        q: Angle at the start, rad; the axis is at rest.
        out: Result: measured angle, measured speed and the controller's torque at the start of each period. [3, K].
    """
    v, step = 0.0, 1e-3 / 10
    time = 0.0
    for k in range(len(wanted)):
        seen, rate = (1.0 + p[14]) * q + p[13], (1.0 + p[14]) * v
        asked = p[23] * (1.0 + p[10]) * (wanted[k] - seen) - p[24] * (1.0 + p[11]) * rate
        asked += (1.0 + p[12]) * p[21] * math.cos(seen)
        asked = min(max(asked, -p[16]), p[16])
        out[0, k], out[1, k], out[2, k] = seen, rate, asked
        for _ in range(10):
            a1 = _pull(time, q, v, asked, p)
            a2 = _pull(time + step / 2, q + step / 2 * v, v + step / 2 * a1, asked, p)
            a3 = _pull(time + step / 2, q + step / 2 * (v + step / 2 * a1), v + step / 2 * a2, asked, p)
            a4 = _pull(time + step, q + step * (v + step / 2 * a2), v + step * a3, asked, p)
            q += step * v + step * step / 6 * (a1 + a2 + a3)
            v += step / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
            time += step

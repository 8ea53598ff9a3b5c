"""Truths of a single axis: its equation of motion, integrated by Runge-Kutta with ten steps per control period.

Nothing here knows the effects of the diagnosis. Under a sampled controller with the torque T, the equation is

    (I + J) a = k T + o + A sin(2 pi f t) - m g l cos(q) - b v - c v |v| - (F (1 + P sin(5 q)) + s exp(-(v / w)^2)) sat(v / e)
              - K q - C q^3 - D x exp(-x^2 / 2) - S max(q - q_s, 0),

where x is the distance from a detent in units of its width, and the saturation function sat replaces the sign of v.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.signal import lfilter

from gsbridge.gap.benchmark.axis_motion import march
from gsbridge.gap.benchmark.hidden_parts import rest_of
from gsbridge.gap.benchmark.trajectories import Course
from gsbridge.geometry import Array

AXIS = {"inertia": 0.06, "moment": 0.2, "gravity": 9.81, "stiffness": 60.0, "damping": 4.0}
"""The axis: moment of inertia, kg m2; mass times lever, kg m; gravity, m/s2; controller gains, N m/rad and N m s/rad."""

NAMES = (
    "viscous", "coulomb", "stribeck", "quadratic_drag", "armature", "torque_gain", "effort_offset", "spring", "link_mass",
    "gain_p", "gain_d", "gravcomp", "encoder_offset", "encoder_scale", "command_delay", "lag", "saturation", "clock_offset",
    "clock_drift",
    "cubic_spring", "shaking", "patchy_friction", "detent", "stop",
)  # fmt: skip
"""Effects that can be hidden; the last five are outside the catalogue."""

_PLACES = {
    "viscous": 1, "coulomb": 2, "stribeck": 3, "quadratic_drag": 4, "armature": 5, "torque_gain": 6, "effort_offset": 7,
    "spring": 8, "link_mass": 9, "gain_p": 10, "gain_d": 11, "gravcomp": 12, "encoder_offset": 13, "encoder_scale": 14,
    "cubic_spring": 18, "shaking": 19, "patchy_friction": 20,
    "detent": 25, "stop": 26,
}  # fmt: skip


def run_axis(course: Course, duration: float, times: Array, hidden: Mapping[str, float]) -> dict[str, Array]:
    """Simulate the axis with hidden effects, and return its log.

    Args:
        course: Commands.
        duration: Length of the course, s.
        times: Times of the samples, s. [T].
        hidden: Sizes of the hidden effects, by name.

    Returns:
        `position`, `velocity`, `effort`. Each [T, 1].
    """
    p = np.zeros(27)
    p[16], p[21], p[22] = np.inf, AXIS["moment"] * AXIS["gravity"], AXIS["inertia"]
    p[23], p[24] = AXIS["stiffness"], AXIS["damping"]
    for name, size in hidden.items():
        if name in _PLACES:
            p[_PLACES[name]] = size
    # A spring with a rest angle other than zero adds a constant torque.
    p[7] += p[8] * rest_of(0)
    if "patchy_friction" in hidden:
        p[2], p[20] = hidden["patchy_friction"], 1.0
    if "saturation" in hidden:
        p[16] = 1.0 / hidden["saturation"]
    grid = np.arange(int(np.ceil(duration * 1000)) + 200) * 1e-3
    dead = hidden.get("command_delay", 0.0)
    wanted = np.array([course(max(t - dead, 0.0))[0] for t in grid])
    if "lag" in hidden:
        wanted = _slow(np.array([course(max(t - dead, 0.0))[0] for t in np.arange(len(grid) * 10) * 1e-4]), hidden["lag"])
    out = np.empty((3, len(grid)))
    # The axis starts at rest, where its encoder measures the first command.
    march(wanted, p, (float(wanted[0]) - p[13]) / (1.0 + p[14]), out)
    late = hidden.get("clock_offset", 0.0) + hidden.get("clock_drift", 0.0) * times
    return {
        "position": np.interp(times - late, grid, out[0])[:, None],
        "velocity": np.interp(times - late, grid, out[1])[:, None],
        "effort": np.interp(times, grid, out[2])[:, None],
    }


def _slow(wanted: Array, seconds: float) -> Array:
    """Apply a first-order filter by the trapezoidal rule on a grid of 0.1 ms, and return every tenth value."""
    share = 1e-4 / (2 * seconds)
    top, bottom = [share / (1 + share)] * 2, [1.0, -(1 - share) / (1 + share)]
    return lfilter(top, bottom, wanted - wanted[0])[::10] + wanted[0]

"""Dry friction of joints as impulses that would bring them to rest, as far as their bounds allow."""

from __future__ import annotations

from gsbridge.geometry import Array
from gsbridge.kernels import njit

SWEEPS = 30
"""Sweeps of the solver over all joints; couplings between joints die out within a few."""


@njit(nogil=True)
def rub(v: Array, inverse: Array, grip: Array, skew: Array, step: float, impulse: Array) -> None:
    """Take speed off joints that rub, one after the other until nothing changes.

    Args:
        v: Speeds at the end of the step without what changes here, rad/s; updated. [N].
        inverse: Inverse of the joint-space inertia; rows of joints that do not rub are not read. [N, N].
        grip: Largest dry friction, N m. [N].
        skew: More of it forwards, less backwards, N m. [N].
        step: Step of time, s.
        impulse: Impulses that act on `v` already, N m s; updated. [N].
    """
    count = len(v)
    for _ in range(SWEEPS if count > 1 else 1):
        most = 0.0
        for i in range(count):
            if not (grip[i] > 0.0 or skew[i] != 0.0):
                continue
            forwards, backwards = max(grip[i] + skew[i], 0.0) * step, max(grip[i] - skew[i], 0.0) * step
            new = min(max(impulse[i] - v[i] / inverse[i, i], -forwards), backwards)
            change = new - impulse[i]
            if change != 0.0:
                impulse[i] = new
                for j in range(count):
                    v[j] += inverse[i, j] * change
                most = max(most, abs(change) * inverse[i, i])
        if most < 1e-12:
            break

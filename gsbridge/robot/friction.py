"""Dry friction of joints: impulses that bring the joints to rest, as far as the bounds of the friction allow."""

from __future__ import annotations

from gsbridge.geometry import Array
from gsbridge.kernels import njit

SWEEPS = 30
"""Largest number of sweeps of the solver over all joints; the coupling between joints converges within a few."""


@njit(nogil=True)
def rub(v: Array, inverse: Array, grip: Array, skew: Array, step: float, impulse: Array) -> None:
    """Slow down joints with dry friction, one after the other, until nothing changes (projected Gauss-Seidel).

    Args:
        v: Speeds at the end of the step, with `impulse` applied, rad/s; updated. [N].
        inverse: Inverse of the joint-space inertia; diagonal entries of joints without friction are not read. [N, N].
        grip: Largest dry friction, N m. [N].
        skew: Dry friction added to `grip` against forward motion and taken off it against backward motion, N m. [N].
        step: Time step, s.
        impulse: Friction impulses that are already included in `v`, N m s; updated. [N].
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

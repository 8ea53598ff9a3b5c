"""Kernels of one step of a joint: a motor behind a soft transmission, dry friction as bounded impulses, a limited rate."""

from __future__ import annotations

from gsbridge.gap.joints.mechanism.dynamics import factorise, solve
from gsbridge.geometry import Array
from gsbridge.kernels import njit
from gsbridge.robot.friction import rub


@njit(nogil=True)
def motor_side(
    q: float,
    motor: float,
    motor_speed: float,
    pull: float,
    damping: float,
    stiffness: float,
    rotor: float,
    compliance: float,
    gap: float,
    step: float,
) -> tuple[float, float]:
    """One implicit step of a motor behind a transmission with play and twist.

    The motor feels `pull - stiffness * angle - damping * speed` and the transmission.

    Returns:
        Angle and speed of the motor.
    """  # fmt: skip
    half = 0.5 * gap
    inertia_rate = rotor / step
    base = rotor / (step * step) + damping / step + stiffness
    right = pull + (inertia_rate * motor_speed) + (rotor / (step * step) + damping / step) * motor
    free = right / base if base > 0.0 else motor
    angle = free
    if abs(free - q) > half or base <= 0.0:
        side = 1.0 if free > q else -1.0
        if base <= 0.0:
            side = 1.0 if pull > 0.0 else -1.0
        angle = (right + (q + side * half) / compliance) / (base + 1.0 / compliance)
    return angle, (angle - motor) / step


@njit(nogil=True)
def advance(
    system: Array, right: Array, grip: Array, skew: Array, step: float, v: Array, impulse: Array, factor: Array, inverse: Array
) -> None:
    """Change of speed of one step, with dry friction as bounds on impulses that would bring the joints to rest.

    Args:
        system: Inertia with all that acts implicitly. [N, N].
        right: Torques, overwritten. [N].
        grip: Largest dry friction. [N].
        skew: More of it forwards, less backwards. [N].
        step: s.
        v: Speeds, updated. [N].
        impulse: Impulses of the last step, the solver's start; updated. [N].
        factor, inverse: Overwritten. [N, N] each.
    """
    count = len(v)
    factorise(system, factor)
    solve(factor, right)
    for i in range(count):
        v[i] += step * right[i]
    dry = False
    for i in range(count):
        if grip[i] > 0.0 or skew[i] != 0.0:
            # Only what rubs needs its row of the inverse.
            dry = True
            inverse[i, :] = 0.0
            inverse[i, i] = 1.0
            solve(factor, inverse[i])
            if impulse[i] != 0.0:
                for j in range(count):
                    v[j] += inverse[i, j] * impulse[i]
        else:
            impulse[i] = 0.0
    if not dry:
        return
    rub(v, inverse, grip, skew, step, impulse)


@njit(nogil=True)
def follow(wanted: Array, most: float) -> Array:
    """Series that follows another by at most `most` per step. [K] -> [K]."""
    out = wanted.copy()
    for k in range(1, len(out)):
        out[k] = out[k - 1] + min(max(wanted[k] - out[k - 1], -most), most)
    return out

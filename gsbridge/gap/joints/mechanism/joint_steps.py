"""Kernels of one step of a joint: a motor behind a soft transmission, dry friction as bounded impulses, a limited rate."""

from __future__ import annotations

import math

from gsbridge.gap.joints.mechanism.dynamics import factorise, solve
from gsbridge.geometry import Array
from gsbridge.kernels import njit
from gsbridge.robot.friction import rub


@njit(nogil=True)
def coupling(rotor: float, damping: float, stiffness: float, compliance: float, step: float) -> tuple[float, float]:
    """Stiffness of a motor against its own step, and that of motor and transmission in a row as the link feels them.

    Both moves are taken at the end of the step. A transmission that is all but rigid then joins the rotor's inertia to the
    link's, where an explicit link would be thrown off by the spring's full force. Both are zero for a motor that nothing
    holds back: it hands its torque on.

    Args:
        rotor: Inertia of the motor, kg m2.
        damping: Damping that acts on the motor, N m s/rad.
        stiffness: Stiffness that acts on the motor, N m/rad.
        compliance: Twist of the transmission per torque, rad/(N m).
        step: Step of time, s.

    Returns:
        Both stiffnesses, N m/rad.
    """
    base = rotor / (step * step) + damping / step + stiffness
    return base, 1.0 / (compliance + 1.0 / base) if base > 0.0 else 0.0


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
) -> float:
    """Angle of a motor at the end of a step, behind a transmission with play and twist whose link is then at `q`.

    The motor feels `pull - stiffness * angle - damping * speed` and the transmission.

    Args:
        q: Angle of the link at the end of the step, rad.
        motor: Angle of the motor at its begin, rad.
        motor_speed: Speed of the motor at its begin, rad/s.
        pull: Torque that depends on neither angle nor speed, N m.
        damping: Damping that acts on the motor, N m s/rad.
        stiffness: Stiffness that acts on the motor, N m/rad.
        rotor: Inertia of the motor, kg m2.
        compliance: Twist of the transmission per torque, above 0, rad/(N m).
        gap: Play of the transmission from end to end, rad.
        step: Step of time, s.

    Returns:
        Angle of the motor at the end of the step, rad.
    """  # fmt: skip
    half = 0.5 * gap
    base = rotor / (step * step) + damping / step + stiffness
    if base <= 0.0:
        return q + math.copysign(half, pull) + compliance * pull
    right = pull + (rotor / step) * motor_speed + (rotor / (step * step) + damping / step) * motor
    free = right / base
    if abs(free - q) <= half:
        return free
    return (right + (q + math.copysign(half, free - q)) / compliance) / (base + 1.0 / compliance)


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
        step: Step of time, s.
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

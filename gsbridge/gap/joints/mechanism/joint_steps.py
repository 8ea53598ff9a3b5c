"""Kernels of one step of a joint: a motor behind a soft transmission, dry friction as bounded impulses, a limited rate."""

from __future__ import annotations

import math

from gsbridge.gap.joints.mechanism.dynamics import factorise, solve
from gsbridge.geometry import Array
from gsbridge.kernels import njit
from gsbridge.robot.friction import rub


@njit(nogil=True)
def transmit(
    q: float,
    motor: float,
    motor_speed: float,
    pull: float,
    damping: float,
    stiffness: float,
    rotor: float,
    low: float,
    high: float,
    compliance: float,
    gap: float,
    step: float,
) -> tuple[float, float, float]:
    """What a transmission with play and twist hands on to a link that is at `q` at the end of a step.

    The motor feels `pull - stiffness * angle - damping * speed`, the transmission, and dry friction that would bring it to
    rest. All moves are taken at the end of the step. A transmission that is all but rigid then joins the rotor's inertia to
    the link's, where an explicit link would be thrown off by the spring's full force.

    Args:
        q: Angle of the link at the end of the step, rad.
        motor: Angle of the motor at its begin, rad.
        motor_speed: Speed of the motor at its begin, rad/s.
        pull: Torque that depends on neither angle nor speed, N m.
        damping: Damping that acts on the motor, N m s/rad.
        stiffness: Stiffness that acts on the motor, N m/rad.
        rotor: Inertia of the motor, kg m2.
        low, high: Dry friction against the motor's motion backwards, at most 0, and forwards, at least 0, N m.
        compliance: Twist of the transmission per torque, above 0, rad/(N m).
        gap: Play of the transmission from end to end, rad.
        step: Step of time, s.

    Returns:
        Torque on the link, N m; how much less it is per angle that the link goes on, N m/rad; and the motor's angle at the end
        of the step, rad. A motor that nothing holds back hands its torque on.
    """
    half = 0.5 * gap
    base = rotor / (step * step) + damping / step + stiffness
    if base <= 0.0:
        return pull, 0.0, q + math.copysign(half, pull) + compliance * pull
    right = pull + (rotor / step) * motor_speed + (rotor / (step * step) + damping / step) * motor
    alone = right - base * motor
    free = (right - min(max(alone, low), high)) / base
    if abs(free - q) <= half:
        return 0.0, 0.0, free
    end = q + math.copysign(half, free - q)
    # What would move the motor beside friction, if it rested.
    whole = alone + (end - motor) / compliance
    if low <= whole <= high:
        return (motor - end) / compliance, 1.0 / compliance, motor
    rubbing = high if whole > high else low
    joined = 1.0 / (compliance + 1.0 / base)
    given = joined * ((right - rubbing) / base - end)
    if given * (free - q) < 0.0:
        # The motor leaves the link behind.
        return 0.0, 0.0, (right - rubbing) / base
    return given, joined, end + compliance * given


@njit(nogil=True)
def advance(
    system: Array, right: Array, grip: Array, skew: Array, step: float, v: Array, impulse: Array, factor: Array, inverse: Array
) -> None:
    """Change of speed of one step, with dry friction as bounds on impulses that would bring the joints to rest.

    Args:
        system: Inertia with all that acts implicitly. [N, N].
        right: Torques, N m, overwritten. [N].
        grip: Largest dry friction, N m. [N].
        skew: More of it forwards, less backwards, N m. [N].
        step: Step of time, s.
        v: Speeds, rad/s, updated. [N].
        impulse: Impulses of the last step, N m s, the solver's start; updated. [N].
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


_YIELDS = 0.01
"""Time in which a surface that something has left comes back, s: its damping is the stiffness times that."""


@njit(nogil=True)
def press(
    parents: Array, screws: Array, tip: int, place: Array, surface: Array, v: Array, step: float, out: Array
) -> tuple[float, float]:
    """Force of a surface on the tool, and what of it grows with the tool's speed at the end of a step.

    Args:
        parents: Index of the joint that carries each, -1 for the base. [N].
        screws: From `spread`. [N, 6].
        tip: Joint that moves the tool.
        place: Of the tool, base frame, m. [3].
        surface: Upward direction (3), height along it (m) and stiffness (N/m). [5].
        v: Speeds, rad/s or m/s. [N].
        step: Step of time, s.
        out: Result: height that the tool gains per motion of each joint. [N].

    Returns:
        Force (N), and how much of it a speed takes away in the step, N s/m; both zero where nothing is touched.
    """
    depth = surface[3] - (surface[0] * place[0] + surface[1] * place[1] + surface[2] * place[2])
    out[:] = 0.0
    if depth <= 0.0:
        return 0.0, 0.0
    speed, k = 0.0, tip
    while k >= 0:
        turns0, turns1, turns2 = screws[k, 0], screws[k, 1], screws[k, 2]
        out[k] = (
            surface[0] * (screws[k, 3] + turns1 * place[2] - turns2 * place[1])
            + surface[1] * (screws[k, 4] + turns2 * place[0] - turns0 * place[2])
            + surface[2] * (screws[k, 5] + turns0 * place[1] - turns1 * place[0])
        )
        speed += out[k] * v[k]
        k = parents[k]
    slows = surface[4] * (step + _YIELDS)
    force = surface[4] * depth - slows * speed
    if force <= 0.0:
        # It is left faster than the surface follows.
        out[:] = 0.0
        return 0.0, 0.0
    return force, slows * step


@njit(nogil=True)
def follow(wanted: Array, most: float) -> Array:
    """Series that follows another by at most `most` per step. [K] -> [K]."""
    out = wanted.copy()
    for k in range(1, len(out)):
        out[k] = out[k - 1] + min(max(wanted[k] - out[k - 1], -most), most)
    return out

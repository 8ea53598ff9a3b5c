"""Kernels of one time step: a motor behind a soft transmission, dry friction as bounded impulses, a surface, a limited rate."""

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
    """Compute the torque that a transmission with play and compliance gives a link that is at `q` at the end of a step.

    On the motor act `pull - stiffness * angle - damping * speed`, the transmission, and dry friction that would bring it to
    rest. All angles and speeds are those at the end of the step (implicit). A nearly rigid transmission then joins the rotor's
    inertia to the link's; in an explicit step, the spring's full force would throw the link off.

    Args:
        q: Angle of the link at the end of the step, rad.
        motor: Angle of the motor at the start of the step, rad.
        motor_speed: Speed of the motor at the start of the step, rad/s.
        pull: Torque that depends on neither angle nor speed, N m.
        damping: Damping that acts on the motor, N m s/rad.
        stiffness: Stiffness that acts on the motor, N m/rad.
        rotor: Inertia of the motor, kg m2.
        low, high: Dry friction against the motor's motion backwards, at most 0, and forwards, at least 0, N m.
        compliance: Twist of the transmission per torque, above 0, rad/(N m).
        gap: Play of the transmission from end to end, rad.
        step: Time step, s.

    Returns:
        Torque on the link, N m; its decrease per angle by which the link goes further, N m/rad; and the motor's angle at the
        end of the step, rad. A motor without inertia, damping and stiffness passes its torque on.
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
    # Torque on the motor, without friction, if it rested.
    whole = alone + (end - motor) / compliance
    if low <= whole <= high:
        return (motor - end) / compliance, 1.0 / compliance, motor
    rubbing = high if whole > high else low
    joined = 1.0 / (compliance + 1.0 / base)
    given = joined * ((right - rubbing) / base - end)
    if given * (free - q) < 0.0:
        # Parts in contact only push: the motor moves away from the link.
        return 0.0, 0.0, (right - rubbing) / base
    return given, joined, end + compliance * given


@njit(nogil=True)
def advance(
    system: Array, right: Array, grip: Array, skew: Array, step: float, v: Array, impulse: Array, factor: Array, inverse: Array
) -> None:
    """Update the speeds by one step; dry friction is an impulse that would bring a joint to rest, within bounds.

    Args:
        system: Joint-space inertia plus all implicit terms. [N, N].
        right: Torques, N m; overwritten. [N].
        grip: Largest dry friction, N m. [N].
        skew: Amount by which it is larger forwards and smaller backwards, N m. [N].
        step: Time step, s.
        v: Speeds, rad/s; updated. [N].
        impulse: Friction impulses of the last step, N m s, from which the solver starts; updated. [N].
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
            # Only joints with dry friction need their rows of the inverse.
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
"""Time constant with which a surface springs back once nothing presses on it, s: its damping is its stiffness times this."""


@njit(nogil=True)
def press(
    parents: Array, screws: Array, tip: int, place: Array, surface: Array, v: Array, step: float, out: Array
) -> tuple[float, float]:
    """Compute the force of a surface on the tool, and its dependence on the tool's speed at the end of the step.

    Args:
        parents: Index of the joint that carries each, -1 for the base. [N].
        screws: From `spread`. [N, 6].
        tip: Joint that moves the tool.
        place: Place of the tool, base frame, m. [3].
        surface: Upward direction (3), height along it (m) and stiffness (N/m). [5].
        v: Speeds, rad/s or m/s. [N].
        step: Time step, s.
        out: Result: derivative of the tool's height by the position of each joint, m/rad or m/m. [N].

    Returns:
        Force, N, and the factor of its implicit term, a mass, kg; both zero if the tool does not touch the surface.
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
        # The tool moves away faster than the surface springs back.
        out[:] = 0.0
        return 0.0, 0.0
    return force, slows * step


@njit(nogil=True)
def follow(wanted: Array, most: float) -> Array:
    """Follow a series with changes of at most `most` per sample. [K] -> [K]."""
    out = wanted.copy()
    for k in range(1, len(out)):
        out[k] = out[k - 1] + min(max(wanted[k] - out[k - 1], -most), most)
    return out

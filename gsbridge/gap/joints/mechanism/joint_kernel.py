"""The law of a driven joint, from command to motion: a set of figures per joint, and the kernel that steps it.

A figure is zero (infinite for limits) if its effect is absent, so that an effect is a change of figures.
"""

from __future__ import annotations

import math
from types import MappingProxyType

import numpy as np

from gsbridge.gap.joints.mechanism.dynamics import LOADS, bias, inertia, place, spread, weights
from gsbridge.gap.joints.mechanism.joint_steps import advance, press, transmit
from gsbridge.geometry import Array
from gsbridge.kernels import njit

LAW = MappingProxyType(
    {
        "stiffness": "N m/rad, of the controller",
        "damping": "N m s/rad, of the controller",
        "gravity_share": "share of the nominal weight that the controller carries",
        "torque_limit": "largest torque that the motor gives, N m",
        "viscous": "N m s/rad",
        "coulomb": "dry friction, N m",
        "coulomb_skew": "dry friction more forwards, less backwards, N m",
        "stribeck": "dry friction more at rest than in motion, N m",
        "stribeck_speed": "speed at which it has fallen to 1/e, rad/s",
        "load_friction": "dry friction per torque on the joint",
        "quadratic": "drag, N m s2/rad2",
        "armature": "inertia of rotor and gear seen from the joint, kg m2",
        "torque_gain": "torque at the joint per torque asked, less one",
        "torque_offset": "added to the torque at the joint, N m",
        "torque_lag": "time constant of the drive, s",
        "torque_delay": "dead time of the drive, s",
        "ripple_sine": "torque ripple, sine part, N m",
        "ripple_cosine": "torque ripple, cosine part, N m",
        "ripple_waves": "waves of the ripple per turn",
        "encoder_offset": "rad",
        "encoder_scale": "measured per true angle, less one",
        "eccentric_sine": "error of an eccentric encoder, sine part, rad",
        "eccentric_cosine": "cosine part, rad",
        "compliance": "twist between motor and joint per torque, rad/(N m)",
        "backlash": "free play between motor and joint, rad",
        "spring": "torque per angle of a cable or spring, N m/rad",
        "spring_rest": "angle at which it pulls nothing, rad",
        "warming": "change of viscous and dry friction per second, share",
        "pull_stiffness": "torque per angle that an observer pulls with, no part of the mechanism, N m/rad",
        "pull_damping": "torque per speed that an observer pulls with, N m s/rad",
    }
)
"""Figures of a joint and their meaning; the kernel takes them as rows in this order."""

ROW = MappingProxyType({name: k for k, name in enumerate(LAW)})

MODE = MappingProxyType({"torque": 0, "free": 0, "pd": 1, "position": 2})

(
    _STIFF, _DAMP, _SHARE, _LIMIT, _VISCOUS, _DRY, _SKEW, _STRIBECK, _STRIBECK_SPEED, _LOAD, _QUADRATIC, _ARMATURE, _GAIN,
    _OFFSET, _LAG, _DELAY, _SINE, _COSINE, _WAVES, _ENC_OFFSET, _ENC_SCALE, _ECC_SINE, _ECC_COSINE, _COMPLIANCE, _BACKLASH,
    _SPRING, _SPRING_REST, _WARMING, _PULL, _PULL_DAMP,
) = range(len(LAW))  # fmt: skip

_YIELDING = 0.3
"""Product of the transmission's compliance and the controller's stiffness against a change in one step, up to which the
transmission counts as rigid. Beyond it, an explicit step of the controller would be unstable."""

_MEETINGS = 4
"""Most times that a step is repeated until the assumption of which links and motors touch agrees with the result."""

_PULLED = 1e-9
"""Torque by weight on a joint, N m, up to which a link begins in the middle of its play, since no side is preferred."""

_RIGID = 1e-7
"""Compliance given to a transmission that has play but no stated compliance, rad/(N m)."""


@njit(nogil=True)
def simulate(
    parents: Array,
    fixed: Array,
    axes: Array,
    slides: Array,
    bodies: Array,
    gravity: Array,
    brain_bodies: Array,
    brain_gravity: Array,
    brain_armature: Array,
    law: Array,
    tip: int,
    tool: Array,
    surface: Array,
    mode: int,
    bandwidth: float,
    target: Array,
    speed: Array,
    extra: Array,
    q0: Array,
    v0: Array,
    start: float,
    step: float,
    every: int,
    centred: bool,
    farthest: float,
    fastest: float,
    out: Array,
) -> int:
    """Step a mechanism under its controller.

    Args:
        parents, fixed, axes, slides, bodies: The tree as it is; joints in its order, as in `dynamics.place` and
            `dynamics.spread`. [N], [N, 4, 4], [N, 3], [N] bool, [N, 13].
        gravity: Gravity as it acts, base frame, m/s2. [3].
        brain_bodies, brain_gravity, brain_armature: Bodies, gravity and inertia of the rotors as the controller's model has
            them. [N, 13], m/s2 [3], kg m2 [N].
        law: Figures of the joints. [len(LAW), N].
        tip: Joint that moves the tool; -1 if there is none.
        tool: Place of the tool in that joint's frame, m. [3].
        surface: What the tool presses on: upward direction (3), height along it (m) and stiffness (N/m). [5].
        mode: One of `MODE`.
        bandwidth: Bandwidth of the servo, rad/s (mode position).
        target, speed, extra: Commands of each step: positions, speeds and torques, SI units. [K, N].
        q0, v0: Positions and speeds at the start, SI units. [N].
        start: Time of the first step, counted from the start of the record, s.
        step: Time step, s.
        every: Physics steps per control step.
        centred: Whether positions move with the mean of a step's two speeds, as under a constant torque, or with the new speed,
            as in game engines.
        farthest, fastest: Distance from zero and speed of a joint from which on the motion counts as diverged, SI units.
        out: Result: measured position and speed, torque that the controller asks for, and true position of the link, SI units.
            [4, K, N].

    Returns:
        Number of steps before the motion diverged; K if it never did.
    """  # fmt: skip
    count, length = len(q0), out.shape[1]
    q, v = q0.copy(), v0.copy()
    turn, origin, axis = np.empty((count, 3, 3)), np.empty((count, 3)), np.empty((count, 3))
    brain_turn, brain_origin, brain_axis = turn.copy(), origin.copy(), axis.copy()
    matrix, brain_matrix, factor, inverse = np.empty((4, count, count))
    hold, brain_hold = np.empty(count), np.empty(count)
    screws, loads, work = np.empty((count, 6)), np.empty((count, LOADS)), np.empty((count, 18))
    asked, delayed, seen_q, seen_v, tilt = np.zeros(count), np.zeros(count), np.empty(count), np.empty(count), np.empty(count)
    grip, impulse, right, pull = np.zeros(count), np.zeros(count), np.empty(count), np.empty(count)
    skew, lows, highs, gives, slopes = np.zeros((5, count))
    end, alone, rubbed, diagonal = np.empty((4, count))
    shift, pulls, damps, stiffs = np.zeros(count), np.zeros(count), np.zeros(count), np.zeros(count)
    motor, motor_speed, before, was = q.copy(), v.copy(), v.copy(), q.copy()
    weighs = mode == 2
    longest = 0.0
    touches, toe, slope, force, slows = tip >= 0 and surface[4] > 0.0, np.zeros(3), np.zeros(count), 0.0, 0.0
    soft, joins = np.zeros(count, dtype=np.bool_), np.zeros(count, dtype=np.bool_)
    for i in range(count):
        weighs = weighs or law[_SHARE, i] != 0.0
        longest = max(longest, law[_DELAY, i])
        soft[i] = law[_COMPLIANCE, i] > 0.0 or law[_BACKLASH, i] > 0.0
    slots = int(math.ceil(longest / step)) + 2
    ring = np.zeros((slots, count))
    for number in range(length):
        for i in range(count):
            if not (abs(v[i]) < fastest and abs(q[i]) < farthest):
                return number
        place(parents, fixed, axes, slides, q, turn, origin, axis)
        spread(slides, bodies, turn, origin, axis, screws, loads)
        bias(parents, screws, loads, gravity, v, work, hold)
        inertia(parents, screws, loads, matrix)
        parted = False
        if touches:
            for i in range(3):
                toe[i] = origin[tip, i]
                for j in range(3):
                    toe[i] += turn[tip, i, j] * tool[j]
            force, slows = press(parents, screws, tip, toe, surface, v, step, slope)
        if number == 0:
            # The start in the play is set by the weight alone, since noise of measured speeds would disturb it. `asked` only
            # serves as storage here; the controller overwrites it below.
            weights(parents, slides, bodies, gravity, turn, origin, axis, work, asked)
            for i in range(count):
                if soft[i]:
                    # The measured position is that of the motor; the link hangs in the transmission by its weight.
                    side = math.copysign(1.0, asked[i]) if abs(asked[i]) > _PULLED else 0.0
                    q[i] -= 0.5 * side * law[_BACKLASH, i] + law[_COMPLIANCE, i] * hold[i]
        true = True
        for i in range(count):
            angle, rate = (motor[i], motor_speed[i]) if soft[i] else (q[i], v[i])
            scale = 1.0 + law[_ENC_SCALE, i]
            seen_q[i], seen_v[i], tilt[i] = scale * angle + law[_ENC_OFFSET, i], scale * rate, scale
            if law[_ECC_SINE, i] != 0.0 or law[_ECC_COSINE, i] != 0.0:
                seen_q[i] += law[_ECC_SINE, i] * math.sin(angle) + law[_ECC_COSINE, i] * math.cos(angle)
                tilt[i] += law[_ECC_SINE, i] * math.cos(angle) - law[_ECC_COSINE, i] * math.sin(angle)
                seen_v[i] += (law[_ECC_SINE, i] * math.cos(angle) - law[_ECC_COSINE, i] * math.sin(angle)) * rate
            true = true and seen_q[i] == q[i]
        if number % every == 0:
            if weighs:
                if not true:
                    place(parents, fixed, axes, slides, seen_q, brain_turn, brain_origin, brain_axis)
                a, b, c = (turn, origin, axis) if true else (brain_turn, brain_origin, brain_axis)
                if mode == 2:
                    spread(slides, brain_bodies, a, b, c, screws, loads)
                    bias(parents, screws, loads, brain_gravity, seen_v, work, brain_hold)
                    inertia(parents, screws, loads, brain_matrix)
                    for i in range(count):
                        brain_matrix[i, i] += brain_armature[i]
                else:
                    weights(parents, slides, brain_bodies, brain_gravity, a, b, c, work, brain_hold)
            if mode == 2:
                for i in range(count):
                    pull[i] = bandwidth * bandwidth * (target[number, i] - seen_q[i])
                    pull[i] += 2.0 * bandwidth * (speed[number, i] - seen_v[i])
            for i in range(count):
                if mode == 1:
                    wanted = law[_STIFF, i] * (target[number, i] - seen_q[i]) + law[_DAMP, i] * (speed[number, i] - seen_v[i])
                    wanted += extra[number, i] + (law[_SHARE, i] * brain_hold[i] if weighs else 0.0)
                elif mode == 2:
                    wanted = brain_hold[i] + extra[number, i]
                    for j in range(count):
                        wanted += brain_matrix[i, j] * pull[j]
                else:
                    wanted = target[number, i] + extra[number, i]
                asked[i] = min(max(wanted, -law[_LIMIT, i]), law[_LIMIT, i])
        for i in range(count):
            out[0, number, i], out[1, number, i], out[2, number, i] = seen_q[i], seen_v[i], asked[i]
            out[3, number, i] = q[i]
            ring[number % slots, i] = asked[i]
            given = asked[i]
            if law[_DELAY, i] > 0.0:
                back = law[_DELAY, i] / step
                whole = int(math.floor(back))
                near = ring[(number - whole) % slots, i] if number >= whole else ring[0, i]
                far = ring[(number - whole - 1) % slots, i] if number > whole else near
                given = near + (back - whole) * (far - near)
            if law[_LAG, i] > 0.0:
                if number == 0:
                    delayed[i] = given
                delayed[i] += (given - delayed[i]) * (1.0 - math.exp(-step / law[_LAG, i]))
                given = delayed[i]
            given = (1.0 + law[_GAIN, i]) * given + law[_OFFSET, i]
            if law[_SINE, i] != 0.0 or law[_COSINE, i] != 0.0:
                phase = law[_WAVES, i] * q[i]
                given += law[_SINE, i] * math.sin(phase) + law[_COSINE, i] * math.cos(phase)
            # What an observer pulls with is no torque of the motor: neither its constant nor friction under load acts on it.
            driven = given
            if law[_PULL, i] != 0.0:
                given += law[_PULL, i] * (target[number, i] - seen_q[i]) + law[_PULL_DAMP, i] * speed[number, i]
            shift[i] = law[_ARMATURE, i]
            worn = 1.0 + law[_WARMING, i] * (start + number * step)
            # The observer's damper acts implicitly, as viscous friction does: a light joint could not be damped explicitly. It
            # acts on the speed that the encoder shows.
            losses = law[_VISCOUS, i] * worn + law[_PULL_DAMP, i] * tilt[i]
            if soft[i]:
                stiff, damp, load = 0.0, 0.0, given
                light = law[_DAMP, i] * step > 0.5 * law[_ARMATURE, i]
                half = 0.5 * law[_BACKLASH, i]
                side = 1.0 if given > 0.0 else -1.0
                # A light motor that pushes the link through a nearly rigid transmission moves with the link as one body.
                yields = law[_COMPLIANCE, i] * (law[_STIFF, i] + law[_DAMP, i] / step)
                joins[i] = light and yields < _YIELDING and (half == 0.0 or side * (motor[i] - q[i]) >= half - 1e-12)
                if (
                    light
                    and not joins[i]
                    and mode == 1
                    and law[_LAG, i] == 0.0
                    and law[_DELAY, i] == 0.0
                    and abs(asked[i]) < law[_LIMIT, i]
                ):
                    # Make the controller part of the implicit step: the motor alone is too light for an explicit one. For other
                    # motors, this would add an inertia that a rigid joint does not have.
                    stiff, damp = law[_STIFF, i] * (1.0 + law[_GAIN, i]), law[_DAMP, i] * (1.0 + law[_GAIN, i])
                    load = given + stiff * motor[i] + damp * motor_speed[i]
                if not joins[i]:
                    # Viscous friction acts in motor and gear, on the motor's side of the play.
                    damp, losses = damp + losses, 0.0
                pulls[i], damps[i], stiffs[i] = load, damp, stiff
            grip[i], skew[i] = law[_DRY, i], law[_SKEW, i]
            if law[_STRIBECK, i] != 0.0:
                share = (motor_speed[i] if soft[i] else v[i]) / law[_STRIBECK_SPEED, i]
                grip[i] += law[_STRIBECK, i] * math.exp(-share * share)
            if law[_LOAD, i] != 0.0:
                grip[i] += law[_LOAD, i] * abs(driven)
            grip[i] *= worn
            if soft[i]:
                shift[i] = law[_ARMATURE, i] if joins[i] else 0.0
                if not joins[i]:
                    lows[i], highs[i] = 0.0, 0.0
                    if law[_ARMATURE, i] > 0.0 or damps[i] > 0.0 or stiffs[i] > 0.0:
                        # Dry friction acts in motor and gear, on the motor's side of play and compliance.
                        lows[i], highs[i] = min(skew[i] - grip[i], 0.0), max(grip[i] + skew[i], 0.0)
                        grip[i], skew[i] = 0.0, 0.0
                    given, parted = 0.0, True
            # With mean speeds, half of the viscous losses act at the new speed. Drag grows with the square of the speed: its
            # slope is twice the drag per speed, so that the two factors cancel.
            shift[i] += step * ((0.5 if centred else 1.0) * losses + law[_QUADRATIC, i] * abs(v[i]))
            right[i] = given - hold[i] - (losses + law[_QUADRATIC, i] * abs(v[i])) * v[i]
            if law[_SPRING, i] != 0.0:
                right[i] -= law[_SPRING, i] * (q[i] - law[_SPRING_REST, i])
        if force > 0.0:
            for i in range(count):
                right[i] += force * slope[i]
                for j in range(count):
                    matrix[i, j] += slows * slope[i] * slope[j]
        for i in range(count):
            matrix[i, i] += shift[i]
            before[i], was[i], end[i] = v[i], q[i], q[i] + step * v[i]
            alone[i], rubbed[i], diagonal[i] = right[i], impulse[i], matrix[i, i]
        for attempt in range(_MEETINGS if parted else 1):
            # Whether a link touches its motor depends on where it ends, which depends on whether they touch: repeat until both
            # agree.
            met = True
            for i in range(count):
                if parted and soft[i] and not joins[i]:
                    given, grows, _ = transmit(
                        end[i], motor[i], motor_speed[i], pulls[i], damps[i], stiffs[i], law[_ARMATURE, i],
                        lows[i], highs[i], max(law[_COMPLIANCE, i], _RIGID), law[_BACKLASH, i], step,
                    )  # fmt: skip
                    met = met and attempt > 0 and grows == slopes[i] and (given < 0.0) == (gives[i] < 0.0)
                    gives[i], slopes[i] = given, grows
            if met and attempt > 0:
                break
            if parted:
                for i in range(count):
                    v[i], impulse[i] = before[i], rubbed[i]
                    right[i], matrix[i, i] = alone[i], diagonal[i]
                    if soft[i] and not joins[i]:
                        right[i] += gives[i] + slopes[i] * (end[i] - q[i] - step * v[i])
                        matrix[i, i] += slopes[i] * step * step
            advance(matrix, right, grip, skew, step, v, impulse, factor, inverse)
            for i in range(count):
                end[i] = q[i] + step * v[i]
        for i in range(count):
            q[i] += step * (0.5 * (before[i] + v[i]) if centred else v[i])
            if soft[i] and joins[i]:
                angle = q[i] + math.copysign(0.5 * law[_BACKLASH, i], pulls[i]) + law[_COMPLIANCE, i] * pulls[i]
                motor_speed[i] = v[i] + (angle - motor[i] - (q[i] - was[i])) / step
                motor[i] = angle
            elif soft[i]:
                # `transmit` places the motor beside a link at `end`, where the new speed leads. With mean speeds, the link is
                # at `q` instead, and the motor is shifted by the same distance.
                _, _, angle = transmit(
                    end[i], motor[i], motor_speed[i], pulls[i], damps[i], stiffs[i], law[_ARMATURE, i],
                    lows[i], highs[i], max(law[_COMPLIANCE, i], _RIGID), law[_BACKLASH, i], step,
                )  # fmt: skip
                motor_speed[i] = (angle - motor[i]) / step
                motor[i] = angle + q[i] - end[i]
    return length

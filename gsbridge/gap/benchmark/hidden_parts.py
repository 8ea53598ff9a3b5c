"""Hidden effects of driven mechanisms that act outside the physics engine: in drive, loads, friction, sensors and commands.

Nothing here knows the effects of the diagnosis.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gsbridge.gap.joints.mechanism.inertials import Inertial, Skeleton
from gsbridge.gap.joints.mechanism.mechanism_model import MechanismModel
from gsbridge.geometry import Array

WAVES = (5.0, 7.0, 9.0, 12.0, 16.0, 10.0, 6.0)
"""Waves of a torque ripple per turn, by the joint's number."""

PHASE = 0.9
"""Phase of torque ripples and of encoder eccentricities, rad."""

SKEW = 0.5
"""Skew of asymmetric dry friction: it is larger forwards and smaller backwards than its mean by this share."""

WHEEL = 0.1
"""Radius of a wheel on a rack, m, by which sizes at revolute joints are converted to sizes at prismatic joints."""

RESTS = (0.4, -0.7, 0.3, 0.9, -0.5, 0.6, -0.2)
"""Rest angles of springs by the joint's number, rad; off-centre, since most cables pull more one way than the other."""

PLACE = np.array([0.03, -0.02, 0.08])
"""Position of a payload in the frame of the last link, m."""

_CREEP = 0.01
"""Speed scale over which asymmetric friction changes between both directions, rad/s."""

_WELL = 0.12
"""Width of a detent, rad."""

_KICKS = 1.5
"""Mean number of kicks per second."""

_KICK = 0.02
"""Duration of a kick, s."""


def size_at(hidden: Mapping[str, float], name: str, joint: str) -> float:
    """Return the size of an effect at a joint; 0 if it is not hidden there.

    Args:
        hidden: Sizes of the hidden effects by `name:joint`, or by `name` if the mechanism has a single joint.
        name: Name of the effect.
        joint: Name of the joint.
    """
    return hidden.get(f"{name}:{joint}", hidden.get(name, 0.0))


def true_links(skeleton: Skeleton, hidden: Mapping[str, float]) -> dict[str, Inertial]:
    """Return the mass properties of the links as they are, without a payload, which no wrong mass of a link changes.

    Args:
        skeleton: The links as described.
        hidden: Sizes of the hidden effects.
    """
    sizes = {link: size_at(hidden, "link_mass", joint) for joint, link in skeleton.child_of.items()}
    return {link: body.scaled(1.0 + sizes.get(link, 0.0)) for link, body in skeleton.inertials.items()}


class _Sizes:
    """Sizes of the hidden effects, joint by joint."""

    def __init__(self, system: MechanismModel, hidden: Mapping[str, float]) -> None:
        self.system, self.hidden = system, hidden

    def __call__(self, name: str) -> Array:
        """Return the sizes of an effect at all joints. [N]."""
        return np.array([size_at(self.hidden, name, joint) for joint in self.system.joints])


class Drive:
    """The drive, which turns the commanded torque into the acting one: dead time, lag, and a supply that sags under load.

    Args:
        system: Model of the mechanism.
        hidden: Sizes of the hidden effects.
        step: Step of the engine, s.
    """

    def __init__(self, system: MechanismModel, hidden: Mapping[str, float], step: float) -> None:
        sizes = _Sizes(system, hidden)
        dead, slow, self._sag = sizes("torque_delay"), sizes("torque_lag"), sizes("sagging")
        self._back = np.round(dead / step).astype(int)
        self._keep = np.where(slow > 0, np.exp(-step / np.where(slow > 0, slow, 1.0)), 0.0)
        self._warm_keep = float(np.exp(-step / 0.3))
        self.acts = bool(dead.any() or slow.any() or self._sag.any())
        self._ring: list[Array] = []
        self._given: Array | None = None
        self._load = np.zeros(len(dead))

    def __call__(self, asked: Array) -> Array:
        """Return the torque that acts in the next step of the engine, N m. [N] -> [N]."""
        self._ring.append(asked)
        longest = int(self._back.max()) + 1
        self._ring = self._ring[-longest:]
        late = np.array([self._ring[max(len(self._ring) - 1 - back, 0)][k] for k, back in enumerate(self._back)])
        if self._given is None:
            self._given = late
        self._given = late + (self._given - late) * self._keep
        self._load = np.abs(late) + (self._load - np.abs(late)) * self._warm_keep
        return self._given / (1.0 + self._sag * self._load)


class Loads:
    """Torques on the joints in addition to those of the motors.

    Args:
        system: Model of the mechanism.
        hidden: Sizes of the hidden effects.
        duration: Length of the course, s.
    """

    def __init__(self, system: MechanismModel, hidden: Mapping[str, float], duration: float) -> None:
        sizes = _Sizes(system, hidden)
        self.steady = sizes("effort_offset")
        self._drag, self._cubic, self._shake = sizes("quadratic_drag"), sizes("cubic_spring"), sizes("shaking")
        self._ripple, self._detent, self._stop = sizes("ripple"), sizes("detent"), sizes("stop")
        self._hysteresis, self._kick = sizes("hysteresis"), sizes("kicks")
        # The hidden viscous friction warms as the known one does.
        self._worn = (system.viscous + sizes("viscous")) * sizes("warming")
        self._waves = np.resize(np.array(WAVES), len(self.steady))
        self._bent = np.zeros(len(self.steady))
        self._begun: Array | None = None
        parts = (self._drag, self._cubic, self._shake, self._ripple, self._detent, self._stop, self._hysteresis)
        self.acts = any(bool(part.any()) for part in (*parts, self._kick, self._worn))
        rng = np.random.default_rng(9)
        self._at = np.sort(rng.uniform(0.0, duration, max(round(_KICKS * duration), 1)))
        self._ways = rng.choice([-1.0, 1.0], len(self._at))

    def __call__(self, q: Array, v: Array, time: float, asked: Array) -> Array:
        """Return the additional torques, N m, for positions, speeds, time and commanded torques. [N], [N], s, [N] -> [N]."""
        if not self.acts:
            return self.steady
        if self._begun is None:
            self._begun, self._last = q.copy(), q.copy()
        extra = self.steady - self._drag * v * np.abs(v) - self._cubic * q**3 + self._shake * np.sin(2 * np.pi * 3.3 * time)
        extra = extra + self._ripple * np.sin(self._waves * q + PHASE) - self._worn * time * v
        away = q - self._begun - 0.1
        extra = extra - self._detent * away / _WELL * np.exp(-0.5 * (away / _WELL) ** 2)
        extra = extra - self._stop * np.maximum(q - self._begun - 0.15, 0.0)
        # Hysteresis: a spring whose stretch is limited to 0.06, beyond which it slips.
        self._bent = np.clip(self._bent + q - self._last, -0.06, 0.06)
        self._last = q.copy()
        extra = extra - self._hysteresis * self._bent
        if self._kick.any():
            near = int(np.searchsorted(self._at, time)) - 1
            if near >= 0 and time - self._at[near] < _KICK:
                extra = extra + self._kick * self._ways[near]
        return extra


class Rubs:
    """Dry friction that depends on position, direction, load or time.

    Args:
        system: Model of the mechanism.
        hidden: Sizes of the hidden effects.
    """

    def __init__(self, system: MechanismModel, hidden: Mapping[str, float]) -> None:
        sizes = _Sizes(system, hidden)
        self._patchy, self._uneven, self._share = sizes("patchy_friction"), sizes("coulomb_asym"), sizes("load_friction")
        self._bump, self._warms, self._steady = sizes("stribeck"), sizes("warming"), system.coulomb + sizes("coulomb")
        parts = (self._patchy, self._uneven, self._share, self._bump, self._steady * self._warms)
        self._acts = any(bool(part.any()) for part in parts)

    def __call__(self, q: Array, v: Array, time: float, asked: Array) -> Array | None:
        """Return the dry friction beyond that in the engine, N m; None if none is hidden. [N], [N], s, [N] -> [N].

        The engine has the known and the hidden Coulomb friction, which `warming` changes as well; below zero, the result takes
        from it, down to no friction at all.
        """
        if not self._acts:
            return None
        dry = self._patchy * (1.0 + np.sin(5 * q)) + self._share * np.abs(asked)
        dry = dry + np.abs(self._uneven) + self._bump * np.exp(-((v / 0.05) ** 2))
        dry = dry + (self._steady + dry) * self._warms * time + SKEW * self._uneven * np.tanh(v / _CREEP)
        return np.maximum(dry, -self._steady)


class Sensors:
    """The encoders: measured positions and speeds.

    Args:
        system: Model of the mechanism.
        hidden: Sizes of the hidden effects.
        duration: Length of the course, s.
    """

    def __init__(self, system: MechanismModel, hidden: Mapping[str, float], duration: float) -> None:
        sizes = _Sizes(system, hidden)
        self._offset, self._scale = sizes("encoder_offset"), 1.0 + sizes("encoder_scale")
        self._off_axis, self._drift, self._slip = sizes("eccentricity"), sizes("drifting"), sizes("slip")
        self._duration, self._along = duration, np.exp(1j * PHASE)
        self._odd = bool(self._off_axis.any() or self._drift.any() or self._slip.any())

    def __call__(self, q: Array, v: Array, time: float) -> tuple[Array, Array]:
        """Return measured positions and speeds for true ones at a time. [N], [N], s -> [N], [N]."""
        seen, rate = self._scale * q + self._offset, self._scale * v
        if not self._odd:
            return seen, rate
        # An eccentric encoder disc: the direction to a mark on the disc, seen from the axis.
        mark = 1.0 + self._off_axis * self._along * np.exp(-1j * q)
        seen = seen + np.angle(mark)
        rate = rate * (1.0 + np.real(-self._off_axis * self._along * np.exp(-1j * q) / mark))
        seen = seen + self._drift * (1.0 - np.exp(-2.0 * time / self._duration)) + self._slip * (time > 0.4 * self._duration)
        return seen, rate

    def place(self, wanted: Array) -> Array:
        """Return the true positions at which the encoders measure given ones at the start. [N] -> [N]."""
        q = (wanted - self._offset) / self._scale
        for _ in range(4):
            q = q - (self(q, np.zeros_like(q), 0.0)[0] - wanted)
        return q


class Commands:
    """The path of the commands to the controller: delay, filter and rate limit.

    Args:
        system: Model of the mechanism.
        hidden: Sizes of the hidden effects.
        first: First command. [N].
        period: Time between two commands, s.
    """

    def __init__(self, system: MechanismModel, hidden: Mapping[str, float], first: Array, period: float) -> None:
        self.dead, self._slow, self._period = hidden.get("command_delay", 0.0), hidden.get("lag", 0.0), period
        slowness = _Sizes(system, hidden)("rate_limit")
        self._most = np.where(slowness > 0, period / np.where(slowness > 0, slowness, 1.0), np.inf)
        self._sent, self._filtered, self._wanted = first, first, first

    def __call__(self, command: Array) -> Array:
        """Return the command that reaches the controller. [N] -> [N]."""
        before, self._sent = self._sent, command
        if self._slow:
            # Exact response of the first-order filter to a ramp from the last command to this one: the output trails by the
            # ramp's rise in one time constant, plus the decaying remainder of the last difference.
            behind = (command - before) * (self._slow / self._period)
            self._filtered = command - behind + (self._filtered - before + behind) * np.exp(-self._period / self._slow)
        else:
            self._filtered = command
        # What limits the rate comes behind the filter.
        self._wanted = self._wanted + np.clip(self._filtered - self._wanted, -self._most, self._most)
        return self._wanted


def rest_of(joint: int, slides: bool = False) -> float:
    """Return the rest position of a spring at a joint of this number, rad, or m if the joint is prismatic."""
    return RESTS[joint % len(RESTS)] * (WHEEL if slides else 1.0)


def true_parameters(name: str, size: float, joint: int, slides: bool = False) -> dict[str, float]:
    """Return the parameters that a perfect diagnosis would give; empty if the size is the first and only one.

    Args:
        name: Name of the effect, without its joint.
        size: Size of the effect, in its unit.
        joint: Number of the joint on which it acts.
        slides: Whether that joint is prismatic.
    """
    if name == "spring":
        return {"stiffness": size, "rest": rest_of(joint, slides)}
    if name == "coulomb_asym":
        return {"torque": abs(size), "skew": SKEW * size}
    if name == "eccentricity":
        return {"sine": -size * float(np.cos(PHASE)), "cosine": size * float(np.sin(PHASE))}
    if name == "ripple":
        return {"sine": size * float(np.cos(PHASE)), "cosine": size * float(np.sin(PHASE)), "waves": WAVES[joint % len(WAVES)]}
    if name == "base_tilt":
        return {"about_x": 0.0, "about_y": size}
    if name == "payload":
        return {"mass": size, **dict(zip("xyz", PLACE.tolist(), strict=True))}
    return {}

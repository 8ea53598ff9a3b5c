"""Inertias that no link can have, and those that a description states for the sake of having one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gsbridge.gap.joints.mechanism.replay import Mechanism

_LINKS = 3
"""Smallest number of links of one inertia that is no chance."""

_ALIKE = 1e-6
"""Largest difference of moments of inertia, as a share, at which they count as equal."""

_HEAVIER = 1.5
"""Ratio of the largest to the smallest mass from which on links of one inertia cannot all be what they say."""

_BALL = 0.5
"""Radius of a ball with a link's mass and inertia, m, above which the inertia is not that of an arm's link."""

_MATTERS = 0.1
"""Least share of the inertia about some joint that placeholders must have to matter."""

_POSSIBLE = 1.5
"""Ratio of a principal moment to the sum of the other two from which on it is told. No body has more than 1; published
descriptions have up to 1.16 (UFACTORY's xArm 6), which matters little."""

_FAR = 0.5
"""Radius of gyration, m, up to which a link's inertia is never doubted; a mechanism that is larger may have larger ones."""


def impossible_told(mechanism: Mechanism) -> str:
    """Tell in words of moved links with an inertia that no body of their size has; empty where there are none.

    Published descriptions hold such, from another unit or a slip. Replays with them are wrong in a way that another mass,
    friction or ripple of the torque partly makes up for.

    Args:
        mechanism: The mechanism.
    """
    links, told = mechanism.chain.links, []
    strokes = [np.abs(mechanism.system.limits[k]).max() for k in mechanism.chain.order[mechanism.chain.slides]]
    lengths = [*(float(np.linalg.norm(pose[:3, 3])) for pose in mechanism.chain.fixed), float(np.linalg.norm(mechanism.toe))]
    reach = max(sum(lengths) + sum(strokes), _FAR)
    for name, body in mechanism.skeleton.inertials.items():
        if links[name][0] < 0 or body.mass <= 0.0:
            continue
        moments = np.linalg.eigvalsh(body.inertia)
        if moments[2] > _POSSIBLE * (moments[0] + moments[1]) + 1e-12:
            told.append(
                f"{moments[2]:.3g} kg m2 of '{name}' exceed the sum of its other two principal moments, which no body has"
            )
        elif moments[2] > body.mass * max(reach, float(np.linalg.norm(body.centre))) ** 2:
            told.append(
                f"'{name}' turns as if its {body.mass:.3g} kg were {np.sqrt(moments[2] / body.mass):.2g} m from its middle"
            )
    return f"{'; '.join(told)}: correct the description, since no effect stands for a wrong inertia" if told else ""


def placeholder_told(mechanism: Mechanism) -> str:
    """Tell in words of moved links whose inertia is a placeholder that matters; empty where there are none.

    PyBullet's own Panda states 0.1 kg m2 about each axis of every link, from 0.1 to 3 kg, which doubles the inertia about its
    first joint. No effect of the catalogue stands for that.

    Args:
        mechanism: The mechanism.
    """
    links = mechanism.chain.links
    inertials, told = mechanism.skeleton.inertials, list[str]()
    groups: list[tuple[float, list[str]]] = []
    for name, body in inertials.items():
        moment = float(body.inertia[0, 0])
        if links[name][0] < 0 or body.mass <= 0.0 or moment <= 0.0:
            continue
        if np.abs(body.inertia - moment * np.eye(3)).max() > _ALIKE * moment:
            continue
        alike = next((names for about, names in groups if abs(about - moment) <= _ALIKE * moment), None)
        if alike is None:
            groups.append((moment, [name]))
        else:
            alike.append(name)
    rest = np.zeros(len(mechanism.system.joints))
    for moment, names in groups:
        masses = [inertials[name].mass for name in names]
        odd = max(masses) >= _HEAVIER * min(masses) or 2.5 * moment > _BALL**2 * min(masses)
        if len(names) < _LINKS or not odd:
            continue
        without = inertials | {name: replace(inertials[name], inertia=np.zeros((3, 3))) for name in names}
        left = np.diag(mechanism.inertia(rest, without)) / np.diag(mechanism.inertia(rest))
        if left.min() <= 1.0 - _MATTERS:
            told.append(
                f"{len(names)} links of {min(masses):.2g} to {max(masses):.2g} kg all have {moment:.3g} kg m2 about each axis"
            )
    return f"{'; '.join(told)}: placeholders, it seems. Correct them: no effect stands for a wrong inertia" if told else ""

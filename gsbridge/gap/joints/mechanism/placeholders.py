"""Inertias that a description states for the sake of having one: the same about every axis of links of different masses."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gsbridge.robot.urdf import InertialElement

_LINKS = 3
"""Smallest number of links of one inertia that is no chance."""

_ALIKE = 1e-6
"""Largest difference of moments of inertia, as a share, at which they count as equal."""

_HEAVIER = 1.5
"""Ratio of the largest to the smallest mass from which on links of one inertia cannot all be what they say."""


def placeholder_told(inertials: Mapping[str, InertialElement]) -> str:
    """Tell in words of links whose inertia is a placeholder; empty where there are none.

    PyBullet's own Panda states 0.1 kg m2 about each axis of every link, from 0.1 to 3 kg, which doubles the inertia about its
    first joint. No effect of the catalogue stands for that.

    Args:
        inertials: Mass properties by link.
    """
    groups: list[tuple[float, list[float]]] = []
    for element in inertials.values():
        moment, mass = float(element.tensor[0, 0]), element.mass
        if mass <= 0.0 or moment <= 0.0 or np.abs(element.tensor - moment * np.eye(3)).max() > _ALIKE * moment:
            continue
        masses = next((masses for about, masses in groups if abs(about - moment) <= _ALIKE * moment), None)
        if masses is None:
            groups.append((moment, [mass]))
        else:
            masses.append(mass)
    told = [
        f"{len(masses)} links of {min(masses):.2g} to {max(masses):.2g} kg all have {moment:.3g} kg m2 about each axis"
        for moment, masses in groups
        if len(masses) >= _LINKS and max(masses) >= _HEAVIER * min(masses)
    ]
    return (
        f"{'; '.join(told)}: placeholders, it seems. Correct them, since no effect stands for a wrong inertia" if told else ""
    )

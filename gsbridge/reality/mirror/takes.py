"""Takes: ways to film an object by hand other than the plain walk around it with locked exposure and a level phone."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from gsbridge.cameras import Camera
from gsbridge.configuration.films import Take
from gsbridge.geometry import Array
from gsbridge.reality.mirror.lens import phone
from gsbridge.reality.mirror.path import object_path

_ONE_HEIGHT_DEG = (34.0, 34.0)
"""First and last elevation of a walk at one height, as by a person who films while seated, degrees."""
_STOPS = 0.55
"""Largest change of the exposure in either direction, in stops (powers of two)."""
_CASTS = 0.05
"""Largest relative change of red and of blue by the white balance."""


def take_camera(take: Take | None, width: int, height: int) -> Camera:
    """Return the camera of a film's pictures as they are stored.

    Args:
        take: The take; None for a plain film.
        width, height: Size of a plain film, px; a phone that is held upright swaps them.
    """
    camera = phone(width, height)
    if take != "portrait":
        return camera
    # Sensor and lens make a quarter turn together, so the tangential coefficients turn with the axes.
    k1, k2, p1, p2 = camera.distortion
    return replace(
        camera,
        width=height,
        height=width,
        fx=camera.fy,
        fy=camera.fx,
        cx=height - camera.cy,
        cy=camera.cx,
        distortion=(k1, k2, p2, -p1),
    )


def take_path(take: Take | None, frames: int, height: float, rng: np.random.Generator) -> Array:
    """Return the camera poses of a film of an object.

    Args:
        take: The take; None for a plain film.
        frames: Number of frames.
        height: Height of the object, m.
        rng: Random numbers.

    Returns:
        cam_from_table. [frames, 4, 4].
    """
    walk = partial(object_path, elevation_deg=_ONE_HEIGHT_DEG) if take == "one_height" else object_path
    poses = walk(frames, height, rng)
    if take != "turned":
        return poses
    # The phone is held upright, but its pictures are stored in the sensor's orientation: the scene lies on its side in them.
    aside = np.array([[0.0, 1, 0, 0], [-1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    return np.asarray(aside @ poses)


def take_gains(take: Take | None, frames: int, rng: np.random.Generator) -> Array:
    """Return the factors on linear light that the camera's automatic exposure and white balance set.

    Args:
        take: The take; None for a plain film.
        frames: Number of frames.
        rng: Random numbers.

    Returns:
        Factors on red, green and blue of each frame. [frames, 3].
    """
    if take != "re_exposing":
        return np.ones((frames, 3))
    t = np.linspace(0, 1, frames)
    # The exposure drifts smoothly, as automatic exposure does while it searches, with an occasional step.
    phases = rng.uniform(0, 2 * np.pi, (3, 2))
    waves = [(np.sin(2 * np.pi * 1.7 * t + a) + np.sin(2 * np.pi * 4.1 * t + b)) / 2 for a, b in phases]
    steps = np.cumsum(rng.choice([-0.5, 0.0, 0.5], frames, p=[0.04, 0.92, 0.04]))
    stops = _STOPS * np.clip(waves[0] + steps - steps.mean() - 0.25, -1, 1)
    cast = np.stack([1 + _CASTS * waves[1], np.ones(frames), 1 + _CASTS * waves[2]], axis=-1)
    return np.asarray(cast * 2 ** stops[:, None])

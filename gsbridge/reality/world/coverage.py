"""Visibility in a Mitsuba scene: which pixels show given bodies, and which points a camera sees."""

from __future__ import annotations

from collections.abc import Set
from typing import Any

import numpy as np

from gsbridge.cameras import Camera
from gsbridge.geometry import Array
from gsbridge.reality.mirror.path_tracer import COMPILED


def shows(mi: Any, scene: Any, sensor: Any, camera: Camera, names: Set[str]) -> Array:
    """Return whether the middle of each pixel shows one of the named instances. [H, W] bool.

    Args:
        mi: The Mitsuba module.
        scene: The scene.
        sensor: Mitsuba's sensor of the camera, one sample per pixel.
        camera: The camera that the sensor was made from.
        names: Names of instances in the scene.
    """
    if mi.variant() == COMPILED:
        return _instances_shown(mi, scene, sensor, camera, names)
    integrator = mi.load_dict({"type": "aov", "aovs": "shape:shape_index"})
    picture = np.array(mi.render(scene, sensor=sensor, integrator=integrator, seed=0))
    # In this integrator's output, Mitsuba numbers shapes from one.
    numbers = [number for number, shape in enumerate(scene.shapes(), 1) if shape.id() in names]
    return np.isin(np.rint(picture[..., -1]).astype(int), numbers)


def _instances_shown(mi: Any, scene: Any, sensor: Any, camera: Camera, names: Set[str]) -> Array:
    """Do the same for the compiled variant, by tracing a ray through each pixel: its `shape_index` numbers the shapes inside
    instances, not the instances."""
    import drjit

    index = np.arange(camera.width * camera.height)
    column, row = index % camera.width, index // camera.width
    place = mi.Point2f(mi.Float((column + 0.5) / camera.width), mi.Float((row + 0.5) / camera.height))
    ray, _ = sensor.sample_ray(0.0, 0.0, place, mi.Point2f(0.5))
    met = drjit.reinterpret_array(mi.UInt32, scene.ray_intersect_preliminary(ray, coherent=True).instance)
    pointers = [mi.ShapePtr(shape) for shape in scene.shapes() if shape.id() in names]
    numbers = [np.array(drjit.reinterpret_array(mi.UInt32, pointer)).item() for pointer in pointers]
    return np.isin(np.array(met), numbers).reshape(camera.height, camera.width)


def points_seen(mi: Any, scene: Any, sensor: Any) -> Array:
    """Return the first point that one ray through each pixel hits, in the scene's frame, m; infinity where it hits nothing.

    Args:
        mi: The Mitsuba module.
        scene: The scene.
        sensor: Mitsuba's sensor of the camera, one sample per pixel, since points of several surfaces must not be averaged.

    Returns:
        Points. [H, W, 3].
    """
    integrator = mi.load_dict({"type": "aov", "aovs": "place:position,far:depth"})
    channels = np.array(mi.render(scene, sensor=sensor, integrator=integrator, seed=0), np.float64)
    # The last four channels are the requested ones; a ray that leaves the scene has the depth 0.
    return np.where(channels[..., -1:] > 0.0, channels[..., -4:-1], np.inf)

"""What every renderer of the wrist camera has in common: the interface and the intrinsics."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol, runtime_checkable

import numpy as np

from gsbridge.cameras import Camera
from gsbridge.environment.litter import FlatThing
from gsbridge.errors import InputError
from gsbridge.geometry import Array

FIELD_OF_VIEW = np.deg2rad(42.5)
"""Field of view of the square picture, rad: the middle of a RealSense D435i's colour image. Source: RL-GSBridge's code."""


def wrist_camera(size: int, field_of_view: float = FIELD_OF_VIEW) -> Camera:
    """Intrinsics of the square wrist picture, principal point in the middle.

    Args:
        size: Edge, px.
        field_of_view: Angle that the picture's edge spans, rad.

    Raises:
        InputError: Size or angle make no picture.
    """
    if size < 1 or not 0.05 < field_of_view < 2.5:
        raise InputError(
            "wrist camera", f"{size} px and {field_of_view} rad make no picture", "Give at least 1 px and 0.05 to 2.5 rad"
        )
    focal = size / 2 / np.tan(field_of_view / 2)
    return Camera(size, size, focal, focal, size / 2, size / 2)


@runtime_checkable
class Renderer(Protocol):
    """Draws the wrist camera's picture of bodies at given poses."""

    camera: Camera
    lying: Sequence[FlatThing]
    """Flat things on the table; whoever draws an episode sets them."""

    def render(self, body_poses: Mapping[str, Array], cam_from_table: Array) -> Array:
        """The picture.

        Args:
            body_poses: `table_from_body` by name; bodies that nothing is drawn for (frames) are ignored. [4, 4] each.
            cam_from_table: OpenCV axes. [4, 4].

        Returns:
            sRGB. [H, W, 3] uint8.
        """

    def draw(self, body_poses: Mapping[str, Array], cam_from_table: Array) -> Array:
        """The picture before `render` rounds it, for further processing.

        Args:
            body_poses, cam_from_table: As in `render`. [4, 4] each.

        Returns:
            sRGB 0..1; overlapping splats may add up to more. [H, W, 3] float32.
        """


def check_drawn(names: tuple[str, ...], body_poses: Mapping[str, Array]) -> None:
    """Check that every drawn body has a pose. [4, 4] each.

    Raises:
        InputError: A body is missing: the splats or meshes belong to another robot.
    """
    missing = [name for name in names if name not in body_poses]
    if missing:
        raise InputError(
            "renderer", f"the world has no pose of {', '.join(missing)}", "Build splats and world from the same robot"
        )


class BlankRenderer:
    """Draws nothing, for trials that look at states only.

    Args:
        size: Edge of the picture, px.
    """

    def __init__(self, size: int) -> None:
        self.camera = wrist_camera(size)
        self.lying: Sequence[FlatThing] = ()
        self._picture = np.zeros((size, size, 3), np.uint8)

    def render(self, body_poses: Mapping[str, Array], cam_from_table: Array) -> Array:
        """The picture, black; see `Renderer`. [H, W, 3] uint8."""
        return self._picture

    def draw(self, body_poses: Mapping[str, Array], cam_from_table: Array) -> Array:
        """The picture, black; see `Renderer`. [H, W, 3] float32."""
        return self._picture.astype(np.float32)

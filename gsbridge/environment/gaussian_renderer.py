"""The wrist camera's picture from splats: background, object and robot in one call of the rasteriser."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from gsbridge.cameras import Camera
from gsbridge.environment.litter import FlatThing, lay
from gsbridge.environment.rendering import check_drawn
from gsbridge.environment.robot_splats import mean_cloud_colour
from gsbridge.geometry import Array
from gsbridge.meshes import Mesh
from gsbridge.scene.groups import GroupedComposition
from gsbridge.scene.shadows import Shadows
from gsbridge.scene.underlay import with_underlay
from gsbridge.scene.view import Shot, draw_seen, pooled, shot_of, to_bytes
from gsbridge.splats.cloud import Cloud
from gsbridge.splats.rasterize.cpu import Seen

OBJECT = "object"

OVERSAMPLING = 2
"""Pixels that are drawn along each edge of one pixel of the picture."""


class GaussianRenderer:
    """Renderer of one object on one background with one robot.

    Args:
        item: Splats of the object, body frame.
        background: Splats of the background, table frame.
        surface: Mesh of the background, for the layer that closes the gaps between its splats; None leaves that out.
        robot: Splats of the links, link frames.
        camera: Pinhole.
        backdrop: Colour where there is no splat at all, sRGB 0..1; None for the background's mean colour. [3].
        threads: Threads of the rasteriser; one by default, since environments run in parallel.
        oversampling: Pixels to draw along each edge of one of the picture's.
        shadows: Shadows of robot and object, which dim the picture; None for the light of the films alone.

    The rasteriser widens each splat to about a pixel, which draws an object of ten pixels half as large again. A policy that
    learns from such pictures takes real objects for farther away. So the picture is drawn with more pixels and averaged, and a
    widened splat gives up opacity in the proportion in which its area grows.

    Source: Wu et al., RL-GSBridge, equation 3 (see `gsbridge.scene.editing`).
    """

    def __init__(
        self,
        item: Cloud,
        background: Cloud,
        robot: Mapping[str, Cloud],
        camera: Camera,
        *,
        surface: Mesh | None = None,
        backdrop: Sequence[float] | None = None,
        threads: int = 1,
        oversampling: int = OVERSAMPLING,
        shadows: Shadows | None = None,
    ) -> None:
        self.camera, self.threads, self.shadows = camera, threads, shadows
        self.lying: Sequence[FlatThing] = ()
        self._box = item.bounds()
        self._oversampling, self._fine = oversampling, camera.scaled(oversampling)
        colour = mean_cloud_colour(background) if backdrop is None else backdrop
        self.backdrop = np.array(colour, np.float32)
        floor = background if surface is None else with_underlay(background, surface)
        self.composition = GroupedComposition({OBJECT: item, **robot}, floor)

    def __len__(self) -> int:
        """Splats drawn."""
        return len(self.composition)

    def see(self, body_poses: Mapping[str, Array], cam_from_table: Array) -> Seen:
        """Find the groups of the bodies' splats that the camera sees, without drawing them. [4, 4] each.

        Raises:
            InputError: A drawn body has no pose.
        """
        check_drawn(self.composition.names, body_poses)
        return self.composition.see(body_poses, self._fine, cam_from_table)

    def render(self, body_poses: Mapping[str, Array], cam_from_table: Array) -> Array:
        """The picture; see `Renderer`. [H, W, 3] uint8."""
        return to_bytes(self.draw(body_poses, cam_from_table))

    def draw(self, body_poses: Mapping[str, Array], cam_from_table: Array) -> Array:
        """The picture before it is rounded; see `Renderer`. [H, W, 3] float32."""
        return self._drawn(body_poses, cam_from_table)[0]

    def shot(self, body_poses: Mapping[str, Array], cam_from_table: Array) -> Shot:
        """The picture with alpha and depth; its `coverage` tells how much of the view the splats fill.

        Args:
            body_poses, cam_from_table: As in `render`. [4, 4] each.
        """
        return shot_of(*self._drawn(body_poses, cam_from_table))

    def coverage(self, body_poses: Mapping[str, Array], cam_from_table: Array) -> float:
        """Mean alpha of a view from bodies and camera at their poses [4, 4]: 1 where no hole shows the backdrop."""
        return self.shot(body_poses, cam_from_table).coverage

    def _drawn(self, body_poses: Mapping[str, Array], cam_from_table: Array) -> tuple[Array, Array, Array]:
        """Draw the bodies at their poses, with litter and shadows; return colours, alpha and alpha-weighted sums of depth."""
        seen = self.see(body_poses, cam_from_table)
        splats, threads = self.composition.splats, self.threads
        colours, alphas, depths = draw_seen(splats, seen, self._fine, self.backdrop, threads, antialiased=True)
        if self._oversampling > 1:
            colours, alphas, depths = pooled(colours, alphas, depths, self._oversampling)
        if self.lying:
            lay(self.lying, colours, depths, alphas, self.camera, cam_from_table, body_poses[OBJECT], self._box)
        if self.shadows is not None:
            self.shadows.dim(colours, depths, alphas, self.camera, cam_from_table, body_poses)
        return colours, alphas, depths

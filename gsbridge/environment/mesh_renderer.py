"""Renderer of the control without Gaussians (RL-sim): same camera and poses, meshes in one or in vertex colours."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from gsbridge.cameras import Camera
from gsbridge.environment.gaussian_renderer import OBJECT
from gsbridge.environment.litter import FlatThing, lay
from gsbridge.environment.rendering import check_drawn
from gsbridge.errors import InputError
from gsbridge.geometry import Array
from gsbridge.images import linear_from_srgb, srgb_from_linear
from gsbridge.meshes import Mesh
from gsbridge.scene.meshes import MeshComposition, uniform
from gsbridge.scene.shadows import Shadows
from gsbridge.scene.view import to_bytes


def mean_mesh_colour(mesh: Mesh) -> Array:
    """Return the mean sRGB colour of a mesh by area, averaged as light; a substitute if there are no photos and masks. [3].

    Raises:
        InputError: The mesh has no colours.
    """
    if mesh.colours is None:
        raise InputError("mesh renderer", "the mesh has no vertex colours", "Give the mean colour of its photos")
    corners = linear_from_srgb(np.asarray(mesh.colours, np.float64))[mesh.faces].mean(1)
    areas = mesh.areas()
    return np.asarray(srgb_from_linear(areas @ corners / max(float(areas.sum()), 1e-30)))


class MeshRenderer:
    """Renderer of meshes.

    Args:
        item: Mesh of the object, body frame.
        background: Mesh of the background, table frame.
        robot: Coloured meshes of the links, link frames.
        camera: Pinhole.
        vertex_colours: Draw object and background with their vertex colours; otherwise in one colour each.
        item_colour: The object's one colour, sRGB 0..1: the mean of its photos inside the mask
            (`gsbridge.scene.meshes.mean_colour`); None for the mesh's mean. [3].
        background_colour: The background's one colour, sRGB 0..1; None for the mesh's mean. [3].
        shadows: Shadows of robot and object, which dim the picture, as for splats; None for none, as in RL-sim.
    """

    def __init__(
        self,
        item: Mesh,
        background: Mesh,
        robot: Mapping[str, Mesh],
        camera: Camera,
        *,
        vertex_colours: bool = False,
        item_colour: Sequence[float] | None = None,
        background_colour: Sequence[float] | None = None,
        shadows: Shadows | None = None,
    ) -> None:
        self.camera, self.shadows = camera, shadows
        self.lying: Sequence[FlatThing] = ()
        self._box = item.vertices.min(axis=0), item.vertices.max(axis=0)
        ground = mean_mesh_colour(background) if background_colour is None else np.asarray(background_colour, np.float64)
        if not vertex_colours:
            item = uniform(item, mean_mesh_colour(item) if item_colour is None else np.asarray(item_colour, np.float64))
            background = uniform(background, ground)
        elif item.colours is None or background.colours is None:
            raise InputError("mesh renderer", "a mesh has no vertex colours", "Use the renderer 'mesh', or colour the mesh")
        self.backdrop = (float(ground[0]), float(ground[1]), float(ground[2]))
        self.composition = MeshComposition({OBJECT: item, **robot}, background)

    def pose(self, body_poses: Mapping[str, Array]) -> None:
        """Move the bodies without drawing. [4, 4] each.

        Raises:
            InputError: A drawn body has no pose.
        """
        check_drawn(self.composition.names, body_poses)
        self.composition.pose({name: body_poses[name] for name in self.composition.names})

    def render(self, body_poses: Mapping[str, Array], cam_from_table: Array) -> Array:
        """The picture; see `Renderer`. [H, W, 3] uint8."""
        if self.shadows is not None or self.lying:
            return to_bytes(self.draw(body_poses, cam_from_table))
        self.pose(body_poses)
        return self.composition.render(self.camera, cam_from_table, self.backdrop)

    def draw(self, body_poses: Mapping[str, Array], cam_from_table: Array) -> Array:
        """The picture before it is rounded; see `Renderer`. [H, W, 3] float32."""
        self.pose(body_poses)
        colours, alphas, depths = self.composition.draw(self.camera, cam_from_table, self.backdrop)
        if self.lying:
            lay(self.lying, colours, depths, alphas, self.camera, cam_from_table, body_poses[OBJECT], self._box)
        if self.shadows is not None:
            self.shadows.dim(colours, depths, alphas, self.camera, cam_from_table, body_poses)
        return colours

    def coverage(self, body_poses: Mapping[str, Array], cam_from_table: Array) -> float:
        """Return the share of a view that meshes fill, with bodies and camera at their poses. [4, 4] each."""
        self.pose(body_poses)
        return float(self.composition.coverage(self.camera, cam_from_table).mean())

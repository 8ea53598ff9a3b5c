"""Flat things that lie on the table in pictures of a training: what a policy must not take for its object.

A policy that has only ever seen its object on an empty table goes for whatever has the object's colours. So in episodes of a
training, cards, discs and strips may lie about, some in colours of the object. They have no body: they are painted on the
table's plane where the picture shows it, under the shadows of what stands there. Nothing is painted within the object's
bounding box, so that the object's foot stays whole wherever it is pushed.
"""

from __future__ import annotations

import colorsys
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gsbridge.cameras import Camera
from gsbridge.geometry import Array
from gsbridge.tasks.poses import StartRegion

_LEVEL = 0.009
"""Points that are seen less than this above or below the table's plane count as table, m. Fingertips stay farther away, and the
depth errors of a background's splats are smaller nearly everywhere."""

_CLEAR = 0.03
"""Least distance of a thing's edge from where the object starts, m."""

_MARGIN = 0.002
"""Margin round the object's box, since its splats reach beyond their centres, m."""

_HALF, _FLAT = (0.008, 0.04), (0.25, 1.0)
"""Range of a thing's half length, m, and range of its width as a share of the length."""

_OWN = 0.6
"""Probability that a colour is taken from the object's palette."""

_BRIGHTNESS = (0.6, 1.2)
"""Range of the factor by which a colour of the object is darkened or brightened."""


@dataclass(frozen=True)
class FlatThing:
    """Something flat on the table.

    Args:
        x, y: Middle, table frame, m.
        turn: Angle of its length against the table's x, rad.
        length, width: Half length and half width, m.
        round: Whether it is an ellipse; otherwise it is a rectangle.
        colours: Colours of the two halves along its length, sRGB. [2, 3].
    """

    x: float
    y: float
    turn: float
    length: float
    width: float
    round: bool
    colours: Array


@dataclass(frozen=True)
class Litter:
    """Distribution of the flat things that may lie on the table.

    Args:
        most: Largest number of things that are drawn for one episode; those that would lie in the way are left out.
        palette: Colours of the object, sRGB. [N, 3].
        region: Where objects start; things lie there, too, but not on the plate.
    """

    most: int
    palette: Array
    region: StartRegion

    def scattered(self, rng: np.random.Generator, object_xy: Array) -> tuple[FlatThing, ...]:
        """Draw the things of one episode.

        Args:
            rng: Generator of the episode.
            object_xy: Where the object starts, table frame, m; things keep clear of it. [2].
        """
        things = (self._thing(rng) for _ in range(int(rng.integers(self.most + 1))))
        return tuple(
            thing
            for thing in things
            if np.hypot(thing.x - object_xy[0], thing.y - object_xy[1]) > thing.length + _CLEAR
            and self.region.free(np.array([thing.x, thing.y]))
        )

    def _thing(self, rng: np.random.Generator) -> FlatThing:
        x, y = np.array(self.region.centre) + self.region.side * rng.uniform(-0.5, 0.5, 2)
        length = float(rng.uniform(*_HALF))
        colours = np.array([self._colour(rng)] * 2)
        if rng.random() < 0.5:
            colours[1] = self._colour(rng)
        return FlatThing(
            float(x), float(y), float(rng.uniform(0.0, np.pi)), length, length * float(rng.uniform(*_FLAT)),
            bool(rng.random() < 0.4), colours,
        )  # fmt: skip

    def _colour(self, rng: np.random.Generator) -> Array:
        if rng.random() < _OWN:
            return np.asarray(self.palette[rng.integers(len(self.palette))] * rng.uniform(*_BRIGHTNESS)).clip(0.0, 1.0)
        return np.array(colorsys.hsv_to_rgb(rng.random(), rng.uniform(0.0, 1.0), rng.uniform(0.1, 1.0)))


def lay(
    things: Sequence[FlatThing],
    image: Array,
    depths: Array,
    alphas: Array,
    camera: Camera,
    cam_from_table: Array,
    table_from_object: Array,
    box: tuple[Array, Array],
) -> None:
    """Paint things on the table, where a picture shows the table.

    Args:
        things: The things to paint.
        image: The picture, encoded sRGB, changed in place. [H, W, 3] float32.
        depths, alphas: Alpha-weighted sum of camera z, m, and alpha, as the rasteriser gives them. [H, W] float32.
        camera: Pinhole.
        cam_from_table: Pose of the camera. [4, 4].
        table_from_object: Pose of the object. [4, 4].
        box: Corners of the object's box, body frame, m. [3], [3].
    """
    table_from_cam = np.linalg.inv(cam_from_table)
    fx, fy, cx, cy = camera.pinhole_numbers
    across, down = (np.arange(camera.width) + 0.5 - cx) / fx, (np.arange(camera.height) + 0.5 - cy) / fy
    turn, eye = table_from_cam[:3, :3], table_from_cam[:3, 3]
    rays = turn[:, 0] * across[None, :, None] + turn[:, 1] * down[:, None, None] + turn[:, 2]
    steep = np.minimum(rays[..., 2], -1e-6)
    away = -eye[2] / steep
    seen = eye + (depths / np.maximum(alphas, 1e-3))[..., None] * rays
    inside = (seen - table_from_object[:3, 3]) @ table_from_object[:3, :3]
    own = ((inside > box[0] - _MARGIN) & (inside < box[1] + _MARGIN)).all(axis=-1) & (alphas > 0.5)
    table = (rays[..., 2] < -1e-6) & (away > 0.0) & ((np.abs(seen[..., 2]) < _LEVEL) | (alphas < 0.5)) & ~own
    point = eye[:2] + away[..., None] * rays[..., :2]
    # Edges are blurred over the width of a pixel on the table, m.
    pixel = np.maximum(away / fx, 1e-6)
    for thing in things:
        cosine, sine = np.cos(thing.turn), np.sin(thing.turn)
        apart = point - (thing.x, thing.y)
        along = cosine * apart[..., 0] + sine * apart[..., 1]
        aside = cosine * apart[..., 1] - sine * apart[..., 0]
        if thing.round:
            outside = (np.hypot(along / thing.length, aside / thing.width) - 1.0) * thing.width
        else:
            outside = np.maximum(np.abs(along) - thing.length, np.abs(aside) - thing.width)
        cover = np.where(table, np.clip(0.5 - outside / pixel, 0.0, 1.0), 0.0)[..., None]
        colour = np.where((along > 0.0)[..., None], thing.colours[1], thing.colours[0])
        image += (cover * (colour - image)).astype(np.float32)

"""A small synthetic world for blind image cases: a textured table with boxes, rendered by ray tracing without splats.

Colours are linear light. Textures are sums of waves with sharp-edged patches on top, or given images.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from gsbridge.cameras import look_at
from gsbridge.geometry import Array
from gsbridge.images import linear_from_srgb
from gsbridge.scene.track import Track

_WAVES = 7
_PATCHES = 24
_TABLE = 1.2
_SIDE = 0.24
"""Edge lengths of the textures of table and boxes, m; beyond their edges, textures are mirrored."""


@dataclass(frozen=True)
class Texture:
    """Albedo of a surface.

    Args:
        albedo: Linear albedo. [H, W, 3] float32.
        size: Edge length that the texture covers, m.
    """

    albedo: Array
    size: float

    @classmethod
    def draw(cls, rng: np.random.Generator, size: float, pixels: int) -> Texture:
        """Draw a texture of waves and discs of random colours.

        Args:
            rng: Random numbers.
            size: Edge length that the texture covers, m.
            pixels: Edge length of the texture, px.
        """
        y, x = np.meshgrid(*(((np.arange(pixels) + 0.5) / pixels - 0.5,) * 2), indexing="ij")
        lengths, angles = rng.uniform(0.06, 0.4, _WAVES), rng.uniform(0.0, np.pi, _WAVES)
        swing = np.zeros((pixels, pixels, 3))
        for length, angle in zip(lengths, angles, strict=True):
            along = (x * np.cos(angle) + y * np.sin(angle)) * 2 * np.pi / length
            swing += rng.normal(0.0, 0.3, 3) * np.sin(along[..., None] + rng.uniform(0, 2 * np.pi, 3))
        out = rng.uniform(0.12, 0.45, 3) * np.exp(0.6 * swing)
        for _ in range(_PATCHES):
            far = np.hypot(x - rng.uniform(-0.45, 0.45), y - rng.uniform(-0.45, 0.45))
            radius = rng.uniform(0.02, 0.07)
            out[far < radius] = rng.uniform(0.03, 0.75, 3)
        return cls(np.clip(out, 0.01, 0.85).astype(np.float32), size)

    @classmethod
    def of(cls, picture: Array, size: float, pixels: int) -> Texture:
        """Make a texture of an image.

        Args:
            picture: sRGB image, 0..1. [H, W, 3].
            size: Edge length that the texture covers, m.
            pixels: Edge length to which the image is resized, px.
        """
        small = cv2.resize(picture.astype(np.float32), (pixels, pixels), interpolation=cv2.INTER_AREA)
        return cls(np.clip(linear_from_srgb(small), 0.01, 0.9), size)

    def at(self, x: Array, y: Array) -> Array:
        """Return the albedo at positions on the surface, m. [R], [R] -> [R, 3]."""
        pixels = len(self.albedo)
        columns, rows = ((v / self.size + 0.5) * pixels - 0.5 for v in (x, y))
        parts = range(0, len(columns), 32000)
        edge = cv2.BORDER_REFLECT
        found = [
            cv2.remap(
                self.albedo, columns[k : k + 32000, None].astype(np.float32), rows[k : k + 32000, None].astype(np.float32),
                cv2.INTER_LINEAR, borderMode=edge,
            )[:, 0]
            for k in parts
        ]  # fmt: skip
        return np.concatenate(found) if found else np.zeros((0, 3), np.float32)


@dataclass(frozen=True)
class Box:
    """A box that stands on the table.

    Args:
        middle: Centre on the table, m. [2].
        turn: Rotation about z, rad.
        half: Half edge lengths, m. [3].
        texture: Texture of the top and of the sides.
    """

    middle: Array
    turn: float
    half: Array
    texture: Texture


@dataclass(frozen=True)
class ImageWorld:
    """An infinite table at z = 0 with boxes on it.

    Args:
        table: Texture of the table.
        boxes: Boxes that stand on the table.
    """

    table: Texture
    boxes: tuple[Box, ...]

    @classmethod
    def draw(cls, seed: int, pictures: Sequence[Array] = ()) -> ImageWorld:
        """Draw a random world.

        Args:
            seed: Seed of everything.
            pictures: sRGB images, one of which textures the table; none for a painted table. Each [H, W, 3].
        """
        rng = np.random.default_rng(seed)
        boxes = []
        for angle in rng.uniform(0, 2 * np.pi) + np.arange(3) * 2 * np.pi / 3:
            middle = rng.uniform(0.07, 0.13) * np.array([np.cos(angle), np.sin(angle)])
            half = np.array([*rng.uniform(0.02, 0.045, 2), rng.uniform(0.02, 0.06)])
            boxes.append(Box(middle, rng.uniform(0, np.pi), half, Texture.draw(rng, _SIDE, 100)))
        table = Texture.draw(rng, _TABLE, 480)
        if len(pictures):
            table = Texture.of(pictures[int(rng.integers(len(pictures)))], 0.5 * _TABLE, 360)
        return cls(table, tuple(boxes))

    def look(self, origins: Array, directions: Array) -> tuple[Array, Array]:
        """Return linear colours and hit points, m, of rays from origins, m, along directions. [R, 3] each -> [R, 3], [R, 3]."""
        ox, oy, oz = (np.ascontiguousarray(v, np.float32) for v in origins.T)
        dx, dy, dz = (np.ascontiguousarray(v, np.float32) for v in directions.T)
        nearest = -oz / np.minimum(dz, np.float32(-1e-6))
        which, faces = np.full(len(nearest), -1), np.zeros(len(nearest), int)
        local = []
        for number, box in enumerate(self.boxes):
            c, s = np.float32(np.cos(box.turn)), np.float32(np.sin(box.turn))
            px, py, pz = ox - np.float32(box.middle[0]), oy - np.float32(box.middle[1]), oz - np.float32(box.half[2])
            start, way = (c * px + s * py, c * py - s * px, pz), (c * dx + s * dy, c * dy - s * dx, dz)
            first, last = np.full(len(nearest), -np.inf, np.float32), np.full(len(nearest), np.inf, np.float32)
            face = np.zeros(len(nearest), int)
            for axis in range(3):
                inverse = 1.0 / np.where(np.abs(way[axis]) < 1e-9, np.float32(1e-9), way[axis])
                one = (-np.float32(box.half[axis]) - start[axis]) * inverse
                other = (np.float32(box.half[axis]) - start[axis]) * inverse
                enter = np.minimum(one, other)
                face = np.where(enter > first, axis, face)
                first, last = np.maximum(first, enter), np.minimum(last, np.maximum(one, other))
            hit = (first < last) & (first > 0) & (first < nearest)
            nearest, which, faces = np.where(hit, first, nearest), np.where(hit, number, which), np.where(hit, face, faces)
            local.append((start, way))
        places = np.stack([ox + nearest * dx, oy + nearest * dy, oz + nearest * dz], axis=1)
        colours = self.table.at(places[:, 0], places[:, 1])
        for number, box in enumerate(self.boxes):
            mine = np.flatnonzero(which == number)
            if len(mine):
                at = [start[mine] + nearest[mine] * way[mine] for start, way in zip(*local[number], strict=True)]
                face = faces[mine]
                across, up = np.where(face == 0, at[1], at[0]), np.where(face == 2, at[1], at[2])
                shade = np.choose(face, [0.55, 0.7, 1.0]).astype(np.float32)
                colours[mine] = box.texture.at(across + 0.3 * _SIDE * face, up) * shade[:, None]
        return colours, places


def course(seed: int, duration: float = 4.0, rounds: float = 0.0, rate: float = 25.0) -> Track:
    """Draw the course of a camera that a hand moves above the table: to and fro, up and down, with rotations.

    Args:
        seed: Seed of the motion.
        duration: Length of the course, s.
        rounds: Number of additional rounds about the middle of the table.
        rate: Poses per second.
    """
    rng = np.random.default_rng(seed)
    times = np.arange(round(duration * rate) + 1) / rate
    pace = 2 * np.pi * rng.uniform(0.25, 0.7, (3, 3))
    sway = np.sin(times[:, None, None] * pace + rng.uniform(0, 2 * np.pi, (3, 3)))
    around = rng.uniform(0, 2 * np.pi) + 0.5 * sway[:, 2, 0] + 2 * np.pi * rounds * times / duration
    far = 0.14 + 0.05 * sway[:, 0, 0]
    eyes = np.stack([far * np.cos(around), far * np.sin(around), 0.42 + 0.07 * sway[:, 0, 2]], axis=1)
    aims = np.concatenate([0.05 * sway[:, 1, :2], np.zeros((len(times), 1))], axis=1)
    poses = np.stack([look_at(eye, aim) for eye, aim in zip(eyes, aims, strict=True)])
    lean = 0.25 * sway[:, 2, 1]
    for pose, angle in zip(poses, lean, strict=True):
        c, s = np.cos(angle), np.sin(angle)
        pose[:3] = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ pose[:3]
    return Track(times, poses)
